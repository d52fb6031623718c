"""The verb ``scenario``: writes a scenario folder, which SUMO can also open by itself."""

import argparse
import shlex
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

from drl_av.cli.options import add_text, int_at_least
from drl_av.config.section import meanings
from drl_av.errors import ScenarioError
from drl_av.scenarios.road_description import RoadDescription
from drl_av.scenarios.road_types import ROAD_TYPES, road_type_name, unknown_road_type

FLAGS = {"barricaded_lanes": "--barricade"}
"""Maps a setting to its option, if the option does not have the name of the setting."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av scenario``: one for each setting of any kind of scenario."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to write; must be new")
    parser.add_argument(
        "--from",
        dest="source",
        action="append",
        metavar="FILE.toml",
        help="description in the form of scenario.toml, which the other options change; or the "
        "name of a scenario that ships with drl-av",
    )
    kinds = "; ".join(f"{name}: {kind.meaning}" for name, kind in ROAD_TYPES.items())
    add_text(parser, "--kind", "KIND", f"default: loop; {kinds}")
    for name, users in _users().items():
        kind, item = next(iter(users.items()))
        help_text = meanings(ROAD_TYPES[kind])[name].text
        if isinstance(item.default, int | float):
            help_text = f"{help_text} (default: {item.default:g})"
        if len(users) < len(ROAD_TYPES):
            help_text = f"{help_text}; kind {', '.join(users)}"
        parser.add_argument(_flag(name), dest=name, help=help_text, **_parsing(item))


def _users() -> dict[str, dict[str, Field[Any]]]:
    """Return, for each setting, the scenario kinds that have it, each with its dataclass field."""
    users: dict[str, dict[str, Field[Any]]] = {}
    for kind, entry in ROAD_TYPES.items():
        meant = meanings(entry)
        for item in fields(entry):
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
    from drl_av.scenarios.folder import write_scenario

    users = _users()
    given = {name: value for name, value in vars(options).items() if name in users}
    source = _described(options)
    kind = road_type_name(source) if source else options.kind or "loop"
    for name in given:
        if kind not in users[name]:
            raise ScenarioError(
                f"A scenario of the kind {kind} has no {_flag(name)}: leave it out, or "
                f"write one of the kind {', '.join(users[name])}."
            )
    lists = {name: tuple(value) for name, value in given.items() if isinstance(value, list)}
    given |= lists
    described = source.updated(**given) if source else ROAD_TYPES[kind](**given)
    write_scenario(options.folder, described)
    command = shlex.join(["sumo-gui", "-c", str(options.folder / "highway.sumocfg")])
    print(f"{options.folder}: open it with {command}")
    if described.summary:
        print(described.summary)
    return 0


def _described(options: argparse.Namespace) -> RoadDescription | None:
    """Return the description that ``--from`` names; raise ScenarioError if it has another kind."""
    from drl_av.scenarios.folder import find_scenario, read_description
    from drl_av.scenarios.folder_files import DESCRIPTION_FILE

    kind = options.kind
    if kind is not None and kind not in ROAD_TYPES:
        raise unknown_road_type(kind)
    if not options.source:
        return None
    source, *others = options.source
    if others:
        raise ScenarioError(f"--from is given {len(others) + 1} times: name one description.")
    path = Path(source)
    if path.suffix != ".toml" and (path.is_dir() or not path.exists()):
        path = find_scenario(source) / DESCRIPTION_FILE
    described = read_description(path, "correct the path or the file")
    if kind not in (None, road_type_name(described)):
        raise ScenarioError(
            f"{source} describes a scenario of the kind {road_type_name(described)}, and --kind is "
            f"{kind}: leave one of the two out."
        )
    return described
