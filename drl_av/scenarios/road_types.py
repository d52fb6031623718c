"""The kinds of scenarios by name, and the description of a scenario in TOML text.

To add a kind, write its class and add a line to ``ROAD_TYPES``, from which the help of the command
line and the docs are generated.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, TypeVar

from drl_av.config.section import did_you_mean, there_is_no
from drl_av.errors import ScenarioError
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType
from drl_av.scenarios.highways import (
    ExitDescription,
    MergeDescription,
    RampToRampDescription,
    StraightDescription,
)
from drl_av.scenarios.imported.description import ImportedDescription
from drl_av.scenarios.loop import ScenarioDescription
from drl_av.scenarios.road_description import FILES, TYPES, PlacedVehicle, RoadDescription

ROAD_TYPES: dict[str, type[RoadDescription]] = {
    "loop": ScenarioDescription,
    "straight": StraightDescription,
    "merge": MergeDescription,
    "exit": ExitDescription,
    "ramp_to_ramp": RampToRampDescription,
    "imported": ImportedDescription,
}


def road_type_name(description: RoadDescription) -> str:
    """Return the name of the kind of scenario to which a description belongs.

    Raises:
        ScenarioError: no kind has this class.
    """
    for name, kind in ROAD_TYPES.items():
        if type(description) is kind:
            return name
    raise ScenarioError(
        f"No kind of scenario is described by a {type(description).__name__}: add its kind to "
        "drl_av.scenarios.road_types.ROAD_TYPES."
    )


def stated_road_type(description: RoadDescription) -> str:
    """Return the TOML line that names the kind; "" for a loop, whose file has no such line."""
    name = road_type_name(description)
    return "" if name == "loop" else f'kind = "{name}"\n'


def from_toml(text: str, name: str = "scenario.toml") -> RoadDescription:
    """Return the description of a scenario, read from TOML text; missing keys have their defaults.

    Args:
        text: The TOML text; its key ``kind`` selects the class of the description.
        name: The name of the file, with which each error message begins. The key ``net``, a path,
            is relative to the folder of this file.

    Raises:
        ScenarioError: the text is not valid TOML, the kind or a key is unknown, a key of a placed
            vehicle is missing, or a value has a wrong type or is out of bounds.
    """
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{name} is not valid TOML: {error}.") from error
    try:
        kind = values.pop("kind", "loop")
        if not isinstance(kind, str) or kind not in ROAD_TYPES:
            raise unknown_road_type(kind)
        if isinstance(values.get(NET), str) and values[NET]:
            values[NET] = str(Path(name).parent / values[NET])
        if FILES in values:
            values[FILES] = _paths(values[FILES], Path(name).parent)
        for key, (made, what) in TABLES.items():
            if key in values:
                values[key] = _from_tables(values[key], key, made, what)
        return _build(ROAD_TYPES[kind], values, "a scenario")
    except ScenarioError as error:
        raise ScenarioError(f"{name}: {error}") from error


TABLES: dict[str, tuple[type[Any], str]] = {
    "vehicles": (PlacedVehicle, "a placed vehicle"),
    TYPES: (CustomVehicleType, "a vehicle type"),
}
"""For each key that holds tables: the class of a table, and its name in error messages."""
NET = "net"
"""The key of the path of a network file."""


def unknown_road_type(kind: object) -> ScenarioError:
    """Return the error for a kind of scenario that does not exist."""
    return ScenarioError(there_is_no("kind of scenario", kind, "kinds", ROAD_TYPES))


def _paths(names: Any, folder: Path) -> tuple[str, ...]:
    """Return the paths of files in a folder; raise ScenarioError at a name that is none."""
    for name in names if isinstance(names, list) else [None]:
        if not isinstance(name, str) or not name or Path(name).name != name or "," in name:
            raise ScenarioError(
                f"{FILES} is {names!r}, but must be a list of names of files in the same folder."
            )
    return tuple(str(folder / name) for name in names)


Described = TypeVar("Described")


def _from_tables(tables: Any, key: str, made: type[Described], what: str) -> tuple[Described, ...]:
    """Convert the tables ``[[key]]`` to objects of the class ``made``."""
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ScenarioError(f"The {key} must be tables, each written under [[{key}]].")
    return tuple(_build(made, table, what) for table in tables)


def _build(kind: type[Described], values: Mapping[str, Any], what: str) -> Described:
    """Create an object of the class ``kind`` from TOML values; ``what`` names it in errors."""
    known = [field.name for field in fields(kind) if field.init]  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            hint = did_you_mean(key, known)
            raise ScenarioError(
                f"There is no key {key!r}{hint} in {what}; its keys are: {', '.join(known)}."
            )
    missing = [
        item.name
        for item in fields(kind)  # type: ignore[arg-type]
        if item.init and item.default is MISSING and item.name not in values
    ]
    if missing:
        raise ScenarioError(f"The key {missing[0]!r} is missing in {what}: add it.")
    return kind(**values)
