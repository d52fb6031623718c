"""A road as plain numbers, and what compiled functions compute from them alone."""

import math
from functools import lru_cache

import numpy as np

from drl_av.compiled import borrowing, inlined
from drl_av.road.road import FloatArray, Road, RoadNumbers, allowed_by


@lru_cache(maxsize=64)
def road_numbers(road: Road) -> RoadNumbers:
    """Return a road as numbers."""
    limits = [(lane, *one) for lane, found in enumerate(road.speed_limits) for one in found]
    return RoadNumbers(
        float(road.lap_m),
        float(road.lane_width_m),
        np.array(road.open_lanes, dtype=np.bool_),
        float(road.end_m),
        float(road.exit_m),
        int(road.exit_lane),
        np.array(road.partial_lanes, dtype=np.float64).reshape(-1, 5),
        np.array(road.barriers, dtype=np.float64).reshape(-1, 3),
        np.array(limits, dtype=np.float64).reshape(-1, 4),
        np.array(road.forbidden_lines, dtype=np.float64).reshape(-1, 4),
    )


@inlined
def lane_of(y_m: float, lane_width_m: float) -> int:
    """Return the index of the lane that contains ``y_m``, as ``Road.lane_of``."""
    return math.floor(y_m / lane_width_m + 0.5)


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
    most_m_s = np.inf
    for row in range(len(limits)):
        if limits[row, 0] == lane:
            limit = limits[row, 1], limits[row, 2], limits[row, 3]
            most_m_s = min(most_m_s, allowed_by(*limit, front_m, step_s))
    return most_m_s


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
