"""The steering feedback law of Sec. III, and the vehicle that it steers.

The law is kappa_cmd = f(k_road, e_yoff, e_psi, T_LC, v_ex). The paper gives its arguments, but not
f itself (it cites a lane-change controller). Our f is derived in two steps.

1. In the frame of the lane, x along it and e = y_target - y to the left, a vehicle of curvature
   kappa obeys dy/dx = tan(e_psi) and d2y/dx2 = (kappa - k_road) / cos^3(e_psi). With
   u = d2y/dx2 the path is a double integrator in x, whatever the speed.
2. Consider all paths that reach the centre of the target lane after a length l, in its direction.
   The path with the least integral of u^2 is the cubic y(s) = W (3 s^2 - 2 s^3), with the lane
   width W. The feedback that follows it is u = 6 e / l^2 - 4 tan(e_psi) / l (minimum-energy control
   of the double integrator). The offset e determines which fraction s of the lane change is done:
   3 s^2 - 2 s^3 = 1 - e / W has the closed solution s = 1/2 - sin(asin(2 e / W - 1) / 3), so
   l = (1 - s) L. The law therefore needs neither a clock nor a stored path, and an abort is the
   same law towards the other lane.

L = T_LC v_ex is the length of a whole lane change (m). It is never shorter than the largest
curvature allows: at its beginning the cubic needs the curvature 6 W / L^2.
"""

import math
from typing import NamedTuple

from drl_av.compiled import squared
from drl_av.config import EgoConfig
from drl_av.driving.actions import EgoNumbers

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


def curvature_limit(speed_m_s: float, heading_rad: float, ego: EgoConfig | EgoNumbers) -> float:
    """Return the largest curvature that the ego can drive, 1/m.

    The steering limits it, and at high speed the largest lateral acceleration. ``speed_m_s`` is the
    speed along the lane, ``heading_rad`` the angle between the ego and the lane.
    """
    own_speed = speed_m_s / math.cos(heading_rad)
    limit, lateral = ego.max_curvature_per_m, ego.max_lateral_acceleration_m_s2
    return limit if squared(own_speed) * limit <= lateral else lateral / squared(own_speed)


def lane_change_length(speed_m_s: float, lane_width_m: float, ego: EgoConfig | EgoNumbers) -> float:
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
    ego: EgoConfig | EgoNumbers,
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
    ego: EgoConfig | EgoNumbers,
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
    pose: Pose, target_m: float, speed_m_s: float, lane_width_m: float, ego: EgoConfig | EgoNumbers
) -> bool:
    """Whether the lane change has ended: the ego is near the lane's centre and parallel to it."""
    mean_slope = lane_width_m / lane_change_length(speed_m_s, lane_width_m, ego)
    return (
        abs(target_m - pose.y_m) <= SETTLED_OFFSET * lane_width_m
        and abs(math.tan(pose.heading_rad)) <= SETTLED_SLOPE * mean_slope
    )
