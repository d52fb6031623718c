"""Functions that write, read and verify scenario folders, and that find the shipped ones."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drl_av.config import Config
from drl_av.config.section import did_you_mean
from drl_av.config.traffic import NO_PAPER_DRIVERS, PAPER_SHARES, SUMO_ALONE
from drl_av.errors import ConfigError, ScenarioError, warn
from drl_av.files.atomic import refusals, replacing
from drl_av.road.road import Road
from drl_av.road.vehicle_types import VehicleTypes, read_types, type_attributes
from drl_av.scenarios import folder_files
from drl_av.scenarios.custom_vehicle_types import CustomVehicleType, number_of
from drl_av.scenarios.layout import Layout
from drl_av.scenarios.loop import ScenarioDescription as ScenarioDescription
from drl_av.scenarios.netconvert import NETWORK_FILE, WRITE_AGAIN
from drl_av.scenarios.open_road import OpenDescription
from drl_av.scenarios.road_description import PlacedVehicle as PlacedVehicle
from drl_av.scenarios.road_description import RoadDescription, require_ego
from drl_av.scenarios.road_types import from_toml
from drl_av.scenarios.safe_xml import (
    ADDITIONAL,
    NETWORK,
    OWN_ADDITIONAL,
    VIEW,
    parse_xml,
    read_regular_file,
    read_xml,
)

DEFAULT_SCENARIO = "circular_three_lane"
SUMO_FILES = (".sumocfg", ".xml", ".xml.gz")
"""The endings of SUMO's files."""
LOADING = ("additional-files", "additional", "route-files")
"""The options of SUMO's configuration that name files."""
OWN_FILES = (
    'in scenario.toml name detectors with file="NUL", vTypeDistributions with their vTypes '
    "inside, polygons and points of interest; all else is for --sumo-options='--additional-files "
    "FILE'"
)


@dataclass(frozen=True)
class Scenario:
    """A scenario folder that has been read and verified."""

    folder: Path
    description: RoadDescription
    """The settings of the scenario; their class is its kind in ``ROAD_TYPES``."""
    layout: Layout
    additional_files: tuple[Path, ...]
    """The files that SUMO loads before any vehicle: vehicle types, and barricades if any."""
    vehicle_types: VehicleTypes
    """The types in the scenario's file; ``description`` has their largest length and width."""
    as_written: bool
    """Whether the folder has checksums, which match; False if it has no checksums."""

    @property
    def road(self) -> Road:
        """The road, with its lanes."""
        return self.layout.road

    @property
    def network_file(self) -> Path:
        """Path of SUMO's network file."""
        return self.folder / NETWORK_FILE

    @property
    def view_file(self) -> Path:
        """Path of the file with the view settings of sumo-gui."""
        return self.folder / folder_files.VIEW_FILE


def write_scenario(folder: str | Path, description: RoadDescription) -> None:
    """Write a scenario folder atomically; equal descriptions give equal bytes.

    Raises:
        ScenarioError: the folder exists and is not empty, it cannot be written, SUMO cannot read
            its name, the description places vehicles without the ego, or netconvert refuses it.
        SimulationError: netconvert cannot be run.
    """
    folder = Path(folder).absolute()
    _require_readable(folder)
    _require_free(folder)
    require_ego(description.vehicles)
    texts, described = folder_files.scenario_texts(description), description
    what = f"The folder {folder.parent} cannot be made"
    with refusals(what, "choose another one", ScenarioError):
        folder.parent.mkdir(parents=True, exist_ok=True)
    with replacing(folder, ScenarioError) as unfinished:
        unfinished.mkdir(parents=True)
        for name, text in texts.items():
            (unfinished / name).write_text(text, encoding="utf-8", newline="\n")
        for path in map(Path, description.additional_files):
            if (unfinished / path.name).exists():
                raise ScenarioError(f"The scenario has a file {path.name} already: rename yours.")
            types = _types_in(read_xml(path, OWN_ADDITIONAL, OWN_FILES), path)
            own = _own_types(types, str(path))
            described = _with(described, str(path), vehicle_types=(*described.vehicle_types, *own))
            read_types([*type_attributes(5.0, 1.8), *types], str(path), [each.id for each in own])
            (unfinished / path.name).write_bytes(read_regular_file(path, OWN_FILES))


def _require_readable(folder: Path) -> None:
    """Raise ScenarioError if the path contains a comma, which SUMO cannot read."""
    if "," in str(folder):
        raise ScenarioError(f"SUMO cannot read {folder}, which has a comma in it: rename it.")


def _require_free(folder: Path) -> None:
    """Raise ScenarioError if the folder exists and is not empty."""
    if folder.exists() and not folder.is_dir():
        raise ScenarioError(f"{folder} is a file: name a folder that does not exist yet.")
    if folder.exists() and any(folder.iterdir()):
        raise ScenarioError(f"{folder} exists and is not empty: remove it, or name another folder.")


