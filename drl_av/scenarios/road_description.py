"""The description of a scenario: the road, its lanes, and the vehicles that it places exactly."""

import operator
import re
import xml.etree.ElementTree as ET
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable
from dataclasses import Field, asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self

import tomli_w

from drl_av.config.section import check_fields, setting
from drl_av.errors import ScenarioError, pluralize
from drl_av.road.road import Road, is_open_at, is_partial
from drl_av.road.snapshot import EGO_ID
from drl_av.road.vehicle_types import LENGTHS_M, WIDTHS_M
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType, check_custom_types
from drl_av.scenarios.layout import (
    Layout,
    NetworkLane,
    Plan,
    connections,
    require_network,
    route_on,
    split_long_edges,
)
from drl_av.scenarios.netconvert import network_text

LANES = partial(setting, 3, low=1, high=10)
LANE_WIDTH_M = partial(setting, 3.8, low=2, high=10)
SPEED_LIMIT_M_S = partial(setting, 40.0, low=1, high=100)
VEHICLE_LENGTH_M = partial(setting, 5.0, low=LENGTHS_M[0], high=LENGTHS_M[1])
VEHICLE_WIDTH_M = partial(setting, 1.8, low=WIDTHS_M[0], high=WIDTHS_M[1])
"""Fields of the descriptions of all kinds of roads; ``RoadDescription`` says what they are."""
MOST_VEHICLES = 3000
"""Largest number of vehicles, with the ego, that start on an open road or that a scenario places.
The time of a SUMO step grows with the square of the number of vehicles in a lane, because the
sublane model looks for followers among all of them."""
TYPES, FILES = "vehicle_types", "additional_files"
REQUIRED = ("id", "share", "length_m", "width_m", "car_following_model")
"""The keys of a vehicle type that a description always states."""
VEHICLE_NAME = re.compile(r"[A-Za-z0-9_-]+")
TimedChange = tuple[float, int]
"""The time since the start of the episode, seconds, and the lane to which the vehicle changes."""
LATEST_S = 86_400.0


@dataclass(frozen=True)
class PlacedVehicle:
    """A vehicle that starts at an exact position; the vehicle with the id "ego" is the ego.

    Raises:
        ScenarioError: a value has a wrong type or is out of bounds.
    """

    id: str
    lane: int = field(metadata={"low": 0, "high": 9})
    """Index of the lane; 0 is the rightmost."""
    position_m: float = field(metadata={"low": 0, "high": 50_000})
    """Position of the front bumper along the road, metres."""
    speed_m_s: float = field(metadata={"low": 0, "high": 100})
    """Speed at the start, at most the scenario's speed limit, and for the ego also at most
    ``ego.max_speed_m_s``. In SUMO without drl-av it is also at most the desired speed."""
    desired_speed_m_s: float = field(metadata={"low": 0.1, "high": 100})
    """Speed on a free road, from 0.1 to 100 m/s. For the ego it has no effect in drl-av."""
    lane_changes: tuple[TimedChange, ...] = ()
    """Pairs (time in seconds since the start, index of an adjacent lane); none for the ego. At this
    time the vehicle requests the lane change. SUMO executes it as soon as it considers it safe, and
    drops the request after 5 s. SUMO without drl-av ignores the pairs."""

    def __post_init__(self) -> None:
        if not isinstance(self.id, str) or not VEHICLE_NAME.fullmatch(self.id):
            raise ScenarioError(
                f"A vehicle's id is {self.id!r}, but must be made of letters, digits, - and _."
            )
        check_fields(self, f"Vehicle {self.id!r}: ", ScenarioError)
        changes = read_changes(self.lane_changes, self.id, self.lane)
        object.__setattr__(self, "lane_changes", changes)


