"""The plan of a decision, with the steering law and the car-following models, in plain Python."""

import math
from collections.abc import Iterable, Iterator

from drl_av.config import EgoConfig, MobilConfig, SimulationConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.affordances import Affordances
from drl_av.driving.car_following import Idm
from drl_av.driving.maneuver import Plan, Pose
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


def next_lane_change(change: LaneChange | None, lane: int, lateral: Lateral) -> LaneChange | None:
    """Return the lane change after a lateral action starts, continues or aborts it (Sec. IV-A).

    ``change`` is the lane change in progress, and ``lane`` the index of the ego's lane. None means
    that no lane change is in progress.
    """
    if change is None:
        return LaneChange(lane, lane + lateral.sign) if lateral.sign else None
    return change.reversed() if lateral.sign == -change.sign else change


def curvature_limit(speed_m_s: float, heading_rad: float, ego: EgoConfig) -> float:
    """Return the largest curvature that the ego can drive, 1/m.

    The steering limits it, and at high speed the largest lateral acceleration. ``speed_m_s`` is the
    speed along the lane, ``heading_rad`` the angle between the ego and the lane.
    """
    own_speed = speed_m_s / math.cos(heading_rad)
    limit, lateral = ego.max_curvature_per_m, ego.max_lateral_acceleration_m_s2
    return limit if own_speed**2 * limit <= lateral else lateral / own_speed**2


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
    bend = 6 * offset_m / left_m**2 - 4 * math.tan(heading_rad) / left_m
    limit = curvature_limit(speed_m_s, heading_rad, ego)
    wanted = road_curvature_per_m + bend * math.cos(heading_rad) ** 3
    return min(max(wanted, -limit), limit)


def steer(
    pose: Pose, target_m: float, speed_m_s: float, duration_s: float, width_m: float, ego: EgoConfig
) -> Pose:
    """Return the ego's pose after it steers to the lane centre at ``target_m`` for ``duration_s``.

    The law computes a new command every ``steering_interval_s``. The vehicle is a kinematic model:
    de_psi/dt = v (kappa - k_road), dy/dt = v sin(e_psi), v = v_ex / cos(e_psi).
    """
    steps = math.ceil(duration_s / ego.steering_interval_s - 1e-9)
    advance_m = speed_m_s * duration_s / steps
    y_m, heading = pose
    for _ in range(steps):
        off_m = target_m - y_m
        curvature = curvature_command(ROAD_CURVATURE_PER_M, off_m, heading, speed_m_s, width_m, ego)
        next_heading = heading + (curvature - ROAD_CURVATURE_PER_M) * advance_m / math.cos(heading)
        y_m += math.tan((heading + next_heading) / 2) * advance_m
        heading = next_heading
    return Pose(y_m, heading)


def settled(pose: Pose, target_m: float, speed_m_s: float, width_m: float, ego: EgoConfig) -> bool:
    """Whether the lane change has ended: the ego is near the lane's centre and parallel to it."""
    slope = SETTLED_SLOPE * (width_m / lane_change_length(speed_m_s, width_m, ego))
    is_near = abs(target_m - pose.y_m) <= SETTLED_OFFSET * width_m
    return is_near and abs(math.tan(pose.heading_rad)) <= slope


def idm_acceleration(
    speed_m_s: float, desired_m_s: float, gap_m: float, closing_m_s: float, idm: Idm | MobilConfig
) -> float:
    """Return the acceleration of the intelligent driver model (Treiber et al. 2000), m/s^2.

    ``gap_m`` is inf on a free road; ``closing_m_s`` is positive if the gap shrinks.
    """
    most = idm.acceleration_m_s2
    brakes_m = speed_m_s * closing_m_s / (2 * math.sqrt(most * idm.comfortable_braking_m_s2))
    wanted_m = idm.standstill_gap_m + max(0.0, speed_m_s * idm.headway_s + brakes_m)
    interaction = (wanted_m / max(gap_m, 0.01)) ** 2
    return most * (1 - (speed_m_s / desired_m_s) ** 4 - interaction)


def acc_acceleration(
    speed_m_s: float, desired_m_s: float, gap_m: float, closing_m_s: float, ego: EgoConfig
) -> float:
    """Return the acceleration of adaptive cruise control, m/s^2.

    It is the smaller of the speed control k (v_des - v) and the constant time-gap law. ``gap_m`` is
    inf on a free road; ``closing_m_s`` is positive if the gap shrinks.
    """
    towards_desired = ego.acc_speed_gain_per_s * (desired_m_s - speed_m_s)
    headway_s = ego.reference_headway_s
    towards_gap = time_gap_acceleration(speed_m_s, gap_m, closing_m_s, headway_s, ego)
    return min(towards_desired, towards_gap)


def time_gap_acceleration(
    speed_m_s: float, gap_m: float, closing_m_s: float, headway_s: float, ego: EgoConfig
) -> float:
    """Return the acceleration of the constant time-gap law, m/s^2, of one vehicle or of arrays.

    It is (lambda (d - d_0 - h v) - c) / h (Rajamani, Vehicle Dynamics and Control, ch. 6), with the
    gap d, the closing speed c (positive if the gap shrinks), the speed v and the time gap h. The
    standstill gap d_0 and the gain lambda, 1/s, are settings of ``ego``.
    """
    spare_m = gap_m - ego.reference_standstill_gap_m - headway_s * speed_m_s
    return (ego.acc_gap_gain_per_s * spare_m - closing_m_s) / headway_s


