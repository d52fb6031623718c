"""``strict`` for many scenes at once: a twin of the check, to ask it millions of times.

Its equations are those of ``driving/strict.py``, which broadcast; only the choices among them are
written again, and a test holds both to the same answers.
"""

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.driving.actions import Lateral, Longitudinal
from drl_av.driving.strict import CENTERED_M, Others, is_held, others, reach, room
from drl_av.studies.plain_world import LENGTH_M, NONE, ROAD, SIGN, WIDTH_M, IntArray, World
from drl_av.traffic.ring import FloatArray

ORDER = np.array(
    [Longitudinal.ACCELERATE, Longitudinal.MAINTAIN, Longitudinal.BRAKE, Longitudinal.HARD_BRAKE]
)
PLACE = np.argsort(ORDER)
BoolArray = npt.NDArray[np.bool_]


class StrictAtOnce:
    """A judge of worlds."""

    def __init__(self, config: Config) -> None:
        self._config = config
        ego = config.ego
        self._rates = np.array([how.acceleration_m_s2(ego) for how in Longitudinal])

    def __call__(self, world: World, proposal: IntArray) -> IntArray:
        """The actions executed, 0 to 11."""
        sign, longitudinal = SIGN[proposal // 4], proposal % 4
        around, lane = self._others(world), _lane(world.y_m[:, 0])
        reaches = reach(world.speed_m_s[:, :1], self._rates, self._config.ego, self._config.simulation)
        out = self.way_out(world, lane)
        still = world.target == NONE
        target = np.where(
            still,
            np.where(sign == 0, NONE, lane + sign),
            np.where((sign != 0) & (sign == world.origin - world.target), world.origin, world.target),
        )
        origin = np.where(still, lane, world.origin + world.target - target)
        _, most_m = self._limits(world, out, lane, around, aside=False)
        safe = np.full(len(lane), int(Longitudinal.HARD_BRAKE))
        for how in ORDER[::-1]:
            fits = (reaches[:, how] < most_m) & (PLACE[how] >= PLACE[longitudinal])
            safe = np.where(fits, how, safe)
        least_m, most_m = self._limits(world, target, origin, around, aside=True)
        rolled_m = reaches[np.arange(len(lane)), safe]
        fits = (least_m < rolled_m) & (rolled_m < most_m)
        fits &= (target == NONE) | ((target >= 0) & (target < len(ROAD.open_lanes)))
        back = np.where(still, int(Lateral.KEEP), _toward(out, world))
        lateral = np.where(fits | (target == out), proposal // 4, back)
        result: IntArray = 4 * lateral + safe
        return result

    def way_out(self, world: World, lane: IntArray) -> IntArray:
        """The lane that the way out leads to; NONE without a lane change."""
        result: IntArray = np.where(world.target == NONE, NONE, lane)
        return result

    def free(self, world: World) -> BoolArray:
        """The invariant: whether the way out is free."""
        lane = _lane(world.y_m[:, 0])
        around = self._others(world)
        _, most_m = self._limits(world, self.way_out(world, lane), lane, around, aside=False)
        ego = self._config.ego
        reach_m = reach(world.speed_m_s[:, 0], -ego.hard_brake_m_s2, ego, self._config.simulation)
        result: BoolArray = np.asarray(reach_m) < most_m
        return result

    def _others(self, world: World) -> Others:
        width_m = np.full(world.x_m[:, 1:].shape, WIDTH_M)
        ends_m = room(world.y_m[:, 1:], world.lateral_m_s[:, 1:], width_m, ROAD.lane_width_m)
        ahead_m = world.x_m[:, 1:] - world.x_m[:, :1]
        step_s = self._config.simulation.step_length_s
        beside_m = np.full(ahead_m.shape, LENGTH_M)
        speed = world.speed_m_s[:, 1:]
        return others(ahead_m, beside_m, speed, ends_m, self._config.strict, step_s)

    def _limits(
        self, world: World, target: IntArray, origin: IntArray, around: Others, aside: bool
    ) -> tuple[FloatArray, FloatArray]:
        config, width_m, y_m = self._config, ROAD.lane_width_m, world.y_m[:, 0]
        decision_s, changing = config.simulation.decision_interval_s, target != NONE
        end_m = np.where(changing, target * width_m, y_m)
        sign = np.sign(end_m - y_m)
        stride_m = width_m / config.ego.lane_change_duration_s * decision_s
        next_m = y_m + sign * np.minimum(np.abs(end_m - y_m), stride_m)
        out = [width_m * _lane(next_m + tilt_m) for tilt_m in (-CENTERED_M, CENTERED_M)]
        places = np.stack([y_m, end_m, *(np.where(changing, place, y_m) for place in out)])
        right_m, left_m = places.min(axis=0) - WIDTH_M / 2, places.max(axis=0) + WIDTH_M / 2
        if aside:
            aside_m = config.strict.lateral_speed_m_s * decision_s
            right_m, left_m = right_m - aside_m * (sign < 0), left_m + aside_m * (sign > 0)
        met = (around.left_m > right_m[:, None]) & (around.right_m < left_m[:, None])
        sizes = np.full(world.y_m[:, 1:].shape, WIDTH_M)
        held = is_held(world.y_m[:, 1:], sizes, world.y_m[:, :1], WIDTH_M, width_m)
        return (
            np.where(met & ~held, around.least_m, -np.inf).max(axis=1),
            np.where(met, around.most_m, np.inf).min(axis=1),
        )


def _lane(y_m: FloatArray) -> IntArray:
    return np.floor(y_m / ROAD.lane_width_m + 0.5).astype(np.int64)


def _toward(lane: IntArray, world: World) -> IntArray:
    sign = np.where(lane == world.target, world.target - world.origin, world.origin - world.target)
    result: IntArray = np.where(sign > 0, int(Lateral.LEFT), int(Lateral.RIGHT))
    return result
