"""Reachability bounds of the surrounding vehicles for the check ``strict`` (ours).

The functions compute which vehicles can get in the ego's way. For each of them, they compute how
far the ego may travel (a vehicle ahead) or must travel (a vehicle behind) before it stands. They
broadcast distances and speeds, so they accept many scenes at once.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import StrictConfig
from drl_av.road.road import ARRIVED_M, Barrier, FloatArray
from drl_av.safety.stopping import stopping_distance

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
) -> npt.NDArray[np.bool_]:
    """Whether a vehicle, if it is behind the ego, must stay behind it by bound 4 of ``strict``.

    It must if the bodies overlap laterally, and the ego's body overlaps each lane that the
    vehicle's body overlaps. The result has one flag for each vehicle.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    ego_lowest, ego_highest = lanes_under(ego_y_m, ego_width_m, lane_width_m)
    in_the_way = np.abs(y_m - ego_y_m) < (width_m + ego_width_m) / 2
    held: npt.NDArray[np.bool_] = in_the_way & (ego_lowest <= lowest) & (highest <= ego_highest)
    return held


class Others(NamedTuple):
    """The other vehicles as the check needs them; arrays of one shape (..., vehicles)."""

    right_m: FloatArray
    left_m: FloatArray
    """The check assumes that each vehicle's body stays between ``right_m`` and ``left_m``."""
    gap_m: FloatArray
    """Net gap to the ego along the road; 0 or less for a vehicle beside the ego."""
    is_ahead: npt.NDArray[np.bool_]
    speed_m_s: FloatArray
    stop_within_m: FloatArray
    """Distance within which the ego must stop in order to stay behind the vehicle, metres.

    It is inf for a vehicle behind, and -inf for a vehicle beside the ego whose centre is ahead.
    """
    must_stay_behind: npt.NDArray[np.bool_]
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
    is_ahead: npt.NDArray[np.bool_],
    speed_m_s: FloatArray,
    strict: StrictConfig,
    step_s: float,
) -> FloatArray:
    """Return ``Others.stop_within_m``: the distance within which the ego must stop, metres.

    The first three arguments are fields of ``Others``; ``step_s`` is the length of a SUMO step.
    """
    rest_m = stopping_distance(speed_m_s, strict.braking_m_s2, step_s)
    rest_m = np.where(gap_m > 0, gap_m + rest_m - strict.clearance_m, -np.inf)
    result: FloatArray = np.where(is_ahead, rest_m, np.inf)
    return result


def overlaps_laterally(neighbors: Others, right_m: Any, left_m: Any) -> npt.NDArray[np.bool_]:
    """Whether each vehicle's body can overlap the lateral range from ``right_m`` to ``left_m``."""
    result: npt.NDArray[np.bool_] = (neighbors.left_m > right_m) & (neighbors.right_m < left_m)
    return result


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
    result: FloatArray = np.where(
        neighbors.gap_m <= 0,
        np.inf,
        np.where(neighbors.is_ahead, -np.inf, rolled_m - neighbors.gap_m + strict.clearance_m),
    )
    return result


def stays_behind(
    neighbors: Others,
    crosses_s: FloatArray | float,
    covered_m: Sequence[FloatArray | float],
    strict: StrictConfig,
    step_s: float,
) -> npt.NDArray[np.bool_]:
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
    result: npt.NDArray[np.bool_] = covered_m[-1] > must_m
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
