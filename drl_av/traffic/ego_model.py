"""Control of the ego in SUMO: either only by our commands, or by SUMO's own models."""

from typing import Any, NamedTuple

from drl_av.config import EgoConfig
from drl_av.traffic.population import EGO_ID

ALL_SPEED_CHECKS_OFF = 32
NO_AUTONOMOUS_LANE_CHANGES = 0
SPEED_CHECKS = 31
AUTONOMOUS_LANE_CHANGES = 1621
"""Bit sets for SUMO's setSpeedMode and setLaneChangeMode; the last two are SUMO's defaults."""


class EgoModel(NamedTuple):
    """Parameters of SUMO's models IDM and SL2015 for the ego; the defaults are those of SUMO."""

    headway_s: float = 1.0
    """SUMO's tau, the time gap."""
    assertiveness: float = 1.0
    """SUMO's lcAssertive; it divides the gaps that a lane change needs."""
    speed_gain: float = 1.0
    """SUMO's lcSpeedGain, the eagerness to change lanes for speed."""
    overtake_right: bool = False
    """Whether the ego may pass on the right above 60 km/h."""


def take_control(vehicle: Any, name: str) -> None:
    """Make SUMO execute our commands for a vehicle exactly and take no actions of its own.

    ``vehicle`` is the domain ``vehicle`` of libsumo or traci; ``name`` is the vehicle's id.
    """
    vehicle.setSpeedMode(name, ALL_SPEED_CHECKS_OFF)
    vehicle.setLaneChangeMode(name, NO_AUTONOMOUS_LANE_CHANGES)
    vehicle.setMaxSpeedLat(name, 10.0)


def hand_over(vehicle: Any, model: EgoModel, ego: EgoConfig, lane_width_m: float) -> None:
    """Let SUMO drive the ego from now on, within the speed and acceleration limits of ``ego``.

    SL2015 permits only emergency vehicles to pass on the right above 60 km/h. If
    ``model.overtake_right`` is true, the ego therefore becomes an emergency vehicle without a
    siren, for which other vehicles do not make way. The ego keeps its size. ``vehicle`` is the
    domain ``vehicle`` of libsumo or traci.
    """
    color, length_m, width_m = (
        read(EGO_ID) for read in (vehicle.getColor, vehicle.getLength, vehicle.getWidth)
    )
    vehicle.setType(EGO_ID, "traffic")
    vehicle.setColor(EGO_ID, color)
    vehicle.setLength(EGO_ID, length_m)
    vehicle.setWidth(EGO_ID, width_m)
    vehicle.setSpeedMode(EGO_ID, SPEED_CHECKS)
    vehicle.setLaneChangeMode(EGO_ID, AUTONOMOUS_LANE_CHANGES)
    vehicle.setMaxSpeed(EGO_ID, ego.max_speed_m_s)
    vehicle.setAccel(EGO_ID, ego.accelerate_m_s2)
    vehicle.setDecel(EGO_ID, ego.hard_brake_m_s2)
    vehicle.setEmergencyDecel(EGO_ID, ego.hard_brake_m_s2)
    vehicle.setMaxSpeedLat(EGO_ID, lane_width_m / ego.lane_change_duration_s)
    vehicle.setTau(EGO_ID, model.headway_s)
    for name, value in (("lcAssertive", model.assertiveness), ("lcSpeedGain", model.speed_gain)):
        vehicle.setParameter(EGO_ID, f"laneChangeModel.{name}", repr(value))
    if model.overtake_right:
        vehicle.setVehicleClass(EGO_ID, "emergency")
