"""Whom the ego may meet, and how far it may or must roll for each of them (ours).

What the check ``strict`` argues with; distances and speeds broadcast over many scenes at once.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import StrictConfig
from drl_av.safety.stopping import stopping_distance
from drl_av.traffic.road import FloatArray

LINE_M = 0.01
"""How far a body must be over a lane's line to be in that lane."""
STILL_M_S = 0.01
"""Up to this a vehicle does not move sideways."""
CENTERED_M = 0.05
"""Within this distance of a lane's centre a vehicle has arrived there."""
ON_LINE_M = 0.05
"""Within this distance of the line between two lanes a centre is in both."""


def lanes_under(y_m: Any, width_m: Any, lane_width_m: float) -> tuple[FloatArray, FloatArray]:
    """Rightmost and leftmost lane that a body is over."""
    lowest = np.floor((y_m - width_m / 2 + LINE_M) / lane_width_m + 0.5)
    return lowest, np.ceil((y_m + width_m / 2 - LINE_M) / lane_width_m - 0.5)


def lateral_extent(
    y_m: FloatArray, lateral_speed_m_s: FloatArray, width_m: FloatArray, lane_width_m: float
) -> tuple[FloatArray, FloatArray]:
    """Right and left end of where a vehicle's body may be, metres.

    It is anywhere between the centres of the lanes that its body is over and of the one it moves
    towards.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    moving = np.abs(lateral_speed_m_s) > STILL_M_S
    if moving.any():
        lane = y_m / lane_width_m
        moving &= np.abs(lane - np.round(lane)) * lane_width_m > CENTERED_M
        to_right, to_left = moving & (lateral_speed_m_s < 0), moving & (lateral_speed_m_s > 0)
        lowest = np.where(to_right, np.minimum(lowest, np.floor(lane)), lowest)
        highest = np.where(to_left, np.maximum(highest, np.ceil(lane)), highest)
    return (
        np.minimum(lowest * lane_width_m, y_m) - width_m / 2,
        np.maximum(highest * lane_width_m, y_m) + width_m / 2,
    )


def is_held(
    y_m: FloatArray, width_m: FloatArray, ego_y_m: Any, ego_width_m: float, lane_width_m: float
) -> npt.NDArray[np.bool_]:
    """Whether a vehicle behind has to stay there wherever it moves (bound 4).

    The ego's body is over the lines of all its lanes, and in its way.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    ego_lowest, ego_highest = lanes_under(ego_y_m, ego_width_m, lane_width_m)
    in_the_way = np.abs(y_m - ego_y_m) < (width_m + ego_width_m) / 2
    held: npt.NDArray[np.bool_] = in_the_way & (ego_lowest <= lowest) & (highest <= ego_highest)
    return held


class Others(NamedTuple):
    """The other vehicles as the check takes them; arrays of one shape, the last axis theirs."""

    right_m: FloatArray
    left_m: FloatArray
    """Between these their bodies may be."""
    gap_m: FloatArray
    """To the ego lengthwise; 0 or less for one beside."""
    is_ahead: npt.NDArray[np.bool_]
    speed_m_s: FloatArray
    most_m: FloatArray
    """How far the ego may reach for each: to where one ahead may come to rest.

    Infinite for one behind, and -infinite for one beside that is ahead.
    """
    is_held: npt.NDArray[np.bool_]
    """Those that, if behind, have to stay there (bound 4)."""


def may_reach(
    gap_m: FloatArray,
    is_ahead: npt.NDArray[np.bool_],
    speed_m_s: FloatArray,
    strict: StrictConfig,
    step_s: float,
) -> FloatArray:
    """``Others.most_m`` from the other three."""
    rest_m = stopping_distance(speed_m_s, strict.braking_m_s2, step_s)
    rest_m = np.where(gap_m > 0, gap_m + rest_m - strict.clearance_m, -np.inf)
    result: FloatArray = np.where(is_ahead, rest_m, np.inf)
    return result


def met(neighbors: Others, right_m: Any, left_m: Any) -> npt.NDArray[np.bool_]:
    """Which of the others may come between two lateral positions."""
    result: npt.NDArray[np.bool_] = (neighbors.left_m > right_m) & (neighbors.right_m < left_m)
    return result


def must_reach(
    neighbors: Others, delay_s: FloatArray | float, strict: StrictConfig, step_s: float
) -> FloatArray:
    """How far the ego must reach for each of the others: to where one behind may come to rest.

    It accelerates for ``delay_s`` and brakes then. -infinite for one ahead, infinite for one
    beside.
    """
    speed, acceleration = neighbors.speed_m_s, strict.acceleration_m_s2
    rolled_m, faster = speed * delay_s, speed + acceleration * delay_s
    rolled_m = rolled_m + acceleration * delay_s * (delay_s + step_s) / 2
    rolled_m = rolled_m + stopping_distance(faster, strict.follower_braking_m_s2, step_s)
    result: FloatArray = np.where(
        neighbors.gap_m <= 0,
        np.inf,
        np.where(neighbors.is_ahead, -np.inf, rolled_m - neighbors.gap_m + strict.clearance_m),
    )
    return result
