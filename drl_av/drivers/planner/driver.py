"""The driver ``planner`` (ours): it compares about a hundred plans at every second decision."""

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.drivers.planner.forecast import Forecaster, PlanCosts
from drl_av.drivers.planner.limits import limits_of
from drl_av.drivers.planner.low_level_controller import Control, Ego, LowLevelController
from drl_av.drivers.planner.others import FAR_M, BoolArray, IntArray, Others, others_of
from drl_av.drivers.planner.parameter_estimator import Ahead, ParameterEstimator
from drl_av.drivers.planner.plans import PLANS, Intent, next_second, usable_plans
from drl_av.driving.actions import Action, Longitudinal, nearest_action, toward
from drl_av.driving.affordances import Affordances
from drl_av.driving.scene import Scene
from drl_av.road.snapshot import Snapshot

DECISIONS_PER_PLAN = 2
HURRIED_M = 150.0
"""If less than this distance is left for each mandatory lane change, the ego begins a lane change
as soon as the safety check permits it, whatever its plan says."""


class PlannerDriver:
    """Follows its plan until another plan scores higher by more than ``Prices.change_of_plan``.

    The driver uses all vehicles of the scene, not only the 27 indicators. It remembers the open
    lanes, and estimates the other drivers' parameters from their motion. It is deterministic.
    """

    def __init__(self, config: Config, prices: PlanCosts | None = None) -> None:
        self._ego, self._limits, self._prices = config.ego, limits_of(config), prices or PlanCosts()
        self.start(0)

    def start(self, seed: int) -> None:
        """Prepare for an episode: forget the previous episode; ``seed`` is not used."""
        self._watcher: ParameterEstimator | None = None
        self._last: Snapshot | None = None
        self._decisions, self._sign = 0, 0
        self._plan: IntArray = np.full(PLANS.shape[1], Intent.KEEP)
        self._open: dict[int, bool] = {}

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the action of the best plan in this scene.

        A second call with the same scene does not advance the plan.
        """
        lanes = self._open_lanes(scene)
        others = others_of(scene.snapshot, scene.affordances, len(lanes))
        is_new = self._last is None or scene.snapshot.time_s != self._last.time_s
        watcher = self._watch(scene, others)
        lap_m = scene.affordances.circumference_m or FAR_M
        mandatory = scene.affordances.mandatory
        chooser = LowLevelController(lanes, self._ego, self._limits, mandatory.side)
        forecaster = Forecaster(others, watcher, lap_m, chooser, self._ego, mandatory)
        if is_new:
            self._next_plan(forecaster, scene)
        choice = forecaster.choice(self._egos(scene, 1), self._plan[:1])
        if mandatory.within_m < HURRIED_M * abs(mandatory.lanes) and scene.lane_change is None:
            intent = Intent.LEFT if mandatory.side > 0 else Intent.RIGHT
            to_change = forecaster.choice(self._egos(scene, 1), np.array([intent]))
            choice = to_change if to_change.begins[0] else choice
        self._sign = int(np.sign(choice.acceleration_m_s2[0])) or self._sign
        return self._action(scene, choice)

    def _open_lanes(self, scene: Scene) -> BoolArray:
        """Return which lanes are open, shape (L,).

        A lane that the ego has not been next to is taken to be open if it contains vehicles.
        """
        seen = scene.affordances
        self._open |= {seen.lane - 1: _has_right(seen), seen.lane + 1: seen.left_lane}
        self._open[seen.lane] = True
        used = np.round(scene.snapshot.y_m / seen.lane_width_m).astype(int)
        last = max(int(used.max()), *(lane for lane, is_open in self._open.items() if is_open))
        return np.array(
            [self._open.get(lane, bool((used == lane).any())) for lane in range(last + 1)]
        )

    def _watch(self, scene: Scene, others: Others) -> ParameterEstimator:
        """Update the estimates with this scene, and return them."""
        shot = scene.snapshot
        if self._watcher is None or self._last is None:
            self._watcher = ParameterEstimator(others)
        elif shot.time_s > self._last.time_s:
            ahead = _ahead(others, scene.affordances)
            self._watcher.observe(others, ahead, shot.time_s - self._last.time_s)
        self._last = shot
        return self._watcher

    def _next_plan(self, forecaster: Forecaster, scene: Scene) -> None:
        rest = next_second(self._plan)
        if self._decisions % DECISIONS_PER_PLAN == 0:
            seen = scene.affordances
            is_changing = scene.lane_change is not None
            plans = np.vstack([usable_plans(is_changing, _has_right(seen), seen.left_lane), rest])
            ego = self._egos(scene, len(plans))
            scores = forecaster.scores(ego, self._sign, plans, self._prices)
            scores[-1] += self._prices.change_of_plan
            rest = plans[scores.argmax()]
        self._plan = rest
        self._decisions += 1

    def _egos(self, scene: Scene, n: int) -> Ego:
        """Return the ego of a scene, repeated ``n`` times."""
        seen, change = scene.affordances, scene.lane_change
        origin, target, seconds = seen.lane, seen.lane, 0
        if change is not None:
            origin, target = change.origin, change.target
            share = abs(seen.ego_y_m / seen.lane_width_m - origin)
            seconds = round(share * self._ego.lane_change_duration_s)
        lanes = (np.full(n, number) for number in (origin, target, seconds))
        return Ego(np.zeros(n), np.full(n, seen.ego_speed_m_s), *lanes)

    def _action(self, scene: Scene, choice: Control) -> Action:
        rate, change = float(choice.acceleration_m_s2[0]), scene.lane_change
        side = int(choice.begins[0])
        side *= scene.affordances.has_lane(side)
        if change is not None and choice.aborts[0]:
            side = -change.sign
        by_model = self._ego.longitudinal_reference != "acceleration"
        if by_model and rate > -self._ego.brake_m_s2:
            return Action(toward(side), Longitudinal.ACCELERATE)
        return Action(toward(side), nearest_action(rate, self._ego))


def _has_right(seen: Affordances) -> bool:
    """Return whether plans may use a lane to the right, which exists or is the lane of an exit.

    Plans may use the lane of an exit even before this lane begins. Otherwise no plan would take the
    exit, and the ego would brake until the lane begins.
    """
    return seen.right_lane or seen.mandatory.side < 0


def _ahead(others: Others, seen: Affordances) -> Ahead:
    """Return each other vehicle's gap and closing speed to its leader, which may be the ego."""
    lanes, x_m, speed = others.now, others.x_m, others.speed_m_s
    gap_m = x_m[lanes.leader] - x_m + lanes.offset_m
    closing = speed - speed[lanes.leader]
    shares = lanes.member[seen.lane]
    follows = shares & (x_m < 0) & (-x_m - others.half_m < gap_m)
    gap_m = np.where(follows, -x_m - others.half_m, gap_m)
    return Ahead(gap_m, np.where(follows, speed - seen.ego_speed_m_s, closing))
