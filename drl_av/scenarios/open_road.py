"""Open roads as SUMO networks: the plan of a road, and functions that write and read it."""

import xml.etree.ElementTree as ET
from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import zip_longest
from operator import itemgetter
from typing import ClassVar

from drl_av.config.schema import setting
from drl_av.errors import ScenarioError
from drl_av.scenarios.custom_types import CustomVehicleType
from drl_av.scenarios.demo_traffic import traffic
from drl_av.scenarios.layout import Edge, Layout, OpenPlan, Point, RoadType, split_long_edges
from drl_av.scenarios.netconvert import PRECISION, netconvert
from drl_av.scenarios.road_description import (
    LANE_WIDTH_M,
    LANES,
    SPEED_LIMIT_M_S,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    PlacedVehicle,
    check_placed,
    check_sizes,
    toml_text,
)

START_M = 300.0
"""Position at which the ego starts on a highway; it is larger than the ego's sensor range."""
BEYOND_M = 250.0
"""Length of road with other vehicles beyond the end of the ego's way: the ego's sensor range."""
TOLERANCE = 1e-6


@dataclass(frozen=True)
class OpenDescription(ABC):
    """The settings that all open roads have; a subclass adds its own settings and the plan.

    Raises:
        ScenarioError: a value has a wrong type or is out of bounds, the user's vehicle types do not
            fit each other, or a placed vehicle is not on the road, too fast, or overlaps another.
    """

    lanes: int = LANES()
    lane_width_m: float = LANE_WIDTH_M()
    speed_limit_m_s: float = SPEED_LIMIT_M_S()
    vehicle_length_m: float = VEHICLE_LENGTH_M()
    vehicle_width_m: float = VEHICLE_WIDTH_M()
    flow_per_h: float = setting(
        1000.0, "ours", "inflow of each lane of the highway, vehicles per hour", low=0, high=2400
    )
    vehicles: tuple[PlacedVehicle, ...] = ()
    vehicle_types: tuple[CustomVehicleType, ...] = ()
    """The user's own vehicle types and their shares; all other vehicles have the size above."""
    limits_vary: ClassVar[bool] = False
    """Whether the speed limit may be higher on parts of the road than ``speed_limit_m_s``."""

    def __post_init__(self) -> None:
        check_sizes(self)
        plan = self.plan()
        road = plan.road
        for number, vehicle in enumerate(self.vehicles):
            if vehicle.position_m >= road.end_m or not road.is_open_at(
                vehicle.lane, vehicle.position_m
            ):
                raise ScenarioError(
                    f"Vehicle {vehicle.id!r} is placed on lane {vehicle.lane} at "
                    f"{vehicle.position_m:g} m, but must be on a lane that exists there."
                )
            rear_m = vehicle.position_m - self.vehicle_length_m
            if rear_m < 0 or not road.is_open_at(vehicle.lane, rear_m):
                raise ScenarioError(
                    f"Vehicle {vehicle.id!r} is placed on lane {vehicle.lane} at "
                    f"{vehicle.position_m:g} m, but its rear, {self.vehicle_length_m:g} m behind, "
                    "must be on this lane, too."
                )
            check_placed(self, number, plan.start.lanes)

    @abstractmethod
    def plan(self) -> OpenPlan:
        """Return the plan of the described road: its edges, routes, lanes and start positions."""

    def to_toml(self) -> str:
        """Return the fields of the description as TOML text, without the kind of scenario."""
        return toml_text(self)


def open_road_type(meaning: str, description: type[OpenDescription]) -> RoadType:
    """Return a kind of scenario with open roads; ``description`` is the class of its descriptions.

    ``meaning`` is its text in the help of the command line.
    """
    return RoadType(meaning, description, network_text, read_layout, traffic)


def network_text(description: OpenDescription) -> str:
    """Return the text of the network file of an open road.

    Raises:
        ScenarioError: netconvert refuses the road.
        SimulationError: netconvert cannot be run.
    """
    plan = split_long_edges(description.plan())
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
        _add_edge(roots["edge"], edge, [nodes[end] for end in ends], plan, description)
    for way in sorted(_connections(plan)):
        keys = ("from", "fromLane", "to", "toLane")
        ET.SubElement(roots["connection"], "connection", dict(zip(keys, way, strict=True)))
    return netconvert(roots)


