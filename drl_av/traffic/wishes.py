"""What drivers of our own ask SUMO for; it grants as much as its own models hold safe."""

from collections.abc import Sequence
from typing import Any

from drl_av.config import SimulationConfig
from drl_av.traffic.snapshot import Wish

LANE_CHANGES_ON_REQUEST = 1536
"""No wish of SUMO's own; it keeps to the gaps of others, and centres itself in its lane."""
LEFT_TO_SUMO = -1.0
CENTERED_M = 0.1


def leave_to_wishes(vehicle: Any, name: str) -> None:
    """Let SUMO begin no lane change of its own accord, and keep every wish within what is safe.

    Its speed mode stays SUMO's default: no wish brings it above the speed that SUMO's IDM holds
    safe, nor beyond the acceleration and braking of its type.
    """
    vehicle.setLaneChangeMode(name, LANE_CHANGES_ON_REQUEST)


def is_centered(vehicle: Any, name: str) -> bool:
    """Whether a lane change may be asked for.

    One that was cut short by a vehicle in its way goes on at a new request, even into that vehicle.
    """
    return bool(abs(vehicle.getLateralLanePosition(name)) <= CENTERED_M)


def ask_for_lane_changes(
    vehicle: Any, ids: Sequence[str], wishes: Sequence[Wish], timing: SimulationConfig
) -> None:
    """Wishes to change lanes stand until the next decision; one begun runs to its end."""
    for row, _, side in wishes:
        if side and is_centered(vehicle, ids[row]):
            vehicle.changeLaneRelative(ids[row], side, timing.decision_interval_s)


def ask_for_speeds(
    vehicle: Any, ids: Sequence[str], wishes: Sequence[Wish], timing: SimulationConfig
) -> None:
    """The speeds wished for at the end of the coming SUMO step, or none where SUMO must brake."""
    for row, acceleration_m_s2, _ in wishes:
        name = ids[row]
        speed = vehicle.getSpeed(name)
        if yields_to_sumo(vehicle, name, speed):
            vehicle.setSpeed(name, LEFT_TO_SUMO)
        else:
            vehicle.setSpeed(name, max(0.0, speed + acceleration_m_s2 * timing.step_length_s))


def yields_to_sumo(vehicle: Any, name: str, speed: float) -> bool:
    """Whether SUMO's models wanted to be slower after the last step than a wish let them be.

    They do to make room for a lane change, and in an emergency, in which they brake harder than a
    wish ever may; that lasts until they brake as usual again.
    """
    if vehicle.getSpeedWithoutTraCI(name) < speed - 1e-6:
        return True
    return bool(vehicle.getAcceleration(name) < -vehicle.getDecel(name) - 1e-6)
