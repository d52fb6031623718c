"""The check ``strict`` on one action, with arrays of vehicles."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray
from drl_av.config import EgoConfig, SimulationConfig, StrictConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal, toward
from drl_av.driving.scene import LaneChange, Scene
from drl_av.road.road import ARRIVED_M, Barrier
from drl_av.road.snapshot import EGO
from drl_av.safety.check import Rule, Verdict
from drl_av.safety.reachability import reach, stopping_distance, travel
from oracles.affordances import has_lane
from oracles.plan import next_lane_change

LINE_M = 0.01
"""A body overlaps a lane if it is at least this far over the marking of that lane."""
STILL_M_S = 0.01
"""A vehicle whose lateral speed is at most this counts as not moving sideways."""
ON_LINE_M = 0.05
"""A centre within this distance of the marking between two lanes counts as being in both."""


def lanes_under(y_m: Any, width_m: Any, lane_width_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the indices of the rightmost and the leftmost lane that a body overlaps."""
    lowest = np.floor((y_m - width_m / 2 + LINE_M) / lane_width_m + 0.5)
    return lowest, np.ceil((y_m + width_m / 2 - LINE_M) / lane_width_m - 0.5)


def lateral_extent(
    y_m: FloatArray, lateral_speed_m_s: FloatArray, width_m: FloatArray, lane_width_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return the right and left end of the lateral range that a vehicle's body may occupy, metres.

    Its centre may be anywhere between its present position, the centres of the lanes that the body
    overlaps, and the centre of the lane that it moves towards.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    moving = np.abs(lateral_speed_m_s) > STILL_M_S
    if moving.any():
        lane = y_m / lane_width_m
        moving &= np.abs(lane - np.round(lane)) * lane_width_m > ARRIVED_M
        to_right, to_left = moving & (lateral_speed_m_s < 0), moving & (lateral_speed_m_s > 0)
        lowest = np.where(to_right, np.minimum(lowest, np.floor(lane)), lowest)
        highest = np.where(to_left, np.maximum(highest, np.ceil(lane)), highest)
    return (
        np.minimum(lowest * lane_width_m, y_m) - width_m / 2,
        np.maximum(highest * lane_width_m, y_m) + width_m / 2,
    )


def must_stay_behind(
    y_m: FloatArray, width_m: FloatArray, ego_y_m: Any, ego_width_m: float, lane_width_m: float
) -> BoolArray:
    """Whether a vehicle, if it is behind the ego, must stay behind it by bound 4 of ``strict``.

    It must if the bodies overlap laterally, and the ego's body overlaps each lane that the
    vehicle's body overlaps. The result has one flag for each vehicle.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    ego_lowest, ego_highest = lanes_under(ego_y_m, ego_width_m, lane_width_m)
    in_the_way = np.abs(y_m - ego_y_m) < (width_m + ego_width_m) / 2
    return in_the_way & (ego_lowest <= lowest) & (highest <= ego_highest)


class Others(NamedTuple):
    """The other vehicles as the check needs them; arrays of one shape (..., vehicles)."""

    right_m: FloatArray
    left_m: FloatArray
    """The check assumes that each vehicle's body stays between ``right_m`` and ``left_m``."""
    gap_m: FloatArray
    """Net gap to the ego along the road; 0 or less for a vehicle beside the ego."""
    is_ahead: BoolArray
    speed_m_s: FloatArray
    stop_within_m: FloatArray
    """Distance within which the ego must stop in order to stay behind the vehicle, metres.

    It is inf for a vehicle behind, and -inf for a vehicle beside the ego whose centre is ahead.
    """
    must_stay_behind: BoolArray
    """Whether the vehicle, if it is behind the ego, must stay behind it (bound 4 of ``strict``)."""


def with_barriers(others: Others, barriers: Sequence[Barrier], clearance_m: float) -> Others:
    """Return ``others``, followed by each barrier of a scene as a standing vehicle of length 0.

    The ``s_m`` of these barriers is the distance from the ego's front bumper, metres.
    """
    gap_m, right_m, left_m = np.array(barriers).T
    standing = np.zeros(len(barriers))
    stop_within_m = np.where(gap_m > 0, gap_m - clearance_m, -np.inf)
    rows = (right_m, left_m, gap_m, standing == 0, standing, stop_within_m, standing > 0)
    return Others(*map(np.append, others, rows))


def stopping_limit(
    gap_m: FloatArray,
    is_ahead: BoolArray,
    speed_m_s: FloatArray,
    strict: StrictConfig,
    step_s: float,
) -> FloatArray:
    """Return ``Others.stop_within_m``: the distance within which the ego must stop, metres.

    The first three arguments are fields of ``Others``; ``step_s`` is the length of a SUMO step.
    """
    rest_m = stopping_distance(speed_m_s, strict.braking_m_s2, step_s)
    rest_m = np.where(gap_m > 0, gap_m + rest_m - strict.clearance_m, -np.inf)
    return np.where(is_ahead, rest_m, np.inf)


def overlaps_laterally(neighbors: Others, right_m: Any, left_m: Any) -> BoolArray:
    """Whether each vehicle's body can overlap the lateral range from ``right_m`` to ``left_m``."""
    return (neighbors.left_m > right_m) & (neighbors.right_m < left_m)


def required_travel(
    neighbors: Others, delay_s: FloatArray | float, strict: StrictConfig, step_s: float
) -> FloatArray:
    """Return the distances, metres, that the ego must travel before it stands, shape (N,).

    If the ego travels farther than distance i, vehicle i of the N neighbours does not reach it from
    behind, even if that vehicle accelerates for ``delay_s`` seconds before it brakes to a
    standstill. The distance is -inf for a vehicle ahead, which requires nothing, and inf for one
    beside the ego, for which no distance is enough. ``step_s`` is the length of a SUMO step.
    """
    speed = neighbors.speed_m_s
    faster = speed + strict.acceleration_m_s2 * delay_s
    rolled_m = accelerated(speed, delay_s, strict, step_s)
    rolled_m = rolled_m + stopping_distance(faster, strict.follower_braking_m_s2, step_s)
    behind_m = rolled_m - neighbors.gap_m + strict.clearance_m
    required_m = np.where(neighbors.is_ahead, -np.inf, behind_m)
    return np.where(neighbors.gap_m <= 0, np.inf, required_m)


def stays_behind(
    neighbors: Others,
    crosses_s: FloatArray | float,
    covered_m: Sequence[FloatArray | float],
    strict: StrictConfig,
    step_s: float,
) -> BoolArray:
    """Whether each vehicle behind stays behind an ego that moves into its lane.

    Args:
        neighbors: The other vehicles.
        crosses_s: Time until the ego's body crosses the lane marking, seconds; 0 if the body does
            not cross it in this decision.
        covered_m: Smallest distances that the ego can cover until the end of each SUMO step of the
            decision, and as the last element until standstill.
        strict: The bounds of the other vehicles.
        step_s: Length of a SUMO step, seconds.

    Returns:
        One flag for each vehicle: True for a vehicle ahead, False for a vehicle beside the ego.
    """
    must_m = required_travel(neighbors, strict.follower_response_s + crosses_s, strict, step_s)
    result = covered_m[-1] > must_m
    for step, ego_m in enumerate(covered_m[:-1], 1):
        rolled_m = accelerated(neighbors.speed_m_s, step * step_s, strict, step_s)
        apart = neighbors.is_ahead | (neighbors.gap_m + ego_m > rolled_m)
        result &= apart | (np.asarray(crosses_s) == 0)
    return result


def accelerated(
    speed_m_s: FloatArray, time_s: FloatArray | float, strict: StrictConfig, step_s: float
) -> FloatArray:
    """Return the distance, metres, that a vehicle covers in ``time_s`` at its largest acceleration.

    It begins with ``speed_m_s`` and accelerates with ``strict.acceleration_m_s2``.
    """
    return speed_m_s * time_s + strict.acceleration_m_s2 * time_s * (time_s + step_s) / 2


def covered(
    speed_m_s: float, acceleration_m_s2: float, ego: EgoConfig, sim: SimulationConfig
) -> list[Any]:
    """Return the distance that the ego has covered after each SUMO step of a decision, metres.

    The acceleration is constant, but the speed stays within [0, max_speed_m_s].
    """
    limits, counts = (sim.step_length_s, ego.max_speed_m_s), range(1, sim.steps_per_decision + 1)
    return [travel(speed_m_s, acceleration_m_s2, steps, *limits)[0] for steps in counts]


ACCELERATE, MAINTAIN = Longitudinal.ACCELERATE, Longitudinal.MAINTAIN
ORDER = (ACCELERATE, MAINTAIN, Longitudinal.BRAKE, Longitudinal.HARD_BRAKE)
ROUNDING = 1e-6
"""Largest rounding error of a computed number of SUMO steps."""


def seconds_to_line(distance_m: Any, width_m: float, ego: EgoConfig, sim: SimulationConfig) -> Any:
    """Return the time, seconds, until the ego's body is over a line (a lane marking) beside it.

    ``distance_m`` is the distance from the nearer side of the body to the line, a number or an
    array; it is negative if that side is already beyond the line. The body is over the line when
    its side is more than ``LINE_M`` beyond it. The ego moves sideways at the speed of a lane
    change. The time is rounded up to whole SUMO steps. It is 0 if the body is already over the
    line, and also if it does not get there within this decision.
    """
    stride_m = width_m / ego.lane_change_duration_s * sim.step_length_s
    steps = (distance_m + LINE_M) / stride_m
    soon = (steps > -ROUNDING) & (np.ceil(steps - ROUNDING) <= sim.steps_per_decision)
    return np.where(soon, np.ceil(steps + ROUNDING), 0) * sim.step_length_s


def corridor(
    scene: Scene, lane_change: LaneChange | None, ego: EgoConfig, decision_s: float
) -> tuple[float, float]:
    """Return the right and left end of the lateral range that the ego's body may use, metres.

    It contains the lanes that the ego's body overlaps, the rest of ``lane_change``, and the
    fallback maneuver if the ego begins it at the next decision, ``decision_s`` seconds later.
    """
    affordances, ego_m = scene.affordances, float(scene.snapshot.width_m[EGO])
    y_m, width_m = affordances.ego_y_m, affordances.lane_width_m
    places = [y_m, *(width_m * float(lane) for lane in lanes_under(y_m, ego_m, width_m))]
    if lane_change is not None:
        end_m = lane_change.target * width_m
        stride_m = min(abs(end_m - y_m), width_m / ego.lane_change_duration_s * decision_s)
        next_m = y_m + lane_change.sign * stride_m
        places += [end_m, *(width_m * lane for lane in lanes_about(next_m, width_m))]
    return min(places) - ego_m / 2, max(places) + ego_m / 2


def lanes_about(y_m: float, lane_width_m: float) -> tuple[int, int]:
    """Return the right and the left lane that contain a lateral position; usually they are equal.

    They differ if the position is within ``ON_LINE_M`` of the marking between two lanes.
    """
    right, left = (y_m - ON_LINE_M) / lane_width_m, (y_m + ON_LINE_M) / lane_width_m
    return math.floor(right + 0.5), math.floor(left + 0.5)


def fallback_maneuver(scene: Scene) -> LaneChange | None:
    """Return the lane change of the fallback maneuver, or None if no lane change is in progress."""
    change = scene.lane_change
    goes_back = change is not None and change.target != scene.affordances.lane
    return change.reversed() if goes_back else change


class Strict:
    """The check ``strict`` of this module; it raises ConfigError without the kinematic plant."""

    def __init__(self, strict: StrictConfig, ego: EgoConfig, simulation: SimulationConfig) -> None:
        self._strict, self._ego, self._simulation = strict, ego, simulation
        self._accelerations = np.array([how.acceleration_m_s2(ego) for how in Longitudinal])

    def __call__(self, scene: Scene, proposed: Action) -> Verdict:
        """Return the action that the ego executes, and the rules that replaced the proposed action.

        Of the proposed and all slower longitudinal actions, the ego executes the fastest one that
        keeps the fallback maneuver free, or else hard brake. If the check does not permit the
        proposed lateral action together with it, the ego executes that of the fallback maneuver.
        """
        affordances, neighbors = scene.affordances, self.others(scene)
        fallback = fallback_maneuver(scene)
        wanted = next_lane_change(scene.lane_change, affordances.lane, proposed.lateral)
        speed = affordances.ego_speed_m_s
        reaches = reach(speed, self._accelerations, self._ego, self._simulation).tolist()
        may_m = self._may_reach(scene, fallback, neighbors)
        order = same_or_slower(proposed.longitudinal)
        safe = next((how for how in order if reaches[how] < may_m), Longitudinal.HARD_BRAKE)
        rule = Rule.NONE if safe == proposed.longitudinal else Rule.IN_LANE
        if wanted is None or wanted == fallback:
            return Verdict(Action(proposed.lateral, safe), rule)
        if not has_lane(affordances, wanted.target - affordances.lane):
            rule |= Rule.OFF_ROAD
        elif self._permits(scene, wanted, neighbors, safe, reaches):
            return Verdict(Action(proposed.lateral, safe), rule)
        else:
            rule |= Rule.LANE_CHANGE
        lateral = Lateral.KEEP if fallback is None else toward(fallback.sign)
        return Verdict(Action(lateral, safe), rule)

    def others(self, scene: Scene) -> Others:
        """Return the other vehicles of a scene as the check needs them.

        On a loop each vehicle has two entries: one ahead of the ego and one behind it. A barrier,
        such as the end of a lane, is a standing vehicle of length 0.
        """
        shot, affordances = scene.snapshot, scene.affordances
        lane_m, ego_m = affordances.lane_width_m, float(shot.width_m[EGO])
        ahead_m, rows = shot.s_m[1:] - shot.s_m[EGO], np.arange(1, len(shot.ids))
        if lap_m := affordances.circumference_m:
            ahead_m = np.concatenate((ahead_m % lap_m, ahead_m % lap_m - lap_m))
            rows = np.concatenate((rows, rows))
        y_m, width_m = shot.y_m[rows], shot.width_m[rows]
        gap_m = np.abs(ahead_m) - (shot.length_m[rows] + shot.length_m[EGO]) / 2
        ends_m = lateral_extent(y_m, shot.lateral_speed_m_s[rows], width_m, lane_m)
        held = must_stay_behind(y_m, width_m, affordances.ego_y_m, ego_m, lane_m)
        facts = gap_m, ahead_m >= 0, shot.speed_m_s[rows]
        may_m = stopping_limit(*facts, self._strict, self._simulation.step_length_s)
        others = Others(*ends_m, *facts, may_m, held)
        barriers, clearance_m = affordances.barriers, self._strict.clearance_m
        return with_barriers(others, barriers, clearance_m) if barriers else others

    def fallback_is_free(self, scene: Scene) -> bool:
        """Whether the invariant holds: the ego hits no vehicle ahead in its fallback maneuver."""
        ego, speed = self._ego, scene.affordances.ego_speed_m_s
        rolled_m = float(reach(speed, -ego.hard_brake_m_s2, ego, self._simulation))
        return rolled_m < self._may_reach(scene, fallback_maneuver(scene), self.others(scene))

    def _may_reach(self, scene: Scene, fallback: LaneChange | None, neighbors: Others) -> float:
        """Return the distance, metres, within which the fallback maneuver must stop the ego."""
        ends_m = corridor(scene, fallback, self._ego, self._simulation.decision_interval_s)
        meets = overlaps_laterally(neighbors, *ends_m)
        return float(neighbors.stop_within_m[meets].min(initial=np.inf))

    def _permits(
        self, scene: Scene, change: LaneChange, neighbors: Others, how: int, reaches_m: list[float]
    ) -> bool:
        """Whether the check permits a lane change other than that of the fallback maneuver."""
        strict, sim = self._strict, self._simulation
        right_m, left_m = corridor(scene, change, self._ego, sim.decision_interval_s)
        aside_m = strict.lateral_speed_m_s * sim.decision_interval_s
        ends_m = (right_m, left_m + aside_m) if change.sign > 0 else (right_m - aside_m, left_m)
        meets = overlaps_laterally(neighbors, *ends_m)
        if not meets.any():
            return True
        if reaches_m[how] >= neighbors.stop_within_m[meets].min():
            return False
        by_number = self._ego.longitudinal_reference == "acceleration"
        slowest = how if by_number else Longitudinal.HARD_BRAKE  # IDM, ACC: at any time
        speed, acceleration = scene.affordances.ego_speed_m_s, self._accelerations[slowest]
        covered_m = [*covered(speed, acceleration, self._ego, sim), reaches_m[slowest]]
        crosses_s = self._crosses_s(scene, change)
        stays = stays_behind(neighbors, crosses_s, covered_m, strict, sim.step_length_s)
        return bool(stays[meets & ~neighbors.must_stay_behind].all())

    def _crosses_s(self, scene: Scene, change: LaneChange) -> float:
        """Return ``seconds_to_line`` for a lane change of the ego, seconds."""
        width_m, ego_m = scene.affordances.lane_width_m, float(scene.snapshot.width_m[EGO])
        line_m = (change.origin + change.target) / 2 * width_m
        to_line_m = change.sign * (line_m - scene.affordances.ego_y_m) - ego_m / 2
        return float(seconds_to_line(to_line_m, width_m, self._ego, self._simulation))


def same_or_slower(longitudinal: Longitudinal) -> tuple[Longitudinal, ...]:
    """Return the given action and all actions with a lower acceleration, fastest first."""
    return ORDER[ORDER.index(longitudinal) :]
