"""The vehicle types of a scenario: sizes, limits in SUMO, and bounds of described numbers."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ScenarioError

Bounds = tuple[float, float]
"""The smallest and the largest allowed value."""
LENGTHS_M: Bounds = (1.0, 25.0)
WIDTHS_M: Bounds = (0.5, 5.0)
"""Bounds of the length and the width of each vehicle of a scenario."""


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
"""This car-following model never drives the ego. SUMO uses it to prevent other vehicles from
cutting in so closely that the model could not brake in time. Its tau of 1.5 s covers one decision
in which the ego still accelerates."""
COLORS = {"traffic": "240,190,40", "ego": "233,64,200"}
APPEARANCE = ("id", "color", "guiShape", "probability")
"""Attributes that change nothing in how a vehicle drives."""
BOUNDS = {"length": LENGTHS_M, "width": WIDTHS_M}
"""Smallest and largest allowed values of some attributes, metres; the others must be above 0."""


@dataclass(frozen=True)
class VehicleType:
    """A vehicle type of SUMO; ``NUMBERS`` names the SUMO attribute of each numeric field."""

    length_m: float
    width_m: float
    acceleration_m_s2: float
    braking_m_s2: float
    """Hardest braking in normal driving, SUMO's decel."""
    emergency_braking_m_s2: float
    """Hardest braking in an emergency, SUMO's emergencyDecel."""
    lateral_speed_m_s: float
    model: tuple[tuple[str, str], ...]
    """The name and value of each other attribute that affects the driving, sorted by name."""


NUMBERS = {
    "length_m": "length",
    "width_m": "width",
    "acceleration_m_s2": "accel",
    "braking_m_s2": "decel",
    "emergency_braking_m_s2": "emergencyDecel",
    "lateral_speed_m_s": "maxSpeedLat",
}
"""The SUMO attribute of each numeric field of ``VehicleType``; units are SI."""


@dataclass(frozen=True)
class VehicleTypes:
    """The vehicle types of a scenario: two of ours, and any number of the user's own."""

    traffic: VehicleType
    ego: VehicleType
    own: Mapping[str, VehicleType] = field(default_factory=dict)
    """Further types of other vehicles, which the user has added, by id."""
    traffic_id: str = "traffic"

    @property
    def by_id(self) -> dict[str, VehicleType]:
        """Every type by its id."""
        return {"ego": self.ego, self.traffic_id: self.traffic, **self.own}

    @property
    def others(self) -> dict[str, VehicleType]:
        """Every type of the other vehicles by its id."""
        return {self.traffic_id: self.traffic, **self.own}

    @property
    def longest_m(self) -> float:
        """Length of the longest type, metres."""
        return max(kind.length_m for kind in self.by_id.values())

    @property
    def widest_m(self) -> float:
        """Width of the widest type, metres."""
        return max(kind.width_m for kind in self.by_id.values())


def type_attributes(length_m: float, width_m: float) -> list[dict[str, str]]:
    """Return the SUMO attributes of the types "traffic" and "ego", which have the same size."""
    size = {"length": repr(length_m), "width": repr(width_m)}
    return [
        {"id": name, "color": COLORS[name]} | size | model | VEHICLE
        for name, model in (("traffic", TRAFFIC), ("ego", EGO))
    ]


def read_types(
    elements: Iterable[Mapping[str, Any]], name: str, own: Sequence[str] = ()
) -> VehicleTypes:
    """Return the vehicle types that a file contains, from the attributes of its vType elements.

    ``own`` holds the ids of the types besides "traffic" and "ego".

    Raises:
        ScenarioError: a type is missing, unknown or occurs twice, or one of its numbers is missing
            or wrong; the message begins with ``name``.
    """
    found: dict[str, VehicleType] = {}
    wanted = [*COLORS, *own]
    for attributes in elements:
        kind = str(attributes.get("id"))
        if kind not in wanted or kind in found:
            one_each = " and one ".join(map(repr, sorted(wanted, reverse=True)))
            raise ScenarioError(
                f"{name}: there is a vehicle type {kind!r}, but the types must be one {one_each}: "
                "remove it."
            )
        found[kind] = _read_type(attributes, f"{name}: the vehicle type {kind!r}")
    if missing := sorted(set(wanted) - set(found)):
        raise ScenarioError(
            f"{name}: there is no vehicle type {missing[0]!r}: write the scenario again with: "
            "drl-av scenario DIR."
        )
    return VehicleTypes(found["traffic"], found["ego"], {kind: found[kind] for kind in own})


def _read_type(attributes: Mapping[str, Any], name: str) -> VehicleType:
    """Return a vehicle type from its SUMO attributes; raise ScenarioError if a number is wrong.

    Each message begins with ``name``.
    """
    numbers = {field: _number(attributes, key, name) for field, key in NUMBERS.items()}
    for key, text in attributes.items():
        if key not in APPEARANCE and _is_endless(str(text)):
            raise ScenarioError(f"{name} has {key} {text!r}, but must have a finite number.")
    known = {*NUMBERS.values(), *APPEARANCE}
    model = tuple(sorted((key, str(attributes[key])) for key in attributes if key not in known))
    return VehicleType(**numbers, model=model)


def _is_endless(text: str) -> bool:
    """Return whether a text is a number that is not finite: nan or inf."""
    try:
        return not math.isfinite(float(text))
    except ValueError:
        return False


def _number(attributes: Mapping[str, Any], key: str, name: str) -> float:
    """Return the SUMO attribute ``key`` as a number; raise ScenarioError if it is out of bounds."""
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
"""The vehicle types of a new scenario with the default vehicle size."""
