"""The kind of scenario ``loop``: a closed circular highway instead of an infinite straight one."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from itertools import accumulate, pairwise

from drl_av.config.section import setting
from drl_av.errors import ScenarioError, pluralize
from drl_av.road.road import Road
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType
from drl_av.scenarios.layout import Edge, Plan, Point
from drl_av.scenarios.netconvert import DEMO_END_S, PRECISION, shape_text
from drl_av.scenarios.road_description import (
    LANE_WIDTH_M,
    LANES,
    SPEED_LIMIT_M_S,
    VEHICLE_LENGTH_M,
    VEHICLE_WIDTH_M,
    PlacedVehicle,
    RoadDescription,
    check_sizes,
)

BARRICADES_FILE = "barricades.add.xml"
INNER_RADIUS_M = 5.0
"""Smallest radius of the inner edge of the innermost lane."""
EDGES = 4
"""Number of edges of a loop."""
CHORD_M = 6.0
"""Largest length of the straight pieces that approximate the circle."""
DEMO_VEHICLES = 16
DEMO_PITCH_M = 30.0
"""Smallest distance between two demo vehicles in a lane."""
DEMO_SPEEDS_M_S = (30.0, 22.0, 26.0, 20.0, 32.0, 24.0, 28.0)
DEMO_START_SPEED_M_S = 15.0
BLOCK_M, BLOCK_PITCH_M, BLOCK_WIDTH_M = 3.0, 6.0, 0.8
PAVEMENT_COLOR = "70,70,70"
BLOCK_COLORS = ("190,190,190", "220,90,30")


@dataclass(frozen=True)
class ScenarioDescription(RoadDescription):
    """A closed loop, driven counter-clockwise on the right, so that lane 0 is the outermost lane.

    circumference_m: length of every lane of the loop, metres (ours)
    barricaded_lanes: lanes to close along the loop; 0 is the rightmost (ours)

    Raises:
        ScenarioError: a value has a wrong type or is out of bounds, the loop is too short for its
            lanes, no lane is open, or a placed vehicle is off the road, too fast or overlaps
            another one.
    """

    meaning = "a closed circular highway"
    circumference_m: float = setting(500.0, low=100, high=50_000)
    lanes: int = LANES()
    lane_width_m: float = LANE_WIDTH_M()
    speed_limit_m_s: float = SPEED_LIMIT_M_S()
    vehicle_length_m: float = VEHICLE_LENGTH_M()
    vehicle_width_m: float = VEHICLE_WIDTH_M()
    barricaded_lanes: tuple[int, ...] = ()
    vehicles: tuple[PlacedVehicle, ...] = ()
    vehicle_types: tuple[CustomVehicleType, ...] = ()
    additional_files: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_sizes(self)
        self._check_radius()
        self._check_barricades()
        self.check_vehicles()

    @property
    def open_lanes(self) -> tuple[bool, ...]:
        """One flag for each lane, rightmost first; False if it is barricaded."""
        return tuple(lane not in self.barricaded_lanes for lane in range(self.lanes))

    def _check_radius(self) -> None:
        """Raise ScenarioError if the loop is too short for its lanes."""
        least_m = 2 * math.pi * (INNER_RADIUS_M + self.lanes * self.lane_width_m / 2)
        if self.circumference_m < least_m:
            raise ScenarioError(
                f"The scenario's circumference_m is {self.circumference_m:g}, but must be at least "
                f"{math.ceil(least_m)} for {pluralize(self.lanes, 'lane')} of "
                f"{self.lane_width_m:g} m."
            )

    def _check_barricades(self) -> None:
        """Raise ScenarioError unless the barricaded lanes exist and at least one lane is open."""
        if not isinstance(self.barricaded_lanes, list | tuple) or not all(
            type(lane) is int and 0 <= lane < self.lanes for lane in self.barricaded_lanes
        ):
            raise ScenarioError(
                f"The scenario's barricaded_lanes are {self.barricaded_lanes!r}, but must be "
                f"whole numbers from 0, the rightmost lane, to {self.lanes - 1}."
            )
        object.__setattr__(self, "barricaded_lanes", tuple(sorted(set(self.barricaded_lanes))))
        if not any(self.open_lanes):
            raise ScenarioError(
                "The scenario's barricaded_lanes are all its lanes, but one must stay open."
            )

    def plan(self) -> Plan:
        """Return the plan of the loop: four equal edges; the last one absorbs the rounding."""
        radius_m = self.circumference_m / (2 * math.pi)
        pieces = math.ceil(self.circumference_m / EDGES / CHORD_M)
        length_m = round(self.circumference_m / EDGES, PRECISION)
        last_m = round(self.circumference_m - (EDGES - 1) * length_m, PRECISION)
        ends_m = [*accumulate([*[length_m] * (EDGES - 1), last_m], initial=0.0)]
        edges = tuple(
            Edge(
                f"e{i}",
                begin_m,
                end_m,
                range(self.lanes),
                lane_attributes={lane: {"disallow": "all"} for lane in self.barricaded_lanes},
                shape=tuple(point(radius_m, (i + k / pieces) / EDGES) for k in range(pieces + 1)),
                spread="center",
            )
            for i, (begin_m, end_m) in enumerate(pairwise(ends_m))
        )
        road = Road(ends_m[-1], self.lane_width_m, self.open_lanes)
        return Plan(edges, {"loop": tuple(edge.id for edge in edges)}, road)

    def traffic(self) -> ET.Element:
        """Return SUMO's route file with the demo vehicles, which drive around the loop."""
        root = self.routes_with(demo_vehicles(self))
        laps = math.ceil(DEMO_END_S * self.speed_limit_m_s / self.circumference_m) + 1
        root[0].set("repeat", str(laps))
        return root

    def additional(self) -> dict[str, ET.Element]:
        """Return {file name: root element} of the file that draws barricaded lanes, if any."""
        return {BARRICADES_FILE: _barricades(self)} if self.barricaded_lanes else {}


