"""The ego in many scenes at once, compiled: the plan of its decision, and the check ``strict``."""

from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.compiled import compiled
from drl_av.config import StrictConfig
from drl_av.driving.actions import EgoNumbers
from drl_av.driving.affordances import CODES, VALUES, IntArray, indicators
from drl_av.driving.maneuver import plan_into
from drl_av.road.road import FloatArray
from drl_av.safety.strict import fallback_is_free, strict_verdicts

BoolArray = npt.NDArray[np.bool_]


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
def judge(
    world: tuple[Any, ...],
    strict: StrictConfig,
    ego: EgoNumbers,
    proposal: IntArray,
    executed: IntArray,
    free: BoolArray,
) -> None:
    """Set ``executed`` and ``free`` for each scene; ``world`` is ``World.numbers``.

    The vehicles of a World are not on a loop, so none is both ahead of the ego and behind it.
    """
    x_m, y_m, speed_m_s, lateral_m_s, length_m, width_m, lanes, road = world
    values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
    verdicts, rules = np.empty(12, np.int64), np.empty(12, np.int64)
    for row in range(len(x_m)):
        state = (x_m[row], y_m[row], speed_m_s[row], lateral_m_s[row], length_m, width_m)
        indicators(state, road, 250.0, values, codes)
        ground = (0.0, road.lane_width_m, road.barriers, x_m[row, 0] + length_m[0] / 2)
        scene = (state, codes, (lanes[row, 0], lanes[row, 1]), ground, strict, ego)
        strict_verdicts(*scene, verdicts, rules)
        executed[row] = verdicts[proposal[row]]
        free[row] = fallback_is_free(*scene)