class RoadDescription(ABC):
    """What the descriptions of all kinds of roads have: frozen dataclasses with these fields.

    lanes: number of lanes (ours)
    lane_width_m: width of a lane, metres (Sec. IV-C: y_des is 3.8 m in the centre lane)
    speed_limit_m_s: speed limit, m/s (ours)
    vehicle_length_m: length of a vehicle, metres (ours)
    vehicle_width_m: width of a vehicle, metres (ours)
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    lanes: int
    lane_width_m: float
    speed_limit_m_s: float
    """The speed limit of the road, or the lowest one if it varies."""
    vehicle_length_m: float
    vehicle_width_m: float
    vehicles: tuple[PlacedVehicle, ...]
    vehicle_types: tuple[CustomVehicleType, ...]
    """The user's own vehicle types and their shares; all other vehicles have the size above."""
    additional_files: tuple[str, ...]
    """Paths of SUMO's additional files that are the user's own, such as detectors."""
    meaning: ClassVar[str]
    """What the kind of scenario is, in the help of the command line."""

    def __post_init__(self) -> None:
        check_sizes(self)
        self.check_vehicles()

    @abstractmethod
    def plan(self) -> Plan:
        """Return the plan of the described road: its edges, routes and lanes."""

    def check_vehicles(self) -> None:
        """Raise ScenarioError if a placed vehicle is off the road or too fast, or two overlap."""
        road = self.plan().road
        end_m = min(road.end_m, road.lap_m)
        for number, vehicle in enumerate(self.vehicles):
            front_m, rear_m = vehicle.position_m, vehicle.position_m - self.vehicle_length_m
            what = f"Vehicle {vehicle.id!r} is placed on lane {vehicle.lane} at {front_m:g} m, but"
            if front_m >= end_m or not is_open_at(vehicle.lane, front_m, road):
                raise ScenarioError(f"{what} must be on a lane open there, before {end_m:g} m.")
            if (rear_m < 0 and not road.is_loop) or not is_open_at(vehicle.lane, rear_m, road):
                length = f"{self.vehicle_length_m:g} m"
                raise ScenarioError(f"{what} its rear, {length} behind, must be on it too.")
            check_placed(self, number, road)

    def network_text(self) -> str:
        """Return the text of the network file.

        Raises:
            ScenarioError: netconvert refuses the description.
            SimulationError: netconvert cannot be run.
        """
        return network_text(self.plan(), self.speed_limit_m_s)

    def read_layout(self, network: ET.Element, name: str) -> Layout:
        """Return the layout of a network; ``network`` is the root element of the file ``name``.

        Raises:
            ScenarioError: the road differs from the described one; the message contains ``name``.
        """
        plan = split_long_edges(self.plan())
        lanes, positions = dict[str, NetworkLane](), dict[str, tuple[int, float]]()
        for edge in plan.edges:
            size = edge.id, edge.end_m - edge.begin_m, self.lane_width_m
            limits = edge.limits(self.speed_limit_m_s)
            for index, (lane, limit_m_s) in enumerate(zip(edge.lanes, limits, strict=True)):
                further = edge.lane_attributes.get(lane, {})
                lanes[f"{edge.id}_{index}"] = NetworkLane(*size, limit_m_s, further)
                positions[f"{edge.id}_{index}"] = lane, edge.begin_m
        require_network(network, lanes, connections(plan), name)
        ends_m = {edge.id: edge.end_m for edge in plan.edges}
        return Layout(plan.road, plan.routes, positions, ends_m, plan.start)

    @abstractmethod
    def traffic(self) -> ET.Element:
        """Return SUMO's route file with the demo traffic, for SUMO alone."""

    def routes_with(self, vehicles: Iterable[PlacedVehicle]) -> ET.Element:
        """Return SUMO's route file with the routes of the road and vehicles at their places.

        A vehicle departs at most at its desired speed, because SUMO alone refuses vehicles that
        depart faster.
        """
        plan = split_long_edges(self.plan())
        root = ET.Element("routes")
        for name, edges in plan.routes.items():
            ET.SubElement(root, "route", id=name, edges=" ".join(edges))
        for vehicle in vehicles:
            edge = next(
                edge
                for edge in reversed(plan.edges)
                if edge.begin_m <= vehicle.position_m and vehicle.lane in edge.lanes
            )
            is_ego = vehicle.id == EGO_ID
            name = route_on(plan.routes, edge.id, is_ego or is_partial(vehicle.lane, plan.road))
            ET.SubElement(
                root,
                "vehicle",
                id=vehicle.id,
                type="ego" if is_ego else "traffic",
                route=name,
                depart="0",
                departEdge=str(plan.routes[name].index(edge.id)),
                departLane=str(vehicle.lane - edge.lanes[0]),
                departPos=f"{vehicle.position_m - edge.begin_m:.2f}",
                departSpeed=f"{min(vehicle.speed_m_s, vehicle.desired_speed_m_s):.2f}",
                speedFactor=f"{min(vehicle.desired_speed_m_s / self.speed_limit_m_s, 1.0):.4f}",
                insertionChecks="none",
            )
        return root

    def additional(self) -> dict[str, ET.Element]:
        """Return {file name: root element} of more files that SUMO loads before its vehicles."""
        return {}

    def updated(self, **given: Any) -> Self:
        """Return the description with other settings."""
        return replace(self, **given)

    def to_toml(self) -> str:
        """Return the description as TOML text, without its kind; ``from_toml`` reads it back."""
        return toml_text(self)

    @property
    def longest_m(self) -> float:
        """The length of the longest vehicle, metres."""
        return max([self.vehicle_length_m, *(each.length_m for each in self.vehicle_types)])

    @property
    def summary(self) -> str:
        """What was made of the user's own files, in a few lines; "" if there are none."""
        return ""


