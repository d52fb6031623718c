"""Execution of an action: the lane change in progress, and one command for each SUMO step.

The lateral motion is kinematic, or steered by the curvature feedback of Sec. III.
"""

import math
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing, squared
from drl_av.config import EgoConfig, SimulationConfig
from drl_av.driving.actions import SIGNS, Action, EgoNumbers, Lateral, ego_numbers
from drl_av.driving.affordances import FRONT, LANE, NO_VEHICLE
from drl_av.driving.car_following import keep_limits, set_speeds
from drl_av.driving.scene import LaneChange, Scene
from drl_av.road.snapshot import Command

LEAST_LEFT = 0.1
"""Smallest value that the law uses for the remaining fraction 1 - s of a lane change (ours).

It keeps the gains finite.
"""
SETTLED_OFFSET, SETTLED_SLOPE = 0.005, 0.1
"""A lane change ends if |e| <= SETTLED_OFFSET * W and |dy/dx| <= SETTLED_SLOPE * W / L (ours)."""
ROAD_CURVATURE_PER_M = 0.0
"""k_road, the curvature of the road, 1/m; 0 because the loop represents a straight road."""


class Pose(NamedTuple):
    """The ego's lateral position and heading."""

    y_m: float
    heading_rad: float
    """e_psi: angle between the ego and the lane, left positive."""


def curvature_limit(speed_m_s: float, heading_rad: float, ego: EgoConfig) -> float:
    """Return the largest curvature that the ego can drive, 1/m.

    The steering limits it, and at high speed the largest lateral acceleration. ``speed_m_s`` is the
    speed along the lane, ``heading_rad`` the angle between the ego and the lane.
    """
    own_speed = speed_m_s / math.cos(heading_rad)
    limit, lateral = ego.max_curvature_per_m, ego.max_lateral_acceleration_m_s2
    return limit if squared(own_speed) * limit <= lateral else lateral / squared(own_speed)


def lane_change_length(speed_m_s: float, lane_width_m: float, ego: EgoConfig) -> float:
    """Return L, the length of a whole lane change along the lane, metres.

    It is the larger of T_LC v_ex and the shortest length that the curvature limit allows.
    """
    shortest_m = math.sqrt(6 * lane_width_m / curvature_limit(speed_m_s, 0.0, ego))
    return max(ego.lane_change_duration_s * speed_m_s, shortest_m)


def curvature_command(
    road_curvature_per_m: float,
    offset_m: float,
    heading_rad: float,
    speed_m_s: float,
    lane_width_m: float,
    ego: EgoConfig,
) -> float:
    """Return the curvature command kappa_cmd, 1/m, left positive, within ``curvature_limit``.

    ``offset_m`` is e_yoff, the distance from the ego to the centre of the target lane, left
    positive; ``heading_rad`` is e_psi, left positive; ``ego`` holds T_LC.
    """
    offset = min(abs(offset_m) / lane_width_m, 1.0)
    share_left = 0.5 + math.sin(math.asin(2 * offset - 1) / 3)
    left_m = max(share_left, LEAST_LEFT) * lane_change_length(speed_m_s, lane_width_m, ego)
    bend = 6 * offset_m / squared(left_m) - 4 * math.tan(heading_rad) / left_m
    limit = curvature_limit(speed_m_s, heading_rad, ego)
    wanted: float = road_curvature_per_m + bend * math.cos(heading_rad) ** 3.0
    return min(max(wanted, -limit), limit)


def steer(
    pose: Pose,
    target_m: float,
    speed_m_s: float,
    duration_s: float,
    lane_width_m: float,
    ego: EgoConfig,
) -> Pose:
    """Return the ego's pose after it steers to the lane centre at ``target_m`` for ``duration_s``.

    The law computes a new command every ``steering_interval_s``. The vehicle is a kinematic model:
    de_psi/dt = v (kappa - k_road), dy/dt = v sin(e_psi), v = v_ex / cos(e_psi).
    """
    steps = math.ceil(duration_s / ego.steering_interval_s - 1e-9)
    advance_m = speed_m_s * duration_s / steps
    y_m, heading = pose
    for _ in range(steps):
        curvature = curvature_command(
            ROAD_CURVATURE_PER_M, target_m - y_m, heading, speed_m_s, lane_width_m, ego
        )
        next_heading = heading + (curvature - ROAD_CURVATURE_PER_M) * advance_m / math.cos(heading)
        y_m += math.tan((heading + next_heading) / 2) * advance_m
        heading = next_heading
    return Pose(y_m, heading)


def settled(
    pose: Pose, target_m: float, speed_m_s: float, lane_width_m: float, ego: EgoConfig
) -> bool:
    """Whether the lane change has ended: the ego is near the lane's centre and parallel to it."""
    mean_slope = lane_width_m / lane_change_length(speed_m_s, lane_width_m, ego)
    return (
        abs(target_m - pose.y_m) <= SETTLED_OFFSET * lane_width_m
        and abs(math.tan(pose.heading_rad)) <= SETTLED_SLOPE * mean_slope
    )


class Plan(NamedTuple):
    """The commands of one decision, and the lane change in progress after it, or None."""

    commands: list[Command]
    lane_change: LaneChange | None


def aborts(lane_change: LaneChange | None, lateral: Lateral) -> bool:
    """Whether a lateral action is opposite to the lane change in progress, and so aborts it."""
    return lane_change is not None and lateral.sign == -lane_change.sign