def reference_speeds(
    affordances: Affordances, action: Longitudinal, ego: EgoConfig, simulation: SimulationConfig
) -> Iterable[float]:
    """Return the ego's speed at the end of each SUMO step of a decision, in [0, max_speed_m_s].

    A model (IDM or ACC) computes a new acceleration at each SUMO step, and assumes that the vehicle
    ahead keeps its speed. This acceleration is limited to the range of the ego's actions. The ego
    is never faster than it would be with the constant acceleration of the same action.
    """
    if ego.longitudinal_reference == "acceleration" or action >= Longitudinal.BRAKE:
        speed, step_s = affordances.ego_speed_m_s, simulation.step_length_s
        acceleration = action.acceleration_m_s2(ego)  # the point mass, eq. 5 of the paper
        steps, most = range(1, simulation.steps_per_decision + 1), ego.max_speed_m_s
        return [min(max(speed + acceleration * step * step_s, 0.0), most) for step in steps]
    return _model_speeds(affordances, action, ego, simulation)


def _model_speeds(
    affordances: Affordances, action: Longitudinal, ego: EgoConfig, simulation: SimulationConfig
) -> Iterator[float]:
    """Yield the speeds that IDM or ACC computes; the vehicle ahead keeps its present speed."""
    speed, step_s = affordances.ego_speed_m_s, simulation.step_length_s
    desired = ego.max_speed_m_s if action is Longitudinal.ACCELERATE else speed
    front = affordances.own_front
    gap_m = math.inf if front is None else front.gap_m
    front_speed = speed if front is None else speed + front.relative_speed_m_s
    for _ in range(simulation.steps_per_decision):
        wanted = model_acceleration(speed, desired, gap_m, speed - front_speed, ego)
        acceleration = min(max(wanted, -ego.hard_brake_m_s2), ego.accelerate_m_s2)
        speed = min(max(speed + acceleration * step_s, 0.0), desired)
        gap_m = max(gap_m - (speed - front_speed) * step_s, 0.0)
        yield speed


def model_acceleration(
    speed_m_s: float, desired_m_s: float, gap_m: float, closing_m_s: float, ego: EgoConfig
) -> float:
    """Return the acceleration of the model ``ego.longitudinal_reference`` (IDM or ACC), m/s^2.

    It is 0 if the desired speed is 0: an ego that stands and maintains its speed keeps standing.
    """
    if desired_m_s <= 0.0:
        return 0.0
    if ego.longitudinal_reference == "acc":
        return acc_acceleration(speed_m_s, desired_m_s, gap_m, closing_m_s, ego)
    limits = ego.accelerate_m_s2, ego.brake_m_s2
    idm = Idm(ego.reference_headway_s, ego.reference_standstill_gap_m, *limits)
    return idm_acceleration(speed_m_s, desired_m_s, gap_m, closing_m_s, idm)


def plan(scene: Scene, action: Action, ego: EgoConfig, simulation: SimulationConfig) -> Plan:
    """Convert an action to the commands of one decision, one command for each SUMO step.

    The speed follows ``ego.longitudinal_reference``, in [0, max_speed_m_s]. The lateral position
    follows the model ``ego.lateral_plant``. With each of its two models, a lane change ends exactly
    at the lane's centre.
    """
    affordances, step_s = scene.affordances, simulation.step_length_s
    move, width_m = _PLANTS[ego.lateral_plant], affordances.lane_width_m
    change = next_lane_change(scene.lane_change, affordances.lane, action.lateral)
    y_m, lateral_m_s, commands = affordances.ego_y_m, 0.0, []
    for speed in reference_speeds(affordances, action.longitudinal, ego, simulation):
        if change is not None:
            y_m, lateral_m_s, change = move(y_m, change, speed, width_m, ego, step_s)
        commands.append(Command(speed, y_m, lateral_m_s))
    return Plan(commands, change)


Sideways = tuple[float, float, LaneChange | None]
"""The ego's lateral position and speed after a SUMO step, and the lane change in progress."""


def _kinematic(
    y_m: float, change: LaneChange, speed_m_s: float, width_m: float, ego: EgoConfig, step_s: float
) -> Sideways:
    """Move the ego at one lane width per T_LC towards the target lane (eq. 6 of the paper)."""
    target_m, rate_m_s = change.target * width_m, width_m / ego.lane_change_duration_s
    stride_m = rate_m_s * step_s
    if abs(target_m - y_m) <= stride_m + 1e-6:
        return target_m, 0.0, None
    return y_m + change.sign * stride_m, change.sign * rate_m_s, change


def _steering(
    y_m: float, change: LaneChange, speed_m_s: float, width_m: float, ego: EgoConfig, step_s: float
) -> Sideways:
    """Steer the vehicle of Sec. III of the paper; once settled it is exactly at the centre."""
    target_m, pose = change.target * width_m, Pose(y_m, change.heading_rad)
    pose = steer(pose, target_m, speed_m_s, step_s, width_m, ego)
    if settled(pose, target_m, speed_m_s, width_m, ego):
        return target_m, 0.0, None
    turned = change._replace(heading_rad=pose.heading_rad)
    return pose.y_m, speed_m_s * math.tan(pose.heading_rad), turned


_PLANTS = {"kinematic": _kinematic, "steering": _steering}
