"""Open roads as SUMO networks: the plan of a road, and functions that write and read it."""

import xml.etree.ElementTree as ET
from abc import abstractmethod
from dataclasses import dataclass

from drl_av.config import TrafficConfig
from drl_av.config.section import setting
from drl_av.errors import ScenarioError
from drl_av.road.road import is_open_at, is_partial, lane_end_m
from drl_av.road.snapshot import EGO_ID
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType
from drl_av.scenarios.layout import (
    Connection,
    Edge,
    Layout,
    NetworkLane,
    OpenPlan,
    Point,
    require_network,
    route_on,
    split_long_edges,
)
from drl_av.scenarios.netconvert import DEMO_END_S, PRECISION, netconvert, vehicle_element
from drl_av.scenarios.road_description import (
    LANE_WIDTH_M,
    LANES,
    SPEED_LIMIT_M_S,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    PlacedVehicle,
    RoadDescription,
    check_placed,
    check_sizes,
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

    def __post_init__(self) -> None:
        check_sizes(self)
        plan = self.plan()
        road = plan.road
        for number, vehicle in enumerate(self.vehicles):
            front_m = vehicle.position_m
            if front_m >= road.end_m or not is_open_at(vehicle.lane, front_m, road):
                raise ScenarioError(
                    f"Vehicle {vehicle.id!r} is placed on lane {vehicle.lane} at "
                    f"{vehicle.position_m:g} m, but must be on a lane that exists there."
                )
            rear_m = front_m - self.vehicle_length_m
            if rear_m < 0 or not is_open_at(vehicle.lane, rear_m, road):
                raise ScenarioError(
                    f"Vehicle {vehicle.id!r} is placed on lane {vehicle.lane} at "
                    f"{vehicle.position_m:g} m, but its rear, {self.vehicle_length_m:g} m behind, "
                    "must be on this lane, too."
                )
            check_placed(self, number, plan.start.lanes)

    @abstractmethod
    def plan(self) -> OpenPlan:
        """Return the plan of the described road: its edges, routes, lanes and start positions."""

    def speed_limit_at(self, lane: int, front_m: float) -> float:
        """Return the speed limit at a position of a lane, m/s."""
        limits = self.plan().road.speed_limits
        for begin_m, end_m, limit_m_s in limits[lane] if limits else ():
            if begin_m <= front_m < end_m:
                return limit_m_s
        return self.speed_limit_m_s

    def network_text(self) -> str:
        """Return the text of the network file, as ``RoadDescription.network_text``."""
        plan = split_long_edges(self.plan())
        roots = {name: ET.Element(f"{name}s") for name in ("node", "edge", "connection")}
        nodes: dict[Point, str] = {}
        for edge in plan.edges:
            ends = [*zip((edge.begin_m, edge.end_m), edge.drawn_aside_m, strict=True)]
            drawn = [edge.shape[0], edge.shape[-1]] if edge.shape else [(s, -y) for s, y in ends]
            for end, (x_m, y_m) in zip(ends, drawn, strict=True):
                if end not in nodes:
                    nodes[end] = f"n{len(nodes)}"
                    place = {"x": _text(x_m), "y": _text(y_m), "type": "priority"}
                    ET.SubElement(roots["node"], "node", {"id": nodes[end]} | place)
            _add_edge(roots["edge"], edge, [nodes[end] for end in ends], plan, self)
        for way in sorted(_connections(plan)):
            keys = ("from", "fromLane", "to", "toLane")
            ET.SubElement(roots["connection"], "connection", dict(zip(keys, way, strict=True)))
        return netconvert(roots)

    def read_layout(self, network: ET.Element, name: str) -> Layout:
        """Return the layout of a network file, as ``RoadDescription.read_layout``."""
        plan = split_long_edges(self.plan())
        lanes, positions = dict[str, NetworkLane](), dict[str, tuple[int, float]]()
        for edge in plan.edges:
            size = edge.id, edge.end_m - edge.begin_m, self.lane_width_m
            for index, lane in enumerate(edge.lanes):
                limit_m_s, further = _limits(edge, self)[index], edge.lane_attributes.get(lane)
                lanes[f"{edge.id}_{index}"] = NetworkLane(*size, limit_m_s, further or {})
                positions[f"{edge.id}_{index}"] = lane, edge.begin_m
        require_network(network, lanes, _connections(plan), name)
        ends_m = {edge.id: edge.end_m for edge in plan.edges}
        return Layout(plan.road, plan.routes, positions, ends_m, plan.start)

    def traffic(self) -> ET.Element:
        """Return SUMO's route file: the vehicles that the scenario places, or inflow and ego."""
        plan = split_long_edges(self.plan())
        root = ET.Element("routes")
        for name, edges in plan.routes.items():
            ET.SubElement(root, "route", id=name, edges=" ".join(edges))
        if self.vehicles:
            _place(root, self, plan)
        else:
            _let_enter(root, self, plan)
        return root


def _add_edge(
    root: ET.Element, edge: Edge, nodes: list[str], plan: OpenPlan, description: OpenDescription
) -> None:
    """Add an edge to netconvert's input; without a shape its lanes lie to the right of a line."""
    leftmost = len(plan.road.open_lanes) - 1
    line_m = -(leftmost - edge.lanes[-1]) * description.lane_width_m
    ends = zip((edge.begin_m, edge.end_m), edge.drawn_aside_m, strict=True)
    shape = edge.shape or tuple((s_m, line_m - aside_m) for s_m, aside_m in ends)
    limits = _limits(edge, description)
    element = ET.SubElement(
        root,
        "edge",
        {"id": edge.id, "from": nodes[0], "to": nodes[1]},
        numLanes=str(len(edge.lanes)),
        speed=repr(max(limits)),
        width=repr(description.lane_width_m),
        length=repr(edge.end_m - edge.begin_m),
        spreadType=edge.spread,
        shape=" ".join(f"{_text(x_m)},{_text(y_m)}" for x_m, y_m in shape),
    )
    for index, (lane, limit_m_s) in enumerate(zip(edge.lanes, limits, strict=True)):
        further = dict(edge.lane_attributes.get(lane, {}))
        if limit_m_s != max(limits):
            further["speed"] = repr(limit_m_s)
        if further:
            ET.SubElement(element, "lane", {"index": str(index)} | further)


def _limits(edge: Edge, description: OpenDescription) -> tuple[float, ...]:
    """Return the speed limit of each lane of an edge, m/s."""
    return edge.lane_limits_m_s or (description.speed_limit_m_s,) * len(edge.lanes)


def _text(value_m: float) -> str:
    """Return a coordinate as text with a fixed number of decimals."""
    return f"{value_m + 0.0:.{PRECISION}f}"


def _connections(plan: OpenPlan) -> set[Connection]:
    """Return the connections of the lanes of a road."""
    return {
        (one.id, str(lane - one.lanes[0]), other.id, str(lane - other.lanes[0]))
        for one in plan.edges
        for other in plan.edges
        if one.end_m == other.begin_m
        for lane in one.lanes
        if lane in other.lanes and lane_end_m(lane, one.begin_m, plan.road) > one.end_m
    }


def _place(root: ET.Element, description: OpenDescription, plan: OpenPlan) -> None:
    """Add the vehicles that the scenario places exactly; no others enter."""
    for vehicle in description.vehicles:
        edge = next(
            edge
            for edge in reversed(plan.edges)
            if edge.begin_m <= vehicle.position_m and vehicle.lane in edge.lanes
        )
        is_way = vehicle.id == EGO_ID or is_partial(vehicle.lane, plan.road)
        name = route_on(plan.routes, edge.id, is_way)
        vehicle_element(
            root,
            vehicle,
            description.speed_limit_m_s,
            route=name,
            departEdge=str(plan.routes[name].index(edge.id)),
            departLane=str(vehicle.lane - edge.lanes[0]),
            departPos=f"{vehicle.position_m - edge.begin_m:.2f}",
        )


def _let_enter(root: ET.Element, description: OpenDescription, plan: OpenPlan) -> None:
    """Add an inflow in each lane, and the ego, which enters later."""
    traffic, limit_m_s = TrafficConfig(), description.speed_limit_m_s
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
