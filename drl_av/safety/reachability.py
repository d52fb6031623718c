"""Reachability bounds of the ego and of the vehicles around it for the check ``strict`` (ours).

The functions compute whether a vehicle can get in the ego's way, and how far the ego may travel (a
vehicle ahead) or must travel (a vehicle behind) before it stands. Each takes the numbers of one
vehicle. The last ones describe the motion of the ego in a lane change and while it brakes, and the
stopping distances: these are exact for SUMO's semi-implicit Euler integration, in which a step
moves a vehicle by the speed that it has after the step.
"""

import math
from typing import Any

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import EgoConfig, SimulationConfig, StrictConfig
from drl_av.driving.actions import EgoNumbers, acceleration_of
from drl_av.road.road import ARRIVED_M
from drl_av.road.snapshot import EGO

LINE_M = 0.01
"""A body overlaps a lane if it is at least this far over the marking of that lane."""
STILL_M_S = 0.01
"""A vehicle whose lateral speed is at most this counts as not moving sideways."""
ON_LINE_M = 0.05
"""A centre within this distance of the marking between two lanes counts as being in both."""
FASTEST_M_S = 60.0
"""Highest speed of another vehicle for which the argument of ``strict`` is proved."""


def lanes_under(y_m: Any, width_m: Any, lane_width_m: float) -> tuple[Any, Any]:
    """Return the indices of the rightmost and the leftmost lane that a body overlaps.

    The indices are floats; the function also works elementwise on arrays.
    """
    lowest = np.floor((y_m - width_m / 2 + LINE_M) / lane_width_m + 0.5)
    return lowest, np.ceil((y_m + width_m / 2 - LINE_M) / lane_width_m - 0.5)


def lateral_extent(
    y_m: float, lateral_speed_m_s: float, width_m: float, lane_width_m: float
) -> tuple[float, float]:
    """Return the right and left end of the lateral range that a vehicle's body may occupy, metres.

    Its centre may be anywhere between its present position, the centres of the lanes that the body
    overlaps, and the centre of the lane that it moves towards.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    if abs(lateral_speed_m_s) > STILL_M_S:
        lane = y_m / lane_width_m
        if abs(lane - np.rint(lane)) * lane_width_m > ARRIVED_M:
            if lateral_speed_m_s < 0:
                lowest = min(lowest, np.floor(lane))
            else:
                highest = max(highest, np.ceil(lane))
    return (
        min(lowest * lane_width_m, y_m) - width_m / 2,
        max(highest * lane_width_m, y_m) + width_m / 2,
    )


def must_stay_behind(
    y_m: float, width_m: float, ego_y_m: float, ego_width_m: float, lane_width_m: float
) -> bool:
    """Whether a vehicle, if it is behind the ego, must stay behind it by bound 4 of ``strict``.

    It must if the bodies overlap laterally, and the ego's body overlaps each lane that the
    vehicle's body overlaps.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    ego_lowest, ego_highest = lanes_under(ego_y_m, ego_width_m, lane_width_m)
    in_the_way = abs(y_m - ego_y_m) < (width_m + ego_width_m) / 2
    return bool(in_the_way and ego_lowest <= lowest and highest <= ego_highest)


def stopping_limit(
    gap_m: float, is_ahead: bool, speed_m_s: float, strict: StrictConfig, step_s: float
) -> float:
    """Return the distance within which the ego must stop to stay behind a vehicle, metres.

    ``gap_m`` is the net gap along the road, 0 or less for a vehicle beside the ego. The distance is
    inf for a vehicle behind, and -inf for a vehicle beside the ego whose centre is ahead.
    """
    if not is_ahead:
        return np.inf
    if gap_m <= 0:
        return -np.inf
    rest_m: float = stopping_distance(speed_m_s, strict.braking_m_s2, step_s)
    return gap_m + rest_m - strict.clearance_m


def required_travel(
    gap_m: float,
    is_ahead: bool,
    speed_m_s: float,
    delay_s: float,
    strict: StrictConfig,
    step_s: float,
) -> float:
    """Return the distance, metres, that the ego must travel before it stands.

    If the ego travels farther, the vehicle does not reach it from behind, even if the vehicle
    accelerates for ``delay_s`` seconds before it brakes to a standstill. The distance is -inf for a
    vehicle ahead, which requires nothing, and inf for one beside the ego, for which no distance is
    enough. ``step_s`` is the length of a SUMO step.
    """
    if gap_m <= 0:
        return np.inf
    if is_ahead:
        return -np.inf
    faster = speed_m_s + strict.acceleration_m_s2 * delay_s
    rolled_m: float = accelerated(speed_m_s, delay_s, strict, step_s)
    rolled_m = rolled_m + stopping_distance(faster, strict.follower_braking_m_s2, step_s)
    return rolled_m - gap_m + strict.clearance_m


def accelerated(speed_m_s: Any, time_s: Any, strict: StrictConfig, step_s: float) -> Any:
    """Return the distance, metres, that a vehicle covers in ``time_s`` at its largest acceleration.

    It begins with ``speed_m_s`` and accelerates with ``strict.acceleration_m_s2``.
    """
    return speed_m_s * time_s + strict.acceleration_m_s2 * time_s * (time_s + step_s) / 2