def plan(scene: Scene, action: Action, ego: EgoConfig, simulation: SimulationConfig) -> Plan:
    """Convert an action to the commands of one decision, one command for each SUMO step.

    The speed follows ``ego.longitudinal_reference``, in [0, max_speed_m_s]. The lateral position
    follows the model ``ego.lateral_plant``. With each of its two models, a lane change ends exactly
    at the lane's centre.
    """
    return plan_with(scene, action, ego_numbers(ego, simulation))


def plan_with(scene: Scene, action: Action, ego: EgoNumbers) -> Plan:
    """Return ``plan`` with the settings as numbers."""
    values, codes, ground, _, limits = scene.indicators
    change, steps = scene.lane_change, np.empty((3, ego.steps_per_decision))
    heading_rad = 0.0 if change is None else float(change.heading_rad)
    now = values, codes, action.number, *scene.lanes, heading_rad
    origin, target, heading_rad = plan_into.fast(*now, ground[1], limits, ego, *steps)
    after = None if origin == target else LaneChange(origin, target, heading_rad)
    return Plan([*map(Command, *steps.tolist())], after)


def set_lateral(
    y_m: FloatArray,
    lateral_speed_m_s: FloatArray,
    speed_m_s: FloatArray,
    target_m: float,
    heading_rad: float,
    lane_width_m: float,
    ego: EgoNumbers,
) -> tuple[float, bool]:
    """Set the ego's lateral positions and speeds at the end of each SUMO step of a lane change.

    The arrays have the shape (steps,). ``y_m`` holds the present position when the function begins.
    ``target_m`` is the centre of the target lane. An ego that steers (Sec. III of the paper) is
    exactly there once it is settled.

    Returns:
        The ego's heading, left positive, and whether the lane change has ended.
    """
    at_m, step_s, over = y_m[0], ego.step_length_s, False
    for step in range(len(y_m)):
        speed, lateral_m_s = speed_m_s[step], 0.0
        if not over and ego.has_steering:
            pose = steer(Pose(at_m, heading_rad), target_m, speed, step_s, lane_width_m, ego)
            over = settled(pose, target_m, speed, lane_width_m, ego)
            at_m = target_m if over else pose.y_m
            heading_rad = 0.0 if over else pose.heading_rad
            lateral_m_s = speed * math.tan(heading_rad)
        elif not over:
            at_m, lateral_m_s, over = shifted(at_m, target_m, lane_width_m, ego, step_s)
        y_m[step], lateral_speed_m_s[step] = at_m, lateral_m_s
    return heading_rad, over


def shifted(
    y_m: float, target_m: float, lane_width_m: float, ego: EgoConfig, step_s: float
) -> tuple[float, float, bool]:
    """Move the ego at one lane width per T_LC towards the target lane (eq. 6 of the paper).

    Returns:
        The lateral position and speed after a SUMO step, and whether the lane change has ended.
    """
    rate_m_s = lane_width_m / ego.lane_change_duration_s
    stride_m = rate_m_s * step_s
    if abs(target_m - y_m) <= stride_m + 1e-6:
        return target_m, 0.0, True
    sign = 1 if target_m > y_m else -1
    return y_m + sign * stride_m, sign * rate_m_s, False


def next_change(origin: int, target: int, lane: int, sign: int) -> tuple[int, int]:
    """Return the lane change after a lateral action starts, continues or aborts it (Sec. IV-A).

    ``origin`` and ``target`` are the lanes of the lane change in progress, and equal if there is
    none, as in the result. ``lane`` is the ego's lane, ``sign`` the direction of the action.
    """
    if origin == target:
        return lane, lane + sign
    if sign == origin - target:
        return target, origin
    return origin, target


@borrowing
def plan_into(
    values: FloatArray,
    codes: IntArray,
    action: int,
    origin: int,
    target: int,
    heading_rad: float,
    lane_width_m: float,
    limits: FloatArray,
    ego: EgoNumbers,
    speed_m_s: FloatArray,
    y_m: FloatArray,
    lateral_speed_m_s: FloatArray,
) -> tuple[int, int, float]:
    """Compute the plan of a decision, as ``plan``, from the arrays of ``indicators``.

    ``action`` is a number from 0 to 11; ``origin`` and ``target`` are the lanes of the lane change
    in progress, equal if there is none. ``limits`` are ``RoadNumbers.speed_limits``. The function
    fills the last three arrays, shape (steps,): the ego's speed, lateral position and lateral speed
    at the end of each SUMO step.

    Returns:
        The lanes of the lane change after the decision, equal if there is none, and its heading.
    """
    speed, ahead = values[24], codes[0] != NO_VEHICLE
    gap_m, front_m_s = (values[0], speed + values[1]) if ahead else (np.inf, speed)
    set_speeds(speed_m_s, speed, gap_m, front_m_s, action % 4, ego, ego.step_length_s)
    keep_limits(speed_m_s, speed, limits, codes[LANE], values[FRONT], ego, ego.step_length_s)
    origin, target = next_change(origin, target, codes[LANE], SIGNS[action // 4])
    y_m[:], lateral_speed_m_s[:] = values[25], 0.0
    if origin == target:
        return origin, target, 0.0
    heading_rad, over = set_lateral(
        y_m, lateral_speed_m_s, speed_m_s, target * lane_width_m, heading_rad, lane_width_m, ego
    )
    return (target, target, 0.0) if over else (origin, target, heading_rad)
