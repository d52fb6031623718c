"""The description of a scenario: the loop, its lanes, and vehicles with exact places."""

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, TypeVar

import tomli_w

from drl_av.config.schema import did_you_mean
from drl_av.errors import ScenarioError

BOUNDS: dict[str, tuple[float, float]] = {
    "circumference_m": (100, 50_000),
    "lanes": (1, 10),
    "lane_width_m": (2, 10),
    "speed_limit_m_s": (1, 100),
    "vehicle_length_m": (1, 25),
    "vehicle_width_m": (0.5, 5),
    "lane": (0, 9),
    "position_m": (0, 50_000),
    "speed_m_s": (0, 100),
    "desired_speed_m_s": (0.1, 100),
}
INNER_RADIUS_M = 5.0
"""The innermost lane keeps at least this distance from the middle of the loop."""
VEHICLE_NAME = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True)
class PlacedVehicle:
    """A vehicle with an exact place at the start; the id "ego" is the ego.

    Raises:
        ScenarioError: a value has a wrong type or is out of bounds.
    """

    id: str
    lane: int
    """0 is the rightmost."""
    position_m: float
    """Position of the front bumper along the loop."""
    speed_m_s: float
    desired_speed_m_s: float

    def __post_init__(self) -> None:
        if not isinstance(self.id, str) or not VEHICLE_NAME.fullmatch(self.id):
            raise ScenarioError(
                f"A vehicle's id is {self.id!r}, but must be made of letters, digits, - and _."
            )
        _check_numbers(self, f"Vehicle {self.id!r}: ")


@dataclass(frozen=True)
class ScenarioDescription:
    """A closed loop driven counter-clockwise on the right, so that lane 0 is the outer lane.

    Raises:
        ScenarioError: a value has a wrong type or is out of bounds, no lane is open, or vehicles
            overlap.
    """

    circumference_m: float = 500.0
    """Length of every lane."""
    lanes: int = 3
    lane_width_m: float = 3.8
    speed_limit_m_s: float = 40.0
    vehicle_length_m: float = 5.0
    vehicle_width_m: float = 1.8
    barricaded_lanes: tuple[int, ...] = ()
    """Lanes closed along the whole loop."""
    vehicles: tuple[PlacedVehicle, ...] = ()

    def __post_init__(self) -> None:
        _check_numbers(self, "The scenario's ")
        self._check_widths()
        self._check_barricades()
        self._check_vehicles()

    @property
    def open_lanes(self) -> tuple[bool, ...]:
        """One flag for each lane, rightmost first; False if it is barricaded."""
        return tuple(lane not in self.barricaded_lanes for lane in range(self.lanes))

    def to_toml(self) -> str:
        """The description as TOML text; ``from_toml`` reads it back to an equal one."""
        return tomli_w.dumps(asdict(self))

    def _check_widths(self) -> None:
        if self.vehicle_width_m > self.lane_width_m:
            raise ScenarioError(
                f"The scenario's vehicle_width_m is {self.vehicle_width_m:g}, but must be at most "
                f"lane_width_m, {self.lane_width_m:g}."
            )
        least_m = 2 * math.pi * (INNER_RADIUS_M + self.lanes * self.lane_width_m / 2)
        if self.circumference_m < least_m:
            raise ScenarioError(
                f"The scenario's circumference_m is {self.circumference_m:g}, but must be at least "
                f"{math.ceil(least_m)} for {self.lanes} lanes of {self.lane_width_m:g} m."
            )

    def _check_barricades(self) -> None:
        if not isinstance(self.barricaded_lanes, tuple) or not all(
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

    def _check_vehicles(self) -> None:
        checked: list[PlacedVehicle] = []
        for vehicle in self.vehicles:
            if vehicle.lane >= self.lanes or not self.open_lanes[vehicle.lane]:
                raise ScenarioError(
                    f"Vehicle {vehicle.id!r} is placed on lane {vehicle.lane}, but must be "
                    "on a lane that exists and is not barricaded."
                )
            if vehicle.position_m >= self.circumference_m:
                raise ScenarioError(
                    f"Vehicle {vehicle.id!r} is placed at {vehicle.position_m:g} m, but must be "
                    f"on the loop of {self.circumference_m:g} m."
                )
            if vehicle.speed_m_s > self.speed_limit_m_s:
                raise ScenarioError(
                    f"Vehicle {vehicle.id!r} starts at {vehicle.speed_m_s:g} m/s, but must not be "
                    f"faster than the scenario's speed_limit_m_s, {self.speed_limit_m_s:g}."
                )
            for other in checked:
                self._check_pair(vehicle, other)
            checked.append(vehicle)

    def _check_pair(self, vehicle: PlacedVehicle, other: PlacedVehicle) -> None:
        if vehicle.id == other.id:
            raise ScenarioError(f"Two vehicles are called {vehicle.id!r}: rename one.")
        ahead_m = abs(vehicle.position_m - other.position_m)
        apart_m = min(ahead_m, self.circumference_m - ahead_m)
        if vehicle.lane == other.lane and apart_m < self.vehicle_length_m:
            raise ScenarioError(
                f"Vehicles {other.id!r} and {vehicle.id!r} overlap on lane {vehicle.lane}: place "
                f"them at least {self.vehicle_length_m:g} m apart, front bumper to front bumper."
            )


def from_toml(text: str, name: str = "scenario.toml") -> ScenarioDescription:
    """Read a description from TOML text; keys left out keep their defaults.

    Raises:
        ScenarioError: the text is not valid TOML, a key is unknown or missing, or a value has a
            wrong type or is out of bounds; the message begins with ``name``.
    """
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{name} is not valid TOML: {error}.") from error
    try:
        if isinstance(values.get("barricaded_lanes"), list):
            values["barricaded_lanes"] = tuple(values["barricaded_lanes"])
        if "vehicles" in values:
            values["vehicles"] = _placed_vehicles(values["vehicles"])
        return _build(ScenarioDescription, values, "a scenario")
    except ScenarioError as error:
        raise ScenarioError(f"{name}: {error}") from error


def _placed_vehicles(tables: Any) -> tuple[PlacedVehicle, ...]:
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ScenarioError("The vehicles must be tables, each written under [[vehicles]].")
    return tuple(_build(PlacedVehicle, table, "a placed vehicle") for table in tables)


Described = TypeVar("Described", ScenarioDescription, PlacedVehicle)


def _build(kind: type[Described], values: Mapping[str, Any], what: str) -> Described:
    known = [field.name for field in fields(kind)]
    for key in values:
        if key not in known:
            hint = did_you_mean(key, known)
            raise ScenarioError(
                f"There is no key {key!r}{hint} in {what}; its keys are: {', '.join(known)}."
            )
    missing = [key for key in known if key not in values]
    if kind is PlacedVehicle and missing:
        raise ScenarioError(f"The key {missing[0]!r} is missing in {what}: add it.")
    return kind(**values)


def _check_numbers(described: Any, prefix: str) -> None:
    for field in fields(described):
        if field.name not in BOUNDS:
            continue
        value = getattr(described, field.name)
        low, high = BOUNDS[field.name]
        whole = field.type is int
        if type(value) not in ((int,) if whole else (int, float)) or not low <= value <= high:
            kind = "a whole number" if whole else "a number"
            raise ScenarioError(
                f"{prefix}{field.name} is {value!r}, but must be {kind} from {low:g} to {high:g}."
            )
        object.__setattr__(described, field.name, value if whole else float(value))
