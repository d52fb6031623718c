"""A road as plain numbers, and the geometry of ``Road`` as compiled functions of it.

``Road`` itself keeps its methods, because a command that only writes a scenario should not have to
load numba. Tests hold both forms equal.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.compiled import borrowing, inlined, squared
from drl_av.road.road import LIMIT_BRAKING_M_S2, ROUNDING, FloatArray, Road


class RoadNumbers(NamedTuple):
    """A road as numbers and arrays; the fields of ``Road`` have the same names and meanings."""

    lap_m: float
    lane_width_m: float
    open_lanes: npt.NDArray[np.bool_]
    """Shape (lanes,), rightmost lane first."""
    end_m: float
    exit_m: float
    exit_lane: int
    partial_lanes: FloatArray
    """Shape (partial lanes, 5); the columns are the fields of ``PartialLane``."""
    barriers: FloatArray
    """Shape (barriers, 3); the columns are the fields of ``Barrier``."""
    speed_limits: FloatArray
    """Shape (limits, 4): the lane, and the fields of its ``SpeedLimit``."""
    forbidden_lines: FloatArray
    """Shape (lines, 4); the columns are the fields of ``ForbiddenLine``."""


@lru_cache(maxsize=64)
def road_numbers(road: Road) -> RoadNumbers:
    """Return a road as numbers."""
    parts = [
        (part.lane, part.begin_m, part.end_m, part.joined_from_m, part.joined_to_m)
        for part in road.partial_lanes
    ]
    limits = [(lane, *one) for lane, found in enumerate(road.speed_limits) for one in found]
    return RoadNumbers(
        float(road.lap_m),
        float(road.lane_width_m),
        np.array(road.open_lanes, dtype=np.bool_),
        float(road.end_m),
        float(road.exit_m),
        int(road.exit_lane),
        np.array(parts, dtype=np.float64).reshape(-1, 5),
        np.array(road.barriers, dtype=np.float64).reshape(-1, 3),
        np.array(limits, dtype=np.float64).reshape(-1, 4),
        np.array(road.forbidden_lines, dtype=np.float64).reshape(-1, 4),
    )


@inlined
def lane_of(y_m: float, lane_width_m: float) -> int:
    """Return the index of the lane that contains ``y_m``, as ``Road.lane_of``."""
    return math.floor(y_m / lane_width_m + 0.5)


@inlined
def is_open(lane: int, road: RoadNumbers) -> bool:
    """Whether the lane exists somewhere on the road and is not barricaded."""
    return 0 <= lane < len(road.open_lanes) and bool(road.open_lanes[lane])


@borrowing
def partial_lane(lane: int, s_m: float, road: RoadNumbers) -> int:
    """Return the row of the partial lane with this index at the position ``s_m``, or -1."""
    for row in range(len(road.partial_lanes)):
        part = road.partial_lanes[row]
        if part[0] == lane and part[1] <= s_m < part[2]:
            return row
    return -1


@borrowing
def is_open_at(lane: int, s_m: float, road: RoadNumbers) -> bool:
    """Whether the lane exists at the position ``s_m`` along the road and is not barricaded."""
    if not is_open(lane, road):
        return False
    is_partial = False
    for row in range(len(road.partial_lanes)):
        is_partial = is_partial or bool(road.partial_lanes[row, 0] == lane)
    return bool(not is_partial or partial_lane(lane, s_m, road) >= 0)


@borrowing
def is_beside(lane: int, other: int, s_m: float, road: RoadNumbers) -> bool:
    """Whether a vehicle at ``s_m`` may change from ``lane`` to the adjacent lane ``other``."""
    row = partial_lane(min(lane, other), s_m, road)
    if row >= 0 and not road.partial_lanes[row, 3] <= s_m < road.partial_lanes[row, 4]:
        return False
    there: bool = is_open_at(other, s_m, road)
    return there


@borrowing
def may_cross(lane: int, side: int, from_m: float, to_m: float, road: RoadNumbers) -> bool:
    """Whether no ``ForbiddenLine`` lies on this side of the lane in a part of the road."""
    for row in range(len(road.forbidden_lines)):
        line = road.forbidden_lines[row]
        if line[0] == lane and line[1] == side and line[2] <= to_m and from_m < line[3]:
            return False
    return True


@borrowing
def allowed_speed_in(limits: FloatArray, lane: int, front_m: float, step_s: float) -> float:
    """Return ``allowed_speed`` in a lane; ``limits`` are ``RoadNumbers.speed_limits``."""
    most_m_s, slack_m_s = np.inf, LIMIT_BRAKING_M_S2 * step_s
    for row in range(len(limits)):
        left_m, limit_m_s = limits[row, 1] - front_m, limits[row, 3]
        if limits[row, 0] != lane:
            continue
        if left_m > 0.0:
            rest = squared(limit_m_s) if limit_m_s < np.inf else np.inf
            square = squared(slack_m_s) + 2 * LIMIT_BRAKING_M_S2 * left_m + rest
            most_m_s = min(most_m_s, max(limit_m_s, math.sqrt(square) - slack_m_s))
        elif front_m < limits[row, 2]:
            most_m_s = min(most_m_s, limit_m_s)
    return most_m_s


@borrowing
def lane_end_m(lane: int, s_m: float, road: RoadNumbers) -> float:
    """Return the position where the lane at position ``s_m`` ends; inf if it does not end."""
    row = partial_lane(lane, s_m, road)
    return np.inf if row < 0 else road.partial_lanes[row, 2]


@borrowing
def mandatory_change(lane: int, s_m: float, road: RoadNumbers) -> tuple[int, float]:
    """Return the fields of ``Road.mandatory_change``: lanes, left positive, and the distance."""
    end_m = lane_end_m(lane, s_m, road)
    if end_m < min(road.end_m, road.exit_m):
        return lanes_aside(lane, end_m, road), end_m - s_m
    if lane > road.exit_lane and s_m < road.exit_m < np.inf:
        return road.exit_lane - lane, road.exit_m - s_m
    return 0, np.inf


@borrowing
def lanes_aside(lane: int, end_m: float, road: RoadNumbers) -> int:
    """Return the number of lanes, left positive, from a lane that ends to one that goes on."""
    before_m = np.nextafter(end_m, -np.inf)
    for distance in range(len(road.open_lanes)):
        for lanes in (-distance, distance):
            other = lane + lanes
            if is_open_at(other, before_m, road) and lane_end_m(other, before_m, road) > end_m:
                return lanes
    return 0


@borrowing
def holds(y_m: float, width_m: float, s_m: float, road: RoadNumbers) -> bool:
    """Whether a body of this width at ``y_m`` is on open lanes only, as ``Road.holds``.

    ``s_m`` is the position of the body's front along the road.
    """
    width = road.lane_width_m
    right = math.floor((y_m - width_m / 2 + width / 2) / width + ROUNDING)
    left = math.ceil((y_m + width_m / 2 + width / 2) / width - ROUNDING) - 1
    whole, found = len(road.partial_lanes) == 0, True
    for lane in range(right, left + 1):
        if whole:
            found = found and is_open(lane, road)
        elif lane == right:
            found = is_open_at(right, s_m, road)
        else:
            found = found and is_beside(lane - 1, lane, s_m, road)
    return found


@inlined
def ahead_m(s_from_m: float, s_to_m: float, lap_m: float) -> float:
    """Return the signed distance along the road, the shorter way, as ``Road.ahead_m``."""
    return around(s_to_m - s_from_m + lap_m / 2, lap_m) - lap_m / 2


def around(x_m: float, lap_m: float) -> float:
    """Return ``x_m % lap_m``, to the bit, but without a division if ``x_m`` is within two laps."""
    if -lap_m <= x_m < 2.0 * lap_m:  # without a branch that depends on the vehicle
        from_m = x_m + lap_m if x_m < 0.0 else x_m
        return from_m - lap_m if x_m >= lap_m else from_m
    return x_m % lap_m
