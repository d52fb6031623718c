"""Requests of our background drivers to SUMO, which executes them only as far as they are safe."""

import math
from collections.abc import Sequence
from typing import Any

from drl_av.config import Config, SimulationConfig
from drl_av.traffic.road import CENTERED_M
from drl_av.traffic.snapshot import EGO, TrafficCommand

LANE_CHANGES_ON_REQUEST = 1536
"""SUMO's lane change mode: change lanes on request only, if the gaps are safe, and keep centred."""
LEFT_TO_SUMO = -1.0
"""The argument of ``setSpeed`` that returns the control of the speed to SUMO."""
LOOK_AHEAD_M = 200.0
"""Range in which SUMO looks for a vehicle ahead; longer than any stopping distance."""


def leave_to_commands(vehicle: Any, name: str) -> None:
    """Make SUMO change the lane of the vehicle ``name`` on request only.

    ``vehicle`` is the domain ``vehicle`` of libsumo or traci. The speed mode remains SUMO's
    default: a request never makes the vehicle faster than SUMO's IDM considers safe, and never
    exceeds the acceleration and braking of its type.
    """
    vehicle.setLaneChangeMode(name, LANE_CHANGES_ON_REQUEST)


def is_centered(vehicle: Any, name: str) -> bool:
    """Whether the vehicle ``name`` is so near its lane's centre that it may request a lane change.

    If the vehicle is away from the centre, another vehicle may have interrupted its lane change. A
    new request would make SUMO continue it, even into that other vehicle.
    """
    return bool(abs(vehicle.getLateralLanePosition(name)) <= CENTERED_M)


def ask_for_lane_changes(
    vehicle: Any,
    ids: Sequence[str],
    traffic_commands: Sequence[TrafficCommand],
    timing: SimulationConfig,
) -> None:
    """Request the lane changes of ``traffic_commands``, valid until the next decision.

    SUMO completes each lane change that it has begun. ``vehicle`` is the domain ``vehicle`` of
    libsumo or traci; ``ids`` holds the SUMO id of the vehicle in each row of the snapshot.
    """
    for row, _, side in traffic_commands:
        if side and is_centered(vehicle, ids[row]):
            vehicle.changeLaneRelative(ids[row], side, timing.decision_interval_s)


def ask_for_speeds(
    vehicle: Any,
    ids: Sequence[str],
    traffic_commands: Sequence[TrafficCommand],
    config: Config,
) -> None:
    """Request the speeds of ``traffic_commands`` for the end of the next SUMO step.

    Each requested speed is at most ``stoppable_speed``, because SUMO's IDM brakes too late behind a
    vehicle that brakes fully, as level-0 drivers do. This limit also applies to the vehicles that
    SUMO drives. SUMO may still brake harder than requested.
    """
    step_s, ours = config.simulation.step_length_s, {EGO, *(wish.row for wish in traffic_commands)}
    _limit_speeds(vehicle, [ids[row] for row in range(len(ids)) if row not in ours], step_s)
    for row, acceleration_m_s2, _ in traffic_commands:
        name = ids[row]
        speed, most = vehicle.getSpeed(name), stoppable_speed(vehicle, name, step_s)
        if most >= speed and yields_to_sumo(vehicle, name, speed):
            vehicle.setSpeed(name, LEFT_TO_SUMO)
        else:
            vehicle.setSpeed(name, min(most, max(0.0, speed + acceleration_m_s2 * step_s)))


def _limit_speeds(vehicle: Any, names: Sequence[str], step_s: float) -> None:
    """Limit the speed of SUMO-driven vehicles to ``stoppable_speed`` for the next SUMO step."""
    for name in names:
        most = stoppable_speed(vehicle, name, step_s)
        within_reach = most < vehicle.getSpeed(name) + vehicle.getAccel(name) * step_s
        vehicle.setSpeed(name, most if within_reach else LEFT_TO_SUMO)


def stoppable_speed(vehicle: Any, name: str, step_s: float) -> float:
    """Return the largest speed, m/s, from which a vehicle can stop behind the vehicle ahead.

    It is inf without a vehicle ahead. ``vehicle`` is the domain of libsumo or TraCI, ``name`` the
    vehicle's id, and h is ``step_s``. The formula is ours: both vehicles brake with b, the limit of
    the vehicle behind. The vehicle ahead brakes at once from speed u and covers u^2 / 2b - u h / 2.
    The vehicle behind first drives one step at speed v and covers v^2 / 2b + v h / 2 in all. When
    both stand, SUMO's minimum gap is left between them.
    """
    leader = vehicle.getLeader(name, LOOK_AHEAD_M)
    if leader is None or not leader[0]:
        return math.inf
    braking, ahead = vehicle.getDecel(name), vehicle.getSpeed(leader[0])
    room_m = max(leader[1], 0.0) + max(ahead**2 / (2 * braking) - ahead * step_s / 2, 0.0)
    return float(braking * (math.sqrt(step_s**2 / 4 + 2 * room_m / braking) - step_s / 2))


def yields_to_sumo(vehicle: Any, name: str, speed: float) -> bool:
    """Whether SUMO must keep control of the speed, because its models brake the vehicle themselves.

    SUMO does so to make room for a lane change, and in an emergency, in which it brakes harder than
    a request may. SUMO keeps control until it brakes normally again. ``speed`` is the present
    speed, m/s.
    """
    if vehicle.getSpeedWithoutTraCI(name) < speed - 1e-6:
        return True
    return bool(vehicle.getAcceleration(name) < -vehicle.getDecel(name) - 1e-6)
