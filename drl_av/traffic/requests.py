"""Requests of our background drivers to SUMO, which executes them as far as it finds them safe."""

import math
from collections.abc import Sequence
from typing import Any

from drl_av.config import Config, SimulationConfig
from drl_av.traffic.road import CENTERED_M
from drl_av.traffic.snapshot import EGO, TrafficCommand

LANE_CHANGES_ON_REQUEST = 1536
"""SUMO changes lanes on request only, respects the gaps, and centres the vehicle in its lane."""
LEFT_TO_SUMO = -1.0
LOOK_AHEAD_M = 200.0
"""Longer than any stopping distance."""


def leave_to_commands(vehicle: Any, name: str) -> None:
    """Make SUMO change the lane of a vehicle on request only.

    The speed mode remains SUMO's default. A request therefore never makes the vehicle faster than
    SUMO's IDM considers safe, and never exceeds the acceleration and braking of its type.
    """
    vehicle.setLaneChangeMode(name, LANE_CHANGES_ON_REQUEST)


def is_centered(vehicle: Any, name: str) -> bool:
    """Whether a vehicle is in the middle of its lane, so that a lane change may be requested.

    If another vehicle has interrupted a lane change, a new request makes SUMO continue it, even
    into that vehicle.
    """
    return bool(abs(vehicle.getLateralLanePosition(name)) <= CENTERED_M)


def ask_for_lane_changes(
    vehicle: Any,
    ids: Sequence[str],
    traffic_commands: Sequence[TrafficCommand],
    timing: SimulationConfig,
) -> None:
    """Request lane changes, valid until the next decision; SUMO completes those that it begins."""
    for row, _, side in traffic_commands:
        if side and is_centered(vehicle, ids[row]):
            vehicle.changeLaneRelative(ids[row], side, timing.decision_interval_s)


def ask_for_speeds(
    vehicle: Any,
    ids: Sequence[str],
    traffic_commands: Sequence[TrafficCommand],
    config: Config,
) -> None:
    """Request speeds for the end of the next SUMO step; SUMO brakes by itself when it must.

    The requested speed is at most ``stoppable_speed``. If the vehicle ahead brakes fully, as
    level-0 drivers do, SUMO's IDM alone would need harder braking than the vehicle has. The speeds
    of SUMO's own drivers in such traffic are therefore limited too.
    """
    step_s = config.simulation.step_length_s
    if traffic_commands or config.traffic.keep_stopping_distance:
        ours = {EGO, *(wish.row for wish in traffic_commands)}
        _hold_back(vehicle, [ids[row] for row in range(len(ids)) if row not in ours], step_s)
    for row, acceleration_m_s2, _ in traffic_commands:
        name = ids[row]
        speed, most = vehicle.getSpeed(name), stoppable_speed(vehicle, name, step_s)
        if most >= speed and yields_to_sumo(vehicle, name, speed):
            vehicle.setSpeed(name, LEFT_TO_SUMO)
        else:
            vehicle.setSpeed(name, min(most, max(0.0, speed + acceleration_m_s2 * step_s)))


def _hold_back(vehicle: Any, names: Sequence[str], step_s: float) -> None:
    for name in names:
        most = stoppable_speed(vehicle, name, step_s)
        within_reach = most < vehicle.getSpeed(name) + vehicle.getAccel(name) * step_s
        vehicle.setSpeed(name, most if within_reach else LEFT_TO_SUMO)


def stoppable_speed(vehicle: Any, name: str, step_s: float) -> float:
    """The largest speed from which a vehicle can stop behind the vehicle ahead, m/s.

    inf without a vehicle ahead. Both brake with the vehicle's own limit b in steps of h. The one
    ahead brakes at once from u, over u^2 / 2b - u h / 2. The vehicle itself drives one step at v
    first, over v^2 / 2b + v h / 2 altogether. SUMO's minimum gap remains between them.
    """
    leader = vehicle.getLeader(name, LOOK_AHEAD_M)
    if leader is None or not leader[0]:
        return math.inf
    braking, ahead = vehicle.getDecel(name), vehicle.getSpeed(leader[0])
    room_m = max(leader[1], 0.0) + max(ahead**2 / (2 * braking) - ahead * step_s / 2, 0.0)
    return float(braking * (math.sqrt(step_s**2 / 4 + 2 * room_m / braking) - step_s / 2))


def yields_to_sumo(vehicle: Any, name: str, speed: float) -> bool:
    """Whether SUMO's models must control the speed, because they wanted to be slower than it is.

    This is so when SUMO makes room for a lane change, and in an emergency, in which SUMO brakes
    harder than a request may. It lasts until SUMO brakes normally again.
    """
    if vehicle.getSpeedWithoutTraCI(name) < speed - 1e-6:
        return True
    return bool(vehicle.getAcceleration(name) < -vehicle.getDecel(name) - 1e-6)