def load_scenario(folder: str | Path) -> Scenario:
    """Read a scenario folder, and verify that its files agree with each other.

    Raises:
        ScenarioError: the folder does not exist, SUMO cannot read its name, a file is missing,
            damaged or changed, or the road is not that of the description.
    """
    folder = Path(folder).absolute()
    if not folder.is_dir():
        raise ScenarioError(f"There is no scenario folder {folder}: {WRITE_AGAIN}.")
    _require_readable(folder)
    name = folder_files.DESCRIPTION_FILE
    description = as_read = read_description(folder / name)
    additional = [folder / name for name in folder_files.additional_files(description)]
    types_file, *others = additional
    types = [each.attrib for each in read_xml(types_file, ADDITIONAL, WRITE_AGAIN).iter("vType")]
    for path in others:
        own = str(path) in description.additional_files
        root = read_xml(path, *((OWN_ADDITIONAL, OWN_FILES) if own else (ADDITIONAL, WRITE_AGAIN)))
        in_path = _types_in(root, path)
        types += in_path
        kinds = (*description.vehicle_types, *_own_types(in_path, str(path)))
        description = _with(description, str(path), vehicle_types=kinds)
    names = [each.id for each in description.vehicle_types]
    vehicle_types = read_types(types, str(types_file), names)
    sizes = {"vehicle_length_m": vehicle_types.longest_m, "vehicle_width_m": vehicle_types.widest_m}
    description = _with(description, str(types_file), **sizes)
    read_xml(folder / folder_files.VIEW_FILE, VIEW, WRITE_AGAIN)
    network_file = folder / NETWORK_FILE
    network = read_xml(network_file, NETWORK, WRITE_AGAIN)
    layout = as_read.read_layout(network, str(network_file))
    as_written = _require_unchanged(folder)
    if not as_written:
        _require_named(folder, {path.name for path in additional})
    return Scenario(folder, description, layout, tuple(additional), vehicle_types, as_written)


def read_description(path: Path, remedy: str = WRITE_AGAIN) -> RoadDescription:
    """Return the description of a scenario in a TOML file.

    Raises:
        ScenarioError: the file cannot be read, or its contents are wrong. If it cannot be read, the
            message ends with ``remedy``, which says what the user can do.
    """
    return from_toml(_text(path, remedy), str(path))


def _with(description: RoadDescription, name: str, **values: Any) -> RoadDescription:
    """Return the description with values from the file ``name`` of its folder."""
    try:
        return replace(description, **values)
    except ScenarioError as error:
        raise ScenarioError(f"{name}: {error}") from error


def _types_in(root: ET.Element, path: Path) -> list[dict[str, str]]:
    """Return the attributes of a file's vehicle types; raise ScenarioError if it names others."""
    for each in root.iter("vTypeDistribution"):
        if named := {"vTypes", "probabilities"} & each.attrib.keys():
            raise ScenarioError(
                f"{path}: its vTypeDistribution has {min(named)}, but must have its types inside, "
                "each with its probability."
            )
    return [each.attrib for each in root.iter("vType")]


def _own_types(types: Sequence[Mapping[str, str]], name: str) -> list[CustomVehicleType]:
    """Return the vehicle types of a file's vType elements; ``name`` begins each message.

    Their shares are their probabilities, divided by the sum of these.
    """
    try:
        shares = [number_of({"probability": "1", **each}, "probability") for each in types]
        if types and sum(shares) <= 0:
            raise ScenarioError("each probability is 0: set that of the types that are to drive")
        return [
            CustomVehicleType.of_sumo(each, share / sum(shares))
            for each, share in zip(types, shares, strict=True)
        ]
    except (ScenarioError, ArithmeticError) as error:
        raise ScenarioError(f"{name}: {str(error).rstrip('.')}.") from error


def _require_named(folder: Path, known: set[str]) -> None:
    """Raise ScenarioError if the configuration for SUMO alone loads files that we do not load."""
    path = folder / folder_files.CONFIG_FILE
    if not path.is_file():
        return
    root = parse_xml(path, ET.TreeBuilder(), WRITE_AGAIN)
    loaded = [each.get("value", "") for each in root.iter() if each.tag in LOADING]
    names = [name.strip() for text in loaded for name in text.split(",")]
    if others := sorted({*filter(None, names)} - known - {folder_files.TRAFFIC_FILE}):
        raise ScenarioError(
            f"{path} loads {others[0]}, which is for SUMO alone: write additional_files = "
            f'["{others[0]}"] into {folder_files.DESCRIPTION_FILE} for detectors and types, and '
            "drive among vehicles of your own with drl_av.attach."
        )


def _require_unchanged(folder: Path) -> bool:
    """Return whether there are checksums; raise ScenarioError if a file does not match them."""
    record = folder / folder_files.CHECKSUMS_FILE
    if not record.exists():
        return False
    names = {path.name for path in folder.iterdir()} & set(folder_files.ALL_FILES)
    contents = {name: read_regular_file(folder / name, WRITE_AGAIN) for name in names}
    found = folder_files.checksums(contents).splitlines()
    changed = set(found) ^ set(_text(record).splitlines())
    if changed:
        name = min(line.split("  ")[-1] for line in changed)
        raise ScenarioError(
            f"{folder} was changed after it was written, the first difference is in {name!r}: "
            f"{WRITE_AGAIN}, or remove {record.name} if the change is intended."
        )
    return True


