"""The motion of the ego that the check ``strict`` assumes, in a lane change and while braking."""

import math

import numpy as np

from drl_av.driving.actions import EgoNumbers, acceleration_of
from drl_av.road.road import FloatArray
from drl_av.safety.reachability import LINE_M, ON_LINE_M, lanes_under
from drl_av.safety.stopping import reach, travel

ROUNDING = 1e-6
"""Largest rounding error of a computed number of SUMO steps."""


def covered(speed_m_s: float, ego: EgoNumbers) -> FloatArray:
    """Return the distances that the ego covers with each longitudinal action, metres.

    The shape is (4, steps + 1): until the end of each SUMO step of the decision, and in the last
    column until standstill, if the ego brakes hard after the decision (``reach``).
    """
    covered_m = np.empty((4, ego.steps_per_decision + 1))
    for how in range(4):
        rate = acceleration_of(how, ego)
        for steps in range(ego.steps_per_decision):
            motion = travel(speed_m_s, rate, steps + 1, ego.step_length_s, ego.max_speed_m_s)
            covered_m[how, steps] = motion[0]
        covered_m[how, -1] = reach(speed_m_s, rate, ego, ego)
    return covered_m


def fallback_lanes(origin: int, target: int, lane: int) -> tuple[int, int]:
    """Return the lanes of the fallback maneuver's lane change; they are equal if there is none.

    The arguments are the lanes of the lane change in progress, and the lane of the ego's centre.
    """
    return (target, origin) if origin != target and target != lane else (origin, target)


def corridor(
    y_m: float, ego_width_m: float, change: tuple[int, int], lane_width_m: float, ego: EgoNumbers
) -> tuple[float, float]:
    """Return the right and left end of the lateral range that the ego's body may use, metres.

    It contains the lanes that the ego's body overlaps, the rest of the lane change ``change``, and
    the fallback maneuver if the ego begins it at the next decision. ``change`` holds the lanes of
    the lane change, equal if there is none.
    """
    lowest, highest = lanes_under(y_m, ego_width_m, lane_width_m)
    right_m, left_m = min(y_m, lane_width_m * lowest), max(y_m, lane_width_m * highest)
    origin, target = change
    if origin != target:
        end_m = target * lane_width_m
        rate_m_s = lane_width_m / ego.lane_change_duration_s
        stride_m = min(abs(end_m - y_m), rate_m_s * ego.decision_interval_s)
        next_m = y_m + (1 if target > origin else -1) * stride_m
        right, left = lanes_about(next_m, lane_width_m)
        right_m = min(right_m, end_m, lane_width_m * right)
        left_m = max(left_m, end_m, lane_width_m * left)
    return right_m - ego_width_m / 2, left_m + ego_width_m / 2


def lanes_about(y_m: float, lane_width_m: float) -> tuple[int, int]:
    """Return the right and the left lane that contain a lateral position; usually they are equal.

    They differ if the position is within ``ON_LINE_M`` of the marking between two lanes.
    """
    right, left = (y_m - ON_LINE_M) / lane_width_m, (y_m + ON_LINE_M) / lane_width_m
    return math.floor(right + 0.5), math.floor(left + 0.5)


def seconds_to_line(distance_m: float, lane_width_m: float, ego: EgoNumbers) -> float:
    """Return the time, seconds, until the ego's body is over a line (a lane marking) beside it.

    ``distance_m`` is the distance from the nearer side of the body to the line; it is negative if
    that side is already beyond the line. The body is over the line when its side is more than
    ``LINE_M`` beyond it. The ego moves sideways at the speed of a lane change. The time is rounded
    up to whole SUMO steps. It is 0 if the body is already over the line, and also if it does not
    get there within this decision.
    """
    stride_m = lane_width_m / ego.lane_change_duration_s * ego.step_length_s
    steps = (distance_m + LINE_M) / stride_m
    if steps > -ROUNDING and np.ceil(steps - ROUNDING) <= ego.steps_per_decision:
        return float(np.ceil(steps + ROUNDING) * ego.step_length_s)
    return 0.0 * ego.step_length_s
