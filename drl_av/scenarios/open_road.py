"""The description of an open road, and its demo traffic."""

import xml.etree.ElementTree as ET
from abc import abstractmethod
from dataclasses import dataclass

from drl_av.config import TrafficConfig
from drl_av.config.section import setting
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType
from drl_av.scenarios.layout import OpenPlan
from drl_av.scenarios.netconvert import DEMO_END_S
from drl_av.scenarios.road_description import (
    LANE_WIDTH_M,
    LANES,
    SPEED_LIMIT_M_S,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    PlacedVehicle,
    RoadDescription,
)

START_M = 300.0
"""Position at which the ego starts on a highway; it is larger than the ego's sensor range."""
BEYOND_M = 305.0
"""Length of road with other vehicles beyond the end of the ego's way: 250 m, its sensor range;
30 m, its way in the last decision; and 25 m, half of the two bodies together at most."""
EGO_DEPARTS_S = 60
"""Time at which the ego enters in the demo traffic, if the other vehicles come as an inflow."""


@dataclass(frozen=True)
class OpenDescription(RoadDescription):
    """The settings that all open roads have; a subclass adds its own settings and the plan.

    flow_per_h: inflow of each lane of the highway, vehicles per hour (ours)

    Raises:
        ScenarioError: a value has a wrong type or is out of bounds, the user's vehicle types do not
            fit each other, or a placed vehicle is not on the road, too fast, or overlaps another.
    """

    lanes: int = LANES()
    lane_width_m: float = LANE_WIDTH_M()
    speed_limit_m_s: float = SPEED_LIMIT_M_S()
    vehicle_length_m: float = VEHICLE_LENGTH_M()
    vehicle_width_m: float = VEHICLE_WIDTH_M()
    flow_per_h: float = setting(1000.0, low=0, high=2400)
    vehicles: tuple[PlacedVehicle, ...] = ()
    vehicle_types: tuple[CustomVehicleType, ...] = ()
    additional_files: tuple[str, ...] = ()

    @abstractmethod
    def plan(self) -> OpenPlan:
        """Return the plan of the described road: its edges, routes, lanes and start positions."""

    def traffic(self) -> ET.Element:
        """Return SUMO's route file: the vehicles that the scenario places, or inflow and ego."""
        root = self.routes_with(self.vehicles)
        if not self.vehicles:
            _let_enter(root, self)
        return root


def _let_enter(root: ET.Element, description: OpenDescription) -> None:
    """Add an inflow in each lane, and the ego, which enters later."""
    plan, traffic, limit_m_s = description.plan(), TrafficConfig(), description.speed_limit_m_s
    desired_m_s = (traffic.desired_speed_min_m_s + traffic.desired_speed_max_m_s) / 2
    first, *_, last = [*plan.routes, *plan.routes]
    lanes = {edge.id: edge.lanes for edge in plan.edges}
    entry, ego_entry = (lanes[plan.routes[name][0]] for name in (first, last))
    for lane in plan.start.lanes if description.flow_per_h else ():
        ET.SubElement(
            root,
            "flow",
            id=f"flow{lane}",
            type="traffic",
            route=first,
            begin="0",
            end=str(DEMO_END_S),
            vehsPerHour=repr(description.flow_per_h),
            departLane=str(lane - entry[0]),
            departSpeed="max",
            speedFactor=f"{min(desired_m_s / limit_m_s, 1.0):.4f}",
        )
    ET.SubElement(
        root,
        "vehicle",
        id="ego",
        type="ego",
        route=last,
        depart=str(EGO_DEPARTS_S),
        departLane=str((plan.start.ego_lane or ego_entry[0]) - ego_entry[0]),
        departSpeed=repr(min(plan.start.ego_speed_m_s or 20.0, description.speed_limit_m_s)),
    )
