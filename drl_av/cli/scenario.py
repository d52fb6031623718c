"""The verb ``scenario``: writes a scenario folder, which SUMO can also open by itself.

``composed`` puts the vehicles of several stories on one road.
"""

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import Field, fields, replace
from itertools import product
from pathlib import Path
from typing import Any

from drl_av.cli.options import int_at_least
from drl_av.config.schema import meanings
from drl_av.errors import ScenarioError
from drl_av.road.snapshot import EGO_ID
from drl_av.scenarios.road_description import PlacedVehicle, RoadDescription
from drl_av.scenarios.road_types import ROAD_TYPES, road_type_name

FLAGS = {"barricaded_lanes": "--barricade"}
"""Maps a setting to its option, if the option does not have the name of the setting."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av scenario``: one for each setting of any kind of scenario."""
    parser.add_argument(
        "folder",
        type=Path,
        metavar="DIR",
        help="folder to write; must be new",
    )
    parser.add_argument(
        "--from",
        dest="sources",
        action="append",
        default=[],
        metavar="FILE.toml",
        help="description in the form of scenario.toml, which the other options change; or the "
        "name of a scenario that ships with drl-av; given several times, it puts the vehicles of "
        "these stories on one road",
    )
    kinds = "; ".join(f"{name}: {kind.meaning}" for name, kind in ROAD_TYPES.items())
    parser.add_argument("--kind", metavar="KIND", help=f"default: loop; {kinds}")
    for name, users in _users().items():
        kind, item = next(iter(users.items()))
        help_text = meanings(ROAD_TYPES[kind].description)[name].text
        if isinstance(item.default, int | float):
            help_text = f"{help_text} (default: {item.default:g})"
        if len(users) < len(ROAD_TYPES):
            help_text = f"{help_text}; kind {', '.join(users)}"
        parser.add_argument(_flag(name), dest=name, help=help_text, **_parsing(item))


def _users() -> dict[str, dict[str, Field[Any]]]:
    """Return, for each setting, the scenario kinds that have it, each with its dataclass field."""
    users: dict[str, dict[str, Field[Any]]] = {}
    for kind, entry in ROAD_TYPES.items():
        meant = meanings(entry.description)
        for item in fields(entry.description):
            if item.init and item.name in meant:
                users.setdefault(item.name, {})[kind] = item
    return users


def _flag(name: str) -> str:
    return FLAGS.get(name, f"--{name.replace('_', '-')}")


def _parsing(item: Field[Any]) -> dict[str, Any]:
    """Return the arguments of ``add_argument`` for a setting; without the option nothing is set."""
    if item.type is float:
        return {"type": float, "metavar": "X", "default": argparse.SUPPRESS}
    if item.type is int:
        return {"type": int_at_least(1), "metavar": "N", "default": argparse.SUPPRESS}
    if item.type is str:
        return {"metavar": "TEXT", "default": argparse.SUPPRESS}
    return {"type": int_at_least(0), "nargs": "+", "metavar": "LANE", "default": argparse.SUPPRESS}


def scenario(options: argparse.Namespace) -> int:
    """Write the folder, and print the command that opens it; return the exit status 0."""
    from drl_av.cli.scenario import composed
    from drl_av.scenarios.folder import write_scenario

    users = _users()
    given = {name: value for name, value in vars(options).items() if name in users}
    stories = _stories(options.sources, options.kind)
    kinds = [road_type_name(story) for story in stories.values()] or [options.kind or "loop"]
    for name, kind in product(given, kinds):
        if kind not in users[name]:
            raise ScenarioError(
                f"A scenario of the kind {kind} has no {_flag(name)}: leave it out, or "
                f"write one of the kind {', '.join(users[name])}."
            )
    lists = {name: tuple(value) for name, value in given.items() if isinstance(value, list)}
    given |= lists
    changed = {name: replace(story, **given) for name, story in stories.items()}
    described = composed(changed) if changed else ROAD_TYPES[kinds[0]].description(**given)
    write_scenario(options.folder, described)
    command = shlex.join(["sumo-gui", "-c", str(options.folder / "highway.sumocfg")])
    print(f"{options.folder}: open it with {command}")
    if described.summary:
        print(described.summary)
    return 0


