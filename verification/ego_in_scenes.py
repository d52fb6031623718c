"""The ego in many scenes at once, compiled: what it sees and plans, and the check ``strict``."""

from typing import Any

import numpy as np

from drl_av.arrays import BoolArray, Float32Array, FloatArray, IntArray
from drl_av.compiled import compiled
from drl_av.config import StrictConfig
from drl_av.driving.actions import EgoNumbers
from drl_av.driving.affordances import CODES, VALUES, indicators
from drl_av.driving.maneuver import plan_into
from drl_av.driving.wide_observation import SLOTS_OF_A_LANE, wide_observation
from drl_av.road.road import holds
from drl_av.safety.strict import fallback_is_free, strict_verdicts


@compiled
def plan_all(
    world: tuple[Any, ...],
    ego: EgoNumbers,
    executed: IntArray,
    plans: FloatArray,
    lanes_after: IntArray,
    heading_rad: FloatArray,
) -> None:
    """Plan the ego's decision ``executed`` in each scene, as ``plan_into`` does.

    ``world`` is ``World.numbers``. The function fills ``plans``, shape (scenes, 3, steps), and
    ``lanes_after``, shape (scenes, 2), and updates ``heading_rad``, shape (scenes,).
    """
    x_m, y_m, speed_m_s, lateral_m_s, length_m, width_m, lanes, road = world
    values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
    for row in range(len(x_m)):
        state = (x_m[row], y_m[row], speed_m_s[row], lateral_m_s[row], length_m, width_m)
        indicators(state, road, 250.0, values, codes)
        begun = (lanes[row, 0], lanes[row, 1], heading_rad[row])
        ground = (road.lane_width_m, road.speed_limits)
        into = (plans[row, 0], plans[row, 1], plans[row, 2])
        lanes_after[row, 0], lanes_after[row, 1], heading_rad[row] = plan_into(
            values, codes, executed[row], *begun, *ground, ego, *into
        )


@compiled
def leave_road(world: tuple[Any, ...], leaves: BoolArray) -> None:
    """Set for each scene whether the ego's body is not on open lanes only, shape (scenes,).

    ``world`` is ``World.numbers``.
    """
    x_m, y_m, _, _, length_m, width_m, _, road = world
    for row in range(len(x_m)):
        leaves[row] = not holds(y_m[row, 0], width_m[0], x_m[row, 0] + length_m[0] / 2, road)


@compiled
def judge(
    world: tuple[Any, ...],
    strict: StrictConfig,
    ego: EgoNumbers,
    executed: IntArray,
    free: BoolArray,
) -> None:
    """Set the verdicts on all actions and whether the fallback maneuver is free, for each scene.

    ``world`` is ``World.numbers``; ``executed`` has the shape (scenes, 12), ``free`` (scenes,).
    The vehicles of a World are not on a loop, so none is both ahead of the ego and behind it.
    """
    x_m, y_m, speed_m_s, lateral_m_s, length_m, width_m, lanes, road = world
    values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
    rules = np.empty(12, np.int64)
    for row in range(len(x_m)):
        state = (x_m[row], y_m[row], speed_m_s[row], lateral_m_s[row], length_m, width_m)
        indicators(state, road, 250.0, values, codes)
        ground = (0.0, road.lane_width_m, road.barriers, x_m[row, 0] + length_m[0] / 2)
        scene = (state, codes, (lanes[row, 0], lanes[row, 1]), ground, strict, ego)
        strict_verdicts(*scene, executed[row], rules)
        free[row] = fallback_is_free(*scene)


@compiled
def look(
    world: tuple[Any, ...],
    range_m: float,
    max_speed_m_s: float,
    observation: Float32Array,
) -> None:
    """Fill ``observation``, shape (scenes, WIDE_SIZE), with the wide observation of each scene.

    ``world`` is ``World.numbers``, the others are the arguments of ``wide_observation``.
    """
    x_m, y_m, speed_m_s, lateral_m_s, length_m, width_m, lanes, road = world
    gaps_m, rows = np.empty((5, SLOTS_OF_A_LANE)), np.empty((5, SLOTS_OF_A_LANE), np.int64)
    for row in range(len(x_m)):
        state = (x_m[row], y_m[row], speed_m_s[row], lateral_m_s[row], length_m, width_m)
        seen = (lanes[row, 0], lanes[row, 1], observation[row], gaps_m, rows)
        wide_observation(state, road, range_m, max_speed_m_s, *seen)