def toml_text(description: RoadDescription, **changed: Any) -> str:
    """Return a description as TOML text, without its kind.

    The keys of the user's own vehicle types and files and of a vehicle's lane changes are left out
    if there are none. ``changed`` replaces the values of some keys.
    """
    given = [item.name for item in fields(description) if item.init]
    values = {key: value for key, value in asdict(description).items() if key in given} | changed
    values[FILES] = [Path(path).name for path in description.additional_files]
    for vehicle in values["vehicles"]:
        if not vehicle["lane_changes"]:
            del vehicle["lane_changes"]
    usual = CustomVehicleType("usual", 0.0, LENGTHS_M[0], WIDTHS_M[0])
    values[TYPES] = [
        {key: value for key, value in kind.items() if key in REQUIRED or value != vars(usual)[key]}
        for kind in values[TYPES]
    ]
    return tomli_w.dumps(
        {key: value for key, value in values.items() if value or key not in (TYPES, FILES)}
    )


def check_sizes(description: RoadDescription) -> None:
    """Check a description's numbers and vehicle types; convert whole numbers in float fields.

    Raises:
        ScenarioError: a number has a wrong type or is out of bounds, a vehicle is wider than a
            lane, too many vehicles are placed, or the user's vehicle types have equal ids, shares
            above 1 in total, or are combined with placed vehicles.
    """
    check_fields(description, "The scenario's ", ScenarioError)
    if description.vehicle_width_m > description.lane_width_m:
        raise ScenarioError(
            f"The scenario's vehicle_width_m is {description.vehicle_width_m:g}, but must be at "
            f"most lane_width_m, {description.lane_width_m:g}."
        )
    for name, kind in (("vehicles", PlacedVehicle), ("vehicle_types", CustomVehicleType)):
        given = getattr(description, name)
        if not isinstance(given, list | tuple) or not all(isinstance(one, kind) for one in given):
            raise ScenarioError(
                f"The scenario's {name} are {given!r}, but must be a list of {kind.__name__}."
            )
        object.__setattr__(description, name, tuple(given))
    if (placed := len(description.vehicles)) > MOST_VEHICLES:
        raise ScenarioError(
            f"The scenario places {placed} vehicles, but must place at most {MOST_VEHICLES}."
        )
    check_custom_types(description)


