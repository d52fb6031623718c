"""Car-following: the ego's speed during a longitudinal action (Sec. III of the paper).

In the paper a longitudinal action is a constant acceleration, or "the reference for the throttle or
brake controller" comes from the intelligent driver model (IDM) or adaptive cruise control (ACC).
The details of the models are ours. With IDM or ACC, *accelerate* follows the model with the ego's
highest speed as the desired speed, and *maintain* with the present speed as the desired speed. On a
free road the ego therefore accelerates or keeps its speed. *Brake* and *hard brake*, which the
safety check needs, remain constant accelerations.
"""

import math
from typing import Any, NamedTuple, TypeVar

from drl_av.arrays import FloatArray
from drl_av.compiled import squared
from drl_av.config import EgoConfig, MobilConfig
from drl_av.driving.actions import ACCELERATE, BRAKE, acceleration_of
from drl_av.road.road import allowed_speed_in

Number = TypeVar("Number", float, FloatArray)


class Idm(NamedTuple):
    """Parameters of the intelligent driver model: T, s_0, a and b."""

    headway_s: float
    standstill_gap_m: float
    acceleration_m_s2: float
    comfortable_braking_m_s2: float


def idm_acceleration(
    speed_m_s: float,
    desired_m_s: float,
    gap_m: float,
    closing_m_s: float,
    config: Idm | MobilConfig,
) -> float:
    """Return the acceleration of the intelligent driver model (Treiber et al. 2000), m/s^2.

    ``gap_m`` is inf on a free road; ``closing_m_s`` is positive if the gap shrinks.
    """
    wanted_gap_m = config.standstill_gap_m + max(
        0.0,
        speed_m_s * config.headway_s
        + speed_m_s
        * closing_m_s
        / (2 * math.sqrt(config.acceleration_m_s2 * config.comfortable_braking_m_s2)),
    )
    interaction = squared(wanted_gap_m / max(gap_m, 0.01))
    free: float = 1 - (speed_m_s / desired_m_s) ** 4.0
    return config.acceleration_m_s2 * (free - interaction)


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
    speed_m_s: Number, gap_m: Number, closing_m_s: Number, headway_s: float, ego: EgoConfig
) -> Number:
    """Return the acceleration of the constant time-gap law, m/s^2, of one vehicle or of arrays.

    It is (lambda (d - d_0 - h v) - c) / h (Rajamani, Vehicle Dynamics and Control, ch. 6), with the
    gap d, the closing speed c (positive if the gap shrinks), the speed v and the time gap h. The
    standstill gap d_0 and the gain lambda, 1/s, are settings of ``ego``.
    """
    spare_m = gap_m - ego.reference_standstill_gap_m - headway_s * speed_m_s
    return (ego.acc_gap_gain_per_s * spare_m - closing_m_s) / headway_s


def keep_limits(
    speeds: Any,
    speed_m_s: float,
    limits: FloatArray,
    lane: int,
    front_m: float,
    ego: EgoConfig,
    step_s: float,
) -> None:
    """Reduce ``speeds`` to what the speed limits of a lane allow, as far as hard braking permits.

    ``limits`` are ``RoadNumbers.speed_limits``, and the ego's front is at ``front_m``. Behind a
    limit the ego accelerates no harder than ``speeds`` do.
    """
    planned_m_s = speed_m_s
    for step in range(len(speeds) if len(limits) > 0 else 0):
        allowed = allowed_speed_in(limits, lane, front_m, step_s)
        is_behind, gain_m_s = speed_m_s < planned_m_s, max(speeds[step] - planned_m_s, 0.0)
        planned_m_s = speeds[step]
        wanted = min(planned_m_s, speed_m_s + gain_m_s) if is_behind else planned_m_s
        speed_m_s = min(wanted, max(allowed, speed_m_s - ego.hard_brake_m_s2 * step_s, 0.0))
        front_m += speed_m_s * step_s
        speeds[step] = speed_m_s


def set_speeds(
    speeds: Any,
    speed_m_s: float,
    gap_m: float,
    front_m_s: float,
    action: int,
    ego: EgoConfig,
    step_s: float,
) -> None:
    """Set ``speeds`` to the ego's speed at the end of each SUMO step, in [0, max_speed_m_s].

    A model (IDM or ACC) computes a new acceleration at each SUMO step, and assumes that the vehicle
    ahead keeps its speed. This acceleration is limited to the range of the ego's actions. The ego
    is never faster than it would be with the constant acceleration of the same action.

    ``speeds`` is a list, or an array of shape (steps,). ``gap_m`` and ``front_m_s`` are the gap to
    the vehicle ahead and its speed; without such a vehicle, they are inf and the ego's speed.
    """
    if ego.has_constant_acceleration or action >= BRAKE:
        acceleration = acceleration_of(action, ego)  # the point mass, eq. 5 of the paper
        for step in range(len(speeds)):
            wanted = speed_m_s + acceleration * (step + 1) * step_s
            speeds[step] = min(max(wanted, 0.0), ego.max_speed_m_s)
        return
    desired = ego.max_speed_m_s if action == ACCELERATE else speed_m_s
    for step in range(len(speeds)):
        wanted = model_acceleration(speed_m_s, desired, gap_m, speed_m_s - front_m_s, ego)
        acceleration = min(max(wanted, -ego.hard_brake_m_s2), ego.accelerate_m_s2)
        speed_m_s = min(max(speed_m_s + acceleration * step_s, 0.0), desired)
        gap_m = max(gap_m - (speed_m_s - front_m_s) * step_s, 0.0)
        speeds[step] = speed_m_s


def model_acceleration(
    speed_m_s: float, desired_m_s: float, gap_m: float, closing_m_s: float, ego: EgoConfig
) -> float:
    """Return the acceleration of the model ``ego.longitudinal_reference`` (IDM or ACC), m/s^2.

    It is 0 if the desired speed is 0: an ego that stands and maintains its speed keeps standing.
    """
    if desired_m_s <= 0.0:
        return 0.0
    if ego.has_acc:
        return acc_acceleration(speed_m_s, desired_m_s, gap_m, closing_m_s, ego)
    idm = Idm(
        ego.reference_headway_s, ego.reference_standstill_gap_m, ego.accelerate_m_s2, ego.brake_m_s2
    )
    return idm_acceleration(speed_m_s, desired_m_s, gap_m, closing_m_s, idm)