def point(radius_m: float, turn: float) -> Point:
    """Return a point on a circle around the origin, metres; it is rounded as in the network file.

    ``turn`` is its counter-clockwise angle as a fraction of a full turn; 0 is on the x axis.
    """
    angle = 2 * math.pi * turn
    x_m, y_m = radius_m * math.cos(angle), radius_m * math.sin(angle)
    return round(x_m, PRECISION), round(y_m, PRECISION)


def _barricades(description: ScenarioDescription) -> ET.Element:
    """Return polygons of pavement and blocks, because SUMO draws no pavement on closed lanes."""
    root = ET.Element("additional")
    circumference_m, width_m = description.circumference_m, description.lane_width_m
    blocks = math.floor(circumference_m / BLOCK_PITCH_M)
    block_turn = BLOCK_M / circumference_m
    for lane in description.barricaded_lanes:
        left_of_middle_m = (lane - (description.lanes - 1) / 2) * width_m
        radius_m = circumference_m / (2 * math.pi) - left_of_middle_m
        for k in range(blocks):
            start, name = k / blocks, f"{lane}_{k}"
            paved = _patch(radius_m, width_m, start, (k + 1) / blocks)
            block = _patch(radius_m, BLOCK_WIDTH_M, start, start + block_turn)
            _polygon(root, f"pavement_{name}", PAVEMENT_COLOR, "-1", paved)
            _polygon(root, f"barricade_{name}", BLOCK_COLORS[k % 2], "5", block)
    return root


def _patch(radius_m: float, width_m: float, start_turn: float, end_turn: float) -> str:
    """Return the corners of a piece of a lane; the turns are angles as fractions of a full turn."""
    inner_m, outer_m = radius_m - width_m / 2, radius_m + width_m / 2
    corners = ((inner_m, start_turn), (inner_m, end_turn), (outer_m, end_turn))
    closed = (*corners, (outer_m, start_turn), corners[0])
    return shape_text(point(*corner) for corner in closed)


def _polygon(root: ET.Element, name: str, color: str, layer: str, shape: str) -> None:
    """Add a polygon to a SUMO additional file; the part of ``name`` before "_" is its type."""
    kind = name.split("_")[0]
    attributes = {"id": name, "type": kind, "color": color, "fill": "1", "layer": layer}
    ET.SubElement(root, "poly", attributes, shape=shape)


def demo_vehicles(description: ScenarioDescription) -> tuple[PlacedVehicle, ...]:
    """Return the vehicles that the scenario places, or else evenly spaced demo vehicles."""
    if description.vehicles:
        return description.vehicles
    lanes = [lane for lane, is_open in enumerate(description.open_lanes) if is_open]
    most = math.floor(description.circumference_m / max(DEMO_PITCH_M, 6 * description.longest_m))
    rows = min(math.ceil(DEMO_VEHICLES / len(lanes)), max(1, most))
    pitch_m = description.circumference_m / rows
    return tuple(
        PlacedVehicle(
            id=f"vehicle{i}" if i else "ego",
            lane=lanes[i % len(lanes)],
            position_m=round((i // len(lanes) + (i % len(lanes) + 0.5) / len(lanes)) * pitch_m, 2),
            speed_m_s=min(DEMO_START_SPEED_M_S, description.speed_limit_m_s),
            desired_speed_m_s=DEMO_SPEEDS_M_S[i % len(DEMO_SPEEDS_M_S)],
        )
        for i in range(min(DEMO_VEHICLES, rows * len(lanes)))
    )
