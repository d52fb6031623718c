"""The user's own vehicle types, each for a share of the traffic (ours)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drl_av.config.section import check_fields, setting
from drl_av.errors import ScenarioError
from drl_av.random_streams import Stream, generator
from drl_av.road.vehicle_types import LENGTHS_M, WIDTHS_M

CAR_FOLLOWING_MODELS: dict[str, dict[str, str]] = {"IDM": {}, "Krauss": {"sigma": "0"}, "ACC": {}}
"""The allowed models of SUMO, with the attributes that make each of them deterministic."""
SHAPES = ("passenger", "passenger/van", "delivery", "truck", "truck/semitrailer", "bus", "coach",
          "motorcycle", "trailer")  # fmt: skip
"""The pictures of SUMO's guiShape that a type of the traffic may have."""
SUMO_NAMES = {
    "acceleration_m_s2": "accel",
    "top_speed_m_s": "maxSpeed",
    "headway_s": "tau",
    "speed_gain": "lcSpeedGain",
}
"""The SUMO attribute of each setting that is drawn for each vehicle unless its type states it."""
REQUIRED = {"length_m", "width_m"}
COLOR = "150,170,200"


@dataclass(frozen=True)
class CustomVehicleType:
    """A vehicle type of the traffic, written under ``[[vehicle_types]]`` in ``scenario.toml``.

    Raises:
        ScenarioError: a value has a wrong type or is out of bounds.
    """

    id: str
    share: float = field(metadata={"low": 0.0, "high": 1.0})
    """Probability that a vehicle of the traffic has this type."""
    length_m: float = field(metadata={"low": LENGTHS_M[0], "high": LENGTHS_M[1]})
    width_m: float = field(metadata={"low": WIDTHS_M[0], "high": WIDTHS_M[1]})
    car_following_model: str = setting("IDM", choices=tuple(CAR_FOLLOWING_MODELS))
    """One of ``CAR_FOLLOWING_MODELS``."""
    acceleration_m_s2: float | None = setting(None, low=0.1, high=10.0)
    """SUMO's accel; None draws it for each vehicle, like the next three."""
    top_speed_m_s: float | None = setting(None, low=0.1, high=100.0)
    """The highest speed; a lower desired speed that is drawn for a vehicle remains."""
    headway_s: float | None = setting(None, low=0.1, high=20.0)
    """The time gap to the vehicle ahead, SUMO's tau."""
    speed_gain: float | None = setting(None, low=0.0, high=100.0)
    """How much it changes lanes to get ahead, SUMO's lcSpeedGain."""
    shape: str = setting("passenger", choices=SHAPES)
    """The picture in sumo-gui, one of ``SHAPES``."""

    def __post_init__(self) -> None:
        if not isinstance(self.id, str) or not self.id.isidentifier():
            raise ScenarioError(
                f"A vehicle type's id is {self.id!r}, but must be made of letters, digits and _."
            )
        if self.id in ("traffic", "ego"):
            raise ScenarioError(
                f"A vehicle type's id is {self.id!r}, which is the type of other vehicles: "
                "rename it."
            )
        check_fields(self, f"Vehicle type {self.id!r}: ", ScenarioError)

    def attributes(self, traffic: dict[str, str]) -> dict[str, str]:
        """Return the SUMO attributes of this type; ``traffic`` holds those that it does not set."""
        return traffic | {
            "id": self.id,
            "color": COLOR,
            "length": repr(self.length_m),
            "width": repr(self.width_m),
            "guiShape": self.shape,
            "carFollowModel": self.car_following_model,
            **CAR_FOLLOWING_MODELS[self.car_following_model],
            **{SUMO_NAMES[name]: repr(value) for name, value in self.stated.items()},
        }

    @classmethod
    def of_sumo(cls, attributes: Mapping[str, str], share: float) -> "CustomVehicleType":
        """Return the type of a vType element; raise ScenarioError if it is wrong."""
        names = {"length_m": "length", "width_m": "width", **SUMO_NAMES}
        numbers = {
            name: number_of(attributes, key) for name, key in names.items() if key in attributes
        }
        if missing := [key for name, key in names.items() if name in REQUIRED - numbers.keys()]:
            raise ScenarioError(f"a vType has no {missing[0]}: add it")
        return cls(
            id=attributes.get("id", ""),
            share=share,
            car_following_model=attributes.get("carFollowModel", "Krauss"),
            shape=attributes.get("guiShape", "passenger"),
            **numbers,
        )

    @property
    def stated(self) -> dict[str, float]:
        """The settings that the type states for all its vehicles, by name."""
        values = {name: getattr(self, name) for name in SUMO_NAMES}
        return {name: value for name, value in values.items() if value is not None}


def number_of(attributes: Mapping[str, str], key: str) -> float:
    """Return a number of a vType element; raise ScenarioError if it is none."""
    try:
        return float(attributes[key])
    except ValueError as error:
        raise ScenarioError(
            f"the vehicle type {attributes.get('id', '')!r} has {key} {attributes[key]!r}, but "
            "must have a number: correct it"
        ) from error


def check_custom_types(description: Any) -> None:
    """Raise ScenarioError if the user's vehicle types do not fit each other or the scenario."""
    own = description.vehicle_types
    names = [each.id for each in own]
    for each in own:
        if names.count(each.id) > 1:
            raise ScenarioError(f"Two vehicle types are called {each.id!r}: rename one.")
        if each.width_m > description.lane_width_m:
            raise ScenarioError(
                f"Vehicle type {each.id!r}: width_m is {each.width_m:g}, but must be at most "
                f"lane_width_m, {description.lane_width_m:g}."
            )
    if sum(each.share for each in own) > 1 + 1e-9:
        raise ScenarioError(
            f"The shares of the vehicle types {', '.join(names)} add up to "
            f"{sum(each.share for each in own):g}, but must be at most 1."
        )
    if own and description.vehicles:
        raise ScenarioError(
            "The scenario has vehicle_types and places its vehicles exactly: leave one of the two "
            "out."
        )


def draw_types(seed: int, own: Sequence[CustomVehicleType]) -> Iterator[str]:
    """Yield the type id of each vehicle of an episode, drawn by the shares; the ego is the first.

    The vehicles of the start come first, then those that enter an open road later. The types have a
    random stream of their own, so the shares do not change other parameters.
    """
    limits = np.cumsum([each.share for each in own])
    names = [*(each.id for each in own), "traffic"]
    rng = generator(seed, Stream.OWN_VEHICLE_TYPES)
    yield "ego"
    while True:
        yield names[np.searchsorted(limits, rng.random(), side="right")]