def require_ego(placed: Collection[PlacedVehicle]) -> None:
    """Raise ScenarioError if a scenario places vehicles, and the ego is not among them."""
    if placed and "ego" not in (vehicle.id for vehicle in placed):
        raise ScenarioError(
            f"The scenario places {pluralize(len(placed), 'vehicle')} but not the ego: "
            'place one with the id "ego" too.'
        )


def check_placed(description: RoadDescription, number: int, road: Road) -> None:
    """Check the placed vehicle with the index ``number`` in ``description.vehicles``.

    Raises:
        ScenarioError: the vehicle starts faster than the speed limit, changes to a lane that does
            not extend along the whole road, or overlaps or has the same id as a vehicle with a
            smaller index.
    """
    vehicle, long_m = description.vehicles[number], description.vehicle_length_m
    limits = road.speed_limits[vehicle.lane] if road.speed_limits else ()
    here = (limit for begin_m, end_m, limit in limits if begin_m <= vehicle.position_m < end_m)
    limit_m_s = next(here, description.speed_limit_m_s)
    if vehicle.speed_m_s > limit_m_s:
        raise ScenarioError(
            f"Vehicle {vehicle.id!r} starts at {vehicle.speed_m_s:g} m/s, but must not be "
            f"faster than the scenario's speed_limit_m_s, {limit_m_s:g}."
        )
    flags = enumerate(road.open_lanes)
    lanes = [lane for lane, is_open in flags if is_open and not is_partial(lane, road)]
    for time_s, to in vehicle.lane_changes:
        if to not in lanes:
            raise ScenarioError(
                f"Vehicle {vehicle.id!r} changes to lane {to} at {time_s:g} s, but must change to "
                f"one of the lanes along the whole road: {', '.join(map(str, lanes))}."
            )
    for other in description.vehicles[:number]:
        if vehicle.id == other.id:
            raise ScenarioError(f"Two vehicles are called {vehicle.id!r}: rename one.")
        ahead_m = abs(vehicle.position_m - other.position_m)
        if vehicle.lane == other.lane and min(ahead_m, road.lap_m - ahead_m) < long_m:
            raise ScenarioError(
                f"Vehicles {other.id!r} and {vehicle.id!r} overlap on lane {vehicle.lane}: place "
                f"them at least {long_m:g} m apart, front bumper to front bumper."
            )


def read_changes(changes: Any, vehicle: str, lane: int) -> tuple[TimedChange, ...]:
    """Return the lane changes of a placed vehicle as a tuple of (time, lane).

    ``vehicle`` is its id, ``lane`` the lane in which it starts.

    Raises:
        ScenarioError: ``changes`` are not pairs of a time and a lane, the ego has lane changes, the
            times do not increase from 0 on, or a change does not lead to an adjacent lane.
    """
    try:
        found = tuple((0.0 + time_s, operator.index(to)) for time_s, to in changes)
    except (TypeError, ValueError, OverflowError) as error:
        raise ScenarioError(
            f"Vehicle {vehicle!r}: lane_changes is {changes!r}, but must be pairs [time, lane] of "
            "a number of seconds and a whole number."
        ) from error
    if found and vehicle == "ego":
        raise ScenarioError(
            "The ego has lane_changes, but its driver decides its lanes: leave them out."
        )
    before_s, beside = -1.0, lane
    for time_s, to in found:
        if not 0 <= time_s <= LATEST_S or time_s <= before_s or abs(to - beside) != 1:
            raise ScenarioError(
                f"Vehicle {vehicle!r}: lane_changes has {time_s:g} s to lane {to}, but each change "
                f"must come after the one before, from 0 to {LATEST_S:g} s, and lead to a lane "
                f"beside it, here {beside}."
            )
        before_s, beside = time_s, to
    return found