def _stories(sources: Sequence[str], kind: str | None) -> dict[str, RoadDescription]:
    """Return the descriptions of ``sources``; raise ScenarioError if one has another kind."""
    from drl_av.scenarios.description_file import unknown_road_type
    from drl_av.scenarios.folder import find_description, read_description

    if kind is not None and kind not in ROAD_TYPES:
        raise unknown_road_type(kind, ROAD_TYPES)
    stories = {
        source: read_description(find_description(source), "correct the path or the file")
        for source in sources
    }
    for source, described in stories.items():
        if kind not in (None, road_type_name(described)):
            raise ScenarioError(
                f"{source} describes a scenario of the kind {road_type_name(described)}, and "
                f"--kind is {kind}: leave one of the two out."
            )
    return stories


def composed(stories: Mapping[str, RoadDescription]) -> RoadDescription:
    """Return the description of one scenario with the vehicles of all stories (ours).

    ``stories`` holds the descriptions by name; a single one is returned unchanged. If two stories
    place vehicles with the same speeds and lane changes at one place (less than a vehicle length
    apart in one lane), the result contains only the vehicle of the first story. An id that is
    already taken gets a number, such as ``slow_2``.

    Raises:
        ScenarioError: one of several stories places no vehicles, the stories have different roads
            or egos, or two stories place different vehicles at one place.
    """
    (name, base), *others = stories.items()
    names = name
    for empty in (each for each, story in stories.items() if others and not story.vehicles):
        raise ScenarioError(
            f"{empty} places no vehicles, but each of several stories must: leave it out."
        )
    for other, story in others:
        _require_one_road(name, base, other, story)
        names, vehicles = f"{names} and {other}", list(base.vehicles)
        for vehicle in story.vehicles:
            _add(vehicles, vehicle, base.vehicle_length_m, names)
        base = replace(base, vehicles=tuple(vehicles))
    return base


def _require_one_road(name: str, base: RoadDescription, other: str, story: RoadDescription) -> None:
    """Raise ScenarioError if two stories differ in more than their vehicles."""
    kinds = road_type_name(base), road_type_name(story)
    if kinds[0] != kinds[1]:
        raise ScenarioError(
            f"{name} is a scenario of the kind {kinds[0]} and {other} of the kind {kinds[1]}: put "
            "together stories on one road."
        )
    for item in fields(base):
        mine, theirs = getattr(base, item.name), getattr(story, item.name)
        if item.compare and item.name != "vehicles" and mine != theirs:
            raise ScenarioError(
                f"{item.name} is {mine!r} in {name} and {theirs!r} in {other}, but stories that "
                "are put together have one road: make them equal, or give the option."
            )


def _add(vehicles: list[PlacedVehicle], one: PlacedVehicle, length_m: float, names: str) -> None:
    """Add a vehicle of another story to ``vehicles``, unless it is there already.

    ``names`` holds the names of the stories, for messages.
    """
    if one.id == EGO_ID:
        ego = next((each for each in vehicles if each.id == EGO_ID), one)
        if ego != one:
            raise ScenarioError(
                f"The ego of {names} starts differently ({_start(ego)}, and {_start(one)}), but "
                "there is one ego: make them equal."
            )
    for other in vehicles:
        if other.lane == one.lane and abs(other.position_m - one.position_m) < length_m:
            alike = replace(other, id=one.id, position_m=one.position_m) == one
            if not alike or (other.id != one.id and EGO_ID in (other.id, one.id)):
                raise ScenarioError(
                    f"{names} place two different vehicles at one place, {other.id!r} "
                    f"({_start(other)}) and {one.id!r} ({_start(one)}): move one of them."
                )
            return
    taken = {each.id for each in vehicles}
    free = (one.id, *(f"{one.id}_{number}" for number in range(2, len(taken) + 3)))
    vehicles.append(replace(one, id=next(name for name in free if name not in taken)))


def _start(vehicle: PlacedVehicle) -> str:
    return f"lane {vehicle.lane}, {vehicle.position_m:g} m, {vehicle.speed_m_s:g} m/s"