def stays_behind(
    gap_m: float,
    is_ahead: bool,
    speed_m_s: float,
    crosses_s: float,
    covered_m: Any,
    strict: StrictConfig,
    step_s: float,
) -> bool:
    """Whether a vehicle stays behind an ego that moves into its lane.

    Args:
        gap_m: Net gap to the ego along the road; 0 or less for a vehicle beside the ego.
        is_ahead: Whether the vehicle is ahead of the ego, or its centre is.
        speed_m_s: Speed of the vehicle.
        crosses_s: Time until the ego's body crosses the lane marking, seconds; 0 if the body does
            not cross it in this decision.
        covered_m: Smallest distances that the ego can cover until the end of each SUMO step of the
            decision, and as the last element until standstill.
        strict: The bounds of the other vehicles.
        step_s: Length of a SUMO step, seconds.

    Returns:
        True for a vehicle ahead, False for a vehicle beside the ego.
    """
    delay_s, steps = strict.follower_response_s + crosses_s, len(covered_m) - 1
    if not covered_m[steps] > required_travel(gap_m, is_ahead, speed_m_s, delay_s, strict, step_s):
        return False
    if is_ahead or crosses_s == 0:
        return True
    for step in range(steps):
        rolled_m = accelerated(speed_m_s, (step + 1) * step_s, strict, step_s)
        if not gap_m + covered_m[step] > rolled_m:
            return False
    return True


Ground = tuple[float, float, FloatArray, float]
"""The circumference, 0 on an open road; the lane width; the barriers, shape (barriers, 3); and the
position of the ego's front bumper, in the coordinates of the barriers. All are metres."""


def lateral_extents(
    y_m: FloatArray, lateral_speed_m_s: FloatArray, width_m: FloatArray, lane_width_m: float
) -> FloatArray:
    """Return ``lateral_extent`` of each vehicle, shape (1 + N, 2)."""
    spans_m = np.empty((len(y_m), 2))
    for row in range(1, len(y_m)):
        span_m = lateral_extent(y_m[row], lateral_speed_m_s[row], width_m[row], lane_width_m)
        spans_m[row, 0], spans_m[row, 1] = span_m
    return spans_m


def distances_ahead(s_m: FloatArray, row: int, circumference_m: float) -> tuple[float, float]:
    """Return the distances along the road from the ego to a vehicle, negative behind, metres.

    On a loop each vehicle is both ahead of the ego and behind it. On an open road both distances
    are equal.
    """
    ahead_m = s_m[row] - s_m[EGO]
    if circumference_m == 0.0:
        return ahead_m, ahead_m
    return ahead_m % circumference_m, ahead_m % circumference_m - circumference_m


def nearest_barrier(ground: Ground, ends_m: tuple[float, float], strict: StrictConfig) -> float:
    """Return the distance within which the ego must stop before the barriers in a lateral range."""
    barriers, nearest_m = ground[2], np.inf
    for row in range(len(barriers)):
        gap_m = barriers[row, 0] - ground[3]
        if gap_m >= 0.0 and barriers[row, 2] > ends_m[0] and barriers[row, 1] < ends_m[1]:
            nearest_m = min(nearest_m, gap_m - strict.clearance_m if gap_m > 0 else -np.inf)
    return nearest_m


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


Number = Any
"""A float, or an array of floats."""


def stopping_distance(speed_m_s: Number, braking_m_s2: float, step_s: float) -> Number:
    """Return the distance that a vehicle covers while it brakes to a standstill, metres.

    With the braking b and SUMO steps of length dt, it is v^2 / 2b - v dt / 2 if the speed v is a
    multiple of b dt.
    """
    steps = np.floor(speed_m_s / (braking_m_s2 * step_s))
    return step_s * steps * (speed_m_s - braking_m_s2 * step_s * (steps + 1) / 2)


def travel(
    speed_m_s: Number,
    acceleration_m_s2: Number,
    steps: int,
    step_s: float,
    max_speed_m_s: float = math.inf,
) -> tuple[Number, Number]:
    """Return the distance, metres, and the speed, m/s, of a vehicle after ``steps`` SUMO steps.

    The acceleration is constant, but the speed stays within [0, max_speed_m_s].
    """
    distance_m, speed = 0.0, speed_m_s
    for step in range(1, steps + 1):
        wanted = speed_m_s + acceleration_m_s2 * (step * step_s)
        speed = np.minimum(np.maximum(wanted, 0.0), max_speed_m_s)
        distance_m = distance_m + speed * step_s
    return distance_m, speed


def reach(
    speed_m_s: Number, acceleration_m_s2: Number, ego: EgoConfig, sim: SimulationConfig | EgoNumbers
) -> Number:
    """Return the distance that an ego covers in one decision and the hard braking after it, metres.

    ``acceleration_m_s2`` acts during the decision; the ego then brakes hard until standstill.
    """
    step_s = sim.step_length_s
    distance_m, speed = travel(
        speed_m_s, acceleration_m_s2, sim.steps_per_decision, step_s, ego.max_speed_m_s
    )
    return distance_m + stopping_distance(speed, ego.hard_brake_m_s2, step_s)


def cut_in_gap(
    speed_m_s: Number,
    acceleration_m_s2: Number,
    other_m_s: Number,
    strict: StrictConfig,
    ego: EgoConfig,
    sim: SimulationConfig,
) -> Number:
    """Return the gap, metres, above which another vehicle may begin to cut in ahead of the ego.

    With a larger gap the ego stops behind the vehicle: it drives with ``acceleration_m_s2`` for one
    decision, and then brakes hard. ``speed_m_s`` is the ego's speed, ``other_m_s`` that of the
    vehicle. If IDM or ACC controls the ego's speed, ``ego.accelerate_m_s2`` is used instead of
    ``acceleration_m_s2``, because they may accelerate so much at any time.
    """
    if ego.longitudinal_reference != "acceleration":
        acceleration_m_s2 = ego.accelerate_m_s2
    ahead_m = stopping_distance(other_m_s, strict.braking_m_s2, sim.step_length_s)
    rolled_m = reach(speed_m_s, acceleration_m_s2, ego, sim)
    return np.maximum(rolled_m - ahead_m, 0.0) + strict.clearance_m
