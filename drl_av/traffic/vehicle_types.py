"""The vehicle types of a scenario as data: what SUMO lets its vehicles do, and their sizes."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ScenarioError

VEHICLE = {
    "minGap": repr(STANDSTILL_GAP_M),
    "maxSpeed": "40",
    "speedFactor": "1",
    "speedDev": "0",
    "laneChangeModel": "SL2015",
    "maxSpeedLat": "0.76",
    "lcAccelLat": "1000",
    "lcKeepRight": "0",
    "guiShape": "passenger",
}
TRAFFIC = {"carFollowModel": "IDM", "accel": "1.5", "decel": "4", "emergencyDecel": "4"}
EGO = {
    "carFollowModel": "Krauss",
    "accel": "2",
    "decel": "4",
    "emergencyDecel": "4",
    "sigma": "0",
    "tau": "1.5",
}
"""Never drives the ego. SUMO keeps others from cutting in closer than this model could brake
for: its brakes, and 1.5 s for a decision in which it still accelerates."""
COLORS = {"traffic": "240,190,40", "ego": "60,160,255"}
APPEARANCE = ("id", "color", "guiShape")
BOUNDS = {"length": (1.0, 25.0), "width": (0.5, 5.0)}
"""Others may be anything above 0."""


@dataclass(frozen=True)
class VehicleType:
    """A vehicle type; each number is the SUMO attribute that ``NUMBERS`` names."""

    length_m: float
    width_m: float
    acceleration_m_s2: float
    braking_m_s2: float
    """As hard as its driver brakes where SUMO's models have a choice."""
    emergency_braking_m_s2: float
    """As hard as it can brake."""
    lateral_speed_m_s: float
    model: tuple[tuple[str, str], ...]
    """The other attributes that decide how it drives, in the order of their names."""


NUMBERS = {
    "length_m": "length",
    "width_m": "width",
    "acceleration_m_s2": "accel",
    "braking_m_s2": "decel",
    "emergency_braking_m_s2": "emergencyDecel",
    "lateral_speed_m_s": "maxSpeedLat",
}
"""The SUMO attribute of each field of a vehicle type."""


@dataclass(frozen=True)
class VehicleTypes:
    """The two types of a scenario: of the ego, and of all other vehicles."""

    traffic: VehicleType
    ego: VehicleType

    @property
    def longest_m(self) -> float:
        """Length of the longer type."""
        return max(self.traffic.length_m, self.ego.length_m)

    @property
    def widest_m(self) -> float:
        """Width of the wider type."""
        return max(self.traffic.width_m, self.ego.width_m)


def type_attributes(length_m: float, width_m: float) -> list[dict[str, str]]:
    """The attributes of the two types as a scenario is written with, for bodies of that size."""
    size = {"length": repr(length_m), "width": repr(width_m)}
    return [
        {"id": name, "color": COLORS[name]} | size | model | VEHICLE
        for name, model in (("traffic", TRAFFIC), ("ego", EGO))
    ]


def read_types(elements: Iterable[Mapping[str, Any]], name: str) -> VehicleTypes:
    """The types from the attributes of a file's vType elements.

    Raises:
        ScenarioError: a type is missing, twice there, or lacks or misstates a number; the message
            begins with ``name``.
    """
    found: dict[str, VehicleType] = {}
    for attributes in elements:
        kind = str(attributes.get("id"))
        if kind not in COLORS or kind in found:
            raise ScenarioError(
                f"{name}: there is a vehicle type {kind!r}, but the types must be one 'traffic' "
                "and one 'ego': remove it."
            )
        found[kind] = _read_type(attributes, f"{name}: the vehicle type {kind!r}")
    if missing := sorted(set(COLORS) - set(found)):
        raise ScenarioError(
            f"{name}: there is no vehicle type {missing[0]!r}: write the scenario anew with: "
            "drl-av scenario DIR."
        )
    return VehicleTypes(**found)


def _read_type(attributes: Mapping[str, Any], name: str) -> VehicleType:
    numbers = {
        field.name: _number(attributes, NUMBERS[field.name], name)
        for field in fields(VehicleType)
        if field.name in NUMBERS
    }
    known = {*NUMBERS.values(), *APPEARANCE}
    model = tuple(sorted((key, str(attributes[key])) for key in attributes if key not in known))
    return VehicleType(**numbers, model=model)


def _number(attributes: Mapping[str, Any], key: str, name: str) -> float:
    text = attributes.get(key)
    try:
        value = float(str(text))
    except ValueError:
        value = math.nan
    low, high = BOUNDS.get(key, (0.0, math.inf))
    if not (low <= value <= high and 0.0 < value < math.inf):
        within = f"from {low:g} to {high:g}" if key in BOUNDS else "above 0"
        raise ScenarioError(f"{name} has {key} {text!r}, but must have a number {within}.")
    return value


AS_WRITTEN = read_types(type_attributes(5.0, 1.8), "the types as written")
"""The types of a scenario that is written with the default sizes."""