def _add_edge(
    root: ET.Element, edge: Edge, nodes: list[str], plan: OpenPlan, description: OpenDescription
) -> None:
    """Add an edge to netconvert's input; without a shape its lanes lie to the right of a line."""
    leftmost = len(plan.road.open_lanes) - 1
    line_m = -(leftmost - edge.lanes[-1]) * description.lane_width_m
    ends = zip((edge.begin_m, edge.end_m), edge.drawn_aside_m, strict=True)
    shape = edge.shape or tuple((s_m, line_m - aside_m) for s_m, aside_m in ends)
    ET.SubElement(
        root,
        "edge",
        {"id": edge.id, "from": nodes[0], "to": nodes[1]},
        numLanes=str(len(edge.lanes)),
        speed=repr(_speed_limit(edge, description)),
        width=repr(description.lane_width_m),
        length=repr(edge.end_m - edge.begin_m),
        spreadType=edge.spread,
        shape=" ".join(f"{_text(x_m)},{_text(y_m)}" for x_m, y_m in shape),
    )


def _speed_limit(edge: Edge, description: OpenDescription) -> float:
    limit_m_s = edge.speed_limit_m_s
    return description.speed_limit_m_s if limit_m_s is None else limit_m_s


def _text(value_m: float) -> str:
    """Return a coordinate as text with a fixed number of decimals."""
    return f"{value_m + 0.0:.{PRECISION}f}"


def _connections(plan: OpenPlan) -> set[tuple[str, str, str, str]]:
    """Return the connections of lanes as (edge, its lane, next edge, its lane)."""
    return {
        (one.id, str(lane - one.lanes[0]), other.id, str(lane - other.lanes[0]))
        for one in plan.edges
        for other in plan.edges
        if one.end_m == other.begin_m
        for lane in one.lanes
        if lane in other.lanes and plan.road.lane_end_m(lane, one.begin_m) > one.end_m
    }


def read_layout(network: ET.Element, description: OpenDescription, name: str) -> Layout:
    """Return the layout of the network file called ``name``, with the root element ``network``.

    Raises:
        ScenarioError: the road is not the described one; the message contains ``name``.
    """
    plan = split_long_edges(description.plan())
    positions = {
        f"{edge.id}_{index}": (lane, edge.begin_m)
        for edge in plan.edges
        for index, lane in enumerate(edge.lanes)
    }
    wanted = {f"{edge.id}_{index}": edge for edge in plan.edges for index in range(len(edge.lanes))}
    reason = _difference(network, wanted, description)
    ways = {
        tuple(way.attrib.get(key, "") for key in ("from", "fromLane", "to", "toLane"))
        for way in network.iter("connection")
    }
    if reason is None and ways != _connections(plan):
        reason = "leads its lanes on otherwise than described"
    if reason is not None:
        raise ScenarioError(
            f"The road in {name} {reason}: write the scenario again with: drl-av scenario DIR."
        )
    return Layout(plan.road, plan.routes, positions, plan.start)


def _difference(
    network: ET.Element, wanted: dict[str, Edge], description: OpenDescription
) -> str | None:
    """Return how the lanes of a network differ from the described ones, or None if they do not.

    The result completes a sentence "The road ...".
    """
    lanes = [(edge, lane) for edge in network.iter("edge") for lane in edge.findall("lane")]
    places = [(e.get("id", ""), lane.get("id", ""), lane.get("index", "")) for e, lane in lanes]
    needed = [(edge.id, lane_id, lane_id.rpartition("_")[2]) for lane_id, edge in wanted.items()]
    pairs = zip_longest(sorted(places, key=itemgetter(0)), sorted(needed, key=itemgetter(0)))
    for place, need in pairs:
        if place != need:
            return f"has other lanes than described, one is {(place or need)[1]!r}"
    for _, lane in lanes:
        lane_id = lane.attrib["id"]
        edge = wanted[lane_id]
        if lane.get("allow") is not None or lane.get("disallow") is not None:
            return f"has lane {lane_id!r} for some kinds of vehicles only"
        for attribute, value in (
            ("length", edge.end_m - edge.begin_m),
            ("width", description.lane_width_m),
            ("speed", _speed_limit(edge, description)),
        ):
            try:
                number = float(lane.get(attribute, "nan"))
            except ValueError:
                number = float("nan")
            if not abs(number - value) <= TOLERANCE:
                return f"has {attribute} {lane.get(attribute)} on lane {lane_id!r}, not {value:g}"
    return None