def shipped_scenarios() -> dict[str, Path]:
    """Return the folders of the scenarios that the package contains, by name."""
    package = Path(__file__).parents[1]
    for home in (package / "sumo_scenarios", package.parent / "sumo_scenarios"):
        found = home.glob(f"*/{folder_files.DESCRIPTION_FILE}")
        if shipped := {path.parent.name: path.parent for path in sorted(found)}:
            return shipped
    return {}


def with_scenario(
    config: Config, name_or_path: str | Path | None = None, traffic: str | None = None
) -> Config:
    """Return the config with a scenario that is the same in every working directory.

    Without ``name_or_path`` it is the config's own. A folder is named by its absolute path. A
    shipped scenario takes precedence over a folder of its name, which a Path or ``./name`` stands
    for; a warning says so. Any other text stays as it is.

    On an open road the default shares of the paper's drivers, who cannot drive there, become 0, so
    that the default traffic is ``calm``.

    Raises:
        ConfigError: ``name_or_path`` is neither a text nor a Path; or the road is open, and
            ``traffic``, the kind that the user names, has them.
    """
    is_own = name_or_path is None
    if name_or_path is None:
        name_or_path = config.simulation.scenario
    if not isinstance(name_or_path, str | Path):
        raise ConfigError(
            f"scenario is of the type {type(name_or_path).__name__}, but must be a folder or the "
            "name of a shipped scenario; settings are the argument config."
        )
    is_name = isinstance(name_or_path, str) and name_or_path in shipped_scenarios()
    description = os.path.join(name_or_path, folder_files.DESCRIPTION_FILE)
    if is_name and not is_own and os.path.isfile(description):
        warn(
            f"The scenario {name_or_path} is the one that ships; write ./{name_or_path} for the "
            "folder here.",
            stacklevel=1,
        )
    is_folder = not is_name and os.path.isdir(name_or_path)  # False for a name that is too long
    absolute = os.path.realpath if ".." in Path(name_or_path).parts else os.path.abspath
    scenario = absolute(name_or_path) if is_folder else str(name_or_path)
    config = config.updated("simulation", scenario=scenario)
    shares = {name: getattr(config.traffic, name) for name in PAPER_SHARES}
    if shares != PAPER_SHARES or not _is_open(scenario):
        return config
    if traffic is not None:
        raise ConfigError(SUMO_ALONE)
    return config.updated("traffic", **NO_PAPER_DRIVERS)


def _is_open(scenario: str) -> bool:
    """Return whether the road of a scenario is open; False if it cannot be read, either."""
    with suppress(ScenarioError):  # which loading the scenario reports
        description = find_scenario(scenario) / folder_files.DESCRIPTION_FILE
        return isinstance(read_description(description), OpenDescription)
    return False


def find_scenario(name_or_path: str | Path | None = None) -> Path:
    """Return the folder of a scenario, from its path or from the name of a shipped scenario.

    A text that names a shipped scenario does not mean a folder of that name; ``./name`` does. None
    returns the folder of the default scenario.

    Raises:
        ScenarioError: ``name_or_path`` is neither a folder nor a shipped scenario.
    """
    name = DEFAULT_SCENARIO if name_or_path is None else str(name_or_path)
    shipped = shipped_scenarios()
    if name in shipped and not isinstance(name_or_path, Path):
        return shipped[name]
    if os.path.isdir(name):
        return Path(name)
    if name.endswith(SUMO_FILES) and os.path.isfile(name):
        folder = os.path.dirname(os.path.abspath(name))
        if os.path.isfile(os.path.join(folder, folder_files.DESCRIPTION_FILE)):
            raise ScenarioError(f"{name} is a file of a scenario: name its folder, {folder}.")
        raise ScenarioError(
            f"{name} is a file of SUMO, not a scenario of drl-av: make one of a route through its "
            "network with: drl-av scenario DIR --kind imported --net FILE.net.xml --from-edge EDGE "
            "--to-edge EDGE."
        )
    hint = did_you_mean(name, shipped)
    if os.path.isabs(name):
        raise ScenarioError(
            f"There is no scenario {name!r}: correct the path, or put the folder back there."
        )
    raise ScenarioError(
        f"There is no scenario {name!r}{hint} in {Path.cwd()}: name a folder, or one of: "
        f"{', '.join(shipped)}."
    )


def summary_of(name_or_path: str) -> str:
    """Return what was made of the user's own files in a scenario; "" if there are none.

    Raises ScenarioError as ``find_scenario`` and ``read_description`` do.
    """
    return read_description(find_scenario(name_or_path) / folder_files.DESCRIPTION_FILE).summary


def _text(path: Path, remedy: str = WRITE_AGAIN) -> str:
    """Return the text of a UTF-8 file; a ScenarioError ends with the advice ``remedy``."""
    try:
        return read_regular_file(path, remedy).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path} cannot be read ({error}): {remedy}.") from error
