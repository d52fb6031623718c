"""Adds a vehicle of a population to a running SUMO, and removes all vehicles from it."""

from types import ModuleType
from typing import Any

from drl_av.config import TrafficConfig
from drl_av.traffic.ego_model import NO_AUTONOMOUS_LANE_CHANGES, take_control
from drl_av.traffic.kind import Layout, route_on
from drl_av.traffic.population import EGO_ID, Population


def place(
    vehicle: Any,
    population: Population,
    row: int,
    type_id: str,
    layout: Layout,
    traffic: TrafficConfig,
) -> None:
    """Add the vehicle in this row of a population to SUMO at its position, with its parameters.

    ``vehicle`` is the domain ``vehicle`` of libsumo or traci.
    """
    name, speed = population.ids[row], float(population.speed_m_s[row])
    lane_id, position_m = _lane_and_position(layout, population.lane[row], population.front_m[row])
    is_way = name == EGO_ID or layout.road.is_partial(int(population.lane[row]))
    route = route_on(layout.routes, lane_id.rpartition("_")[0], is_way)
    vehicle.add(name, route, type_id, "now", departSpeed="0")
    if population.is_truck[row]:
        vehicle.setLength(name, traffic.truck_length_m)
        vehicle.setWidth(name, traffic.truck_width_m)
        vehicle.setShapeClass(name, "truck")
    vehicle.moveTo(name, lane_id, position_m)
    vehicle.setPreviousSpeed(name, speed)
    if name == EGO_ID:
        take_control(vehicle, name)
    else:
        vehicle.setTau(name, float(population.headway_s[row]))
        vehicle.setAccel(name, float(population.acceleration_m_s2[row]))
        gain = repr(float(population.speed_gain[row]))
        vehicle.setParameter(name, "laneChangeModel.lcSpeedGain", gain)
    vehicle.setMaxSpeed(name, float(population.desired_speed_m_s[row]))


def clear_the_road(sumo: ModuleType) -> None:
    """Remove all vehicles, so that SUMO continues as if there had never been any.

    ``sumo`` is the module libsumo or traci. The function makes two SUMO steps. In the first one
    SUMO ends all lane changes: SUMO sometimes keeps the space for the lane change of a vehicle that
    is removed, and later vehicles would brake behind this space. The second one frees the names.
    """
    for name in sumo.vehicle.getLoadedIDList():
        sumo.vehicle.setLaneChangeMode(name, NO_AUTONOMOUS_LANE_CHANGES)
    sumo.simulationStep()
    for name in sumo.vehicle.getLoadedIDList():
        sumo.vehicle.remove(name)
    sumo.simulationStep()


def _lane_and_position(layout: Layout, lane: int, front_m: float) -> tuple[str, float]:
    """Return the SUMO lane id of a position on the road, and the position on that lane, metres."""
    best = max(
        (start_m, lane_id)
        for lane_id, (index, start_m) in layout.lane_positions.items()
        if index == lane and start_m <= front_m
    )
    return best[1], float(front_m - best[0])
