"""The options of SUMO: those of an episode, and the user's."""

import itertools
import os
import re
import shlex
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType

from drl_av.config import Config
from drl_av.errors import ConfigError, ScenarioError
from drl_av.scenarios.safe_xml import DETECTORS, NO_FILE, parse_xml


def option_words(given: str | Sequence[str]) -> tuple[str, ...]:
    """Return SUMO options of the user as words, ``--NAME=VALUE`` as two.

    Raises:
        ConfigError: it is no text and no list of texts, the text has an open quotation mark, or an
            option is set by drl-av.
    """
    try:
        words = shlex.split(given) if isinstance(given, str) else given
    except ValueError as error:
        raise ConfigError(f"sumo_options is {given!r}: close its quotation mark.") from error
    if not isinstance(words, Sequence) or not all(isinstance(word, str) for word in words):
        raise ConfigError(
            f"sumo_options is {given!r}, but must be a text, such as '--fcd-output fcd.xml', or a "
            "list of texts."
        )
    parted = [part for word in words for part in word.split("=", word.startswith("--"))]
    for name in (word.lstrip("-") for word in parted if word.startswith("-")):
        if name in ("r", "route-files", "routes"):
            raise ConfigError(
                f"sumo_options has -{'-' * (len(name) > 1)}{name}, but drl-av places the vehicles: "
                "put types into additional_files of scenario.toml, or drive with drl_av.attach in "
                "a simulation of your own."
            )
        if name in SET_BY_US:
            raise ConfigError(f"sumo_options has {name}, which drl-av sets itself: leave it out.")
    return tuple(parted)


MOVES = {
    **dict.fromkeys(
        ("vehicle", "trip", "flow", "person", "personFlow", "container", "containerFlow"),
        "a vehicle or a person that the ego does not see",
    ),
    "variableSpeedSign": "a speed limit that the ego does not see",
    "rerouter": "closed lanes or new routes that the ego does not see",
    "vaporizer": "a place where vehicles vanish",
}
"""Elements of an additional file that the ego would have to see, and what each of them adds."""
WRITES = re.compile(
    r"^(-[lC]|--(.*[-.]output|.*log|log-file|.*-?dump|netstate|summary|(trip|person)info"
    r"|(vehroute|personroute)s|person-fcd|device\..*\.file|save-state\.(files|times|period)"
    r"|save-(configuration|config|template|schema)))$"
)
"""Options by which SUMO writes a file, with their synonyms."""
BY_VEHICLE = re.compile(r"^--device\.ssm\.(probability|explicit|deterministic)$")
"""Options by which SUMO writes a file for each vehicle, with its name."""
WRITTEN = {
    **dict.fromkeys((*DETECTORS, "vTypeProbe", "routeProbe"), "file"),
    "timedEvent": "dest",
    "calibrator": "output",
}
"""The attribute that names an output file, for each such element of an additional file."""


def require_what_the_ego_sees(words: Sequence[str]) -> None:
    """Raise ConfigError if an additional file of the user adds what the ego would not see."""
    for name, each in _elements(words):
        if adds := MOVES.get(each.tag):
            raise ConfigError(
                f"The additional file {name} has <{each.tag}>, {adds}: leave it out, or drive with "
                "drl_av.attach in a simulation of your own."
            )


DRIVES = re.compile(
    r"--(step-method\.ballistic|default\.action-step-length|time-to-teleport\..*"
    r"|device\.(driverstate|toc|bluelight|glosa)\..*)"
)
"""Options that change how vehicles drive, which the check ``strict`` cannot take into account."""


def require_usual_driving(words: Sequence[str]) -> None:
    """Raise ConfigError if an option of the user breaks what the check ``strict`` assumes."""
    if changed := next(filter(DRIVES.fullmatch, words), None):
        raise ConfigError(
            f"Under the check strict sumo_options must not have {changed}, because vehicles that "
            "drive otherwise keep to no bound: leave it out, or take the check paper "
            "(--safety-check paper)."
        )


def require_nothing_unseen(sumo: ModuleType) -> None:
    """Raise ConfigError if SUMO has loaded what the ego would not see, whatever file has it.

    ``sumo`` is the module libsumo or traci, in which SUMO has started without vehicles of ours.
    """
    unseen = sumo.variablespeedsign, sumo.calibrator, sumo.rerouter
    if sumo.simulation.getMinExpectedNumber() or any(each.getIDCount() for each in unseen):
        raise ConfigError(
            "By sumo_options SUMO has loaded vehicles, persons, calibrators, rerouters or variable "
            "speed signs, which the ego does not see: leave out the file that has them, or drive "
            "with drl_av.attach in a simulation of your own."
        )


def require_one_process(given: str | Sequence[str]) -> None:
    """Raise ConfigError if SUMO would write one file in several processes."""
    words = option_words(given)
    its = (f"the additional file {name}, which writes {file}" for name, file in _written(words))
    pairs = itertools.pairwise((*words, ""))
    own = (
        word
        for word, value in pairs
        if WRITES.search(word) or (BY_VEHICLE.search(word) and value not in ("0", "false"))
    )
    if written := next(itertools.chain(own, its), None):
        raise ConfigError(
            f"sumo_options has {written}, and several processes would write one file: take one "
            "process."
        )


def files_of_sumo(given: str | Sequence[str] | None) -> list[str]:
    """Return the files that SUMO writes by these options; raise ConfigError as ``option_words``.

    It puts ``output-prefix`` before the name of each, and looks for a file that an additional file
    names in the folder of that file.
    """
    words = option_words(given or ())
    pairs = [*itertools.pairwise(words)]
    prefix = dict(pairs).get("--output-prefix", "")
    files = [Path(file) for word, file in pairs if WRITES.search(word)]
    files += [Path(name).parent / file for name, file in _written(words)]
    return [str(file.parent / (prefix + file.name)) for file in files if file.name]


def _written(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each output file that the user's additional files name, behind the latter's name."""
    for name, each in _elements(words):
        file = each.get(WRITTEN.get(each.tag, ""), NO_FILE)
        if file not in (NO_FILE, os.devnull):
            yield name, file


def _elements(words: Sequence[str]) -> Iterator[tuple[str, ET.Element]]:
    """Yield the elements of the user's additional files, each behind the name of its file.

    A file that cannot be read is left to SUMO, and files that it includes are not looked at.
    """
    pairs = itertools.pairwise(words)
    for name in (n for word, text in pairs if word in ADDITIONAL_FILES for n in text.split(",")):
        with suppress(ScenarioError):
            for each in parse_xml(Path(name.strip()), ET.TreeBuilder(), "").iter():
                yield name.strip(), each


def start_arguments(
    files: Sequence[str], seed: int, config: Config, own: Sequence[str] = ()
) -> list[str]:
    """Return the command line arguments of SUMO for a scenario.

    ``files`` holds the network file and then the additional files; ``seed`` seeds SUMO. ``own``
    are the words of ``option_words``; their additional files are read after ours.
    """
    additional, others, words = [*files[1:]], list[str](), iter(own)
    for word in words:
        if word in ADDITIONAL_FILES:
            additional.append(next(words, ""))
        else:
            others.append(word)
    return [
        *("--net-file", files[0]),
        *("--additional-files", ",".join(filter(None, additional))),
        *("--seed", str(seed % 2**31)),
        *("--step-length", repr(config.simulation.step_length_s)),
        *("--lateral-resolution", repr(config.simulation.lateral_resolution_m)),
        *("--lanechange.overtake-right", str(config.traffic.overtake_right).lower()),
        *("--time-to-teleport", "-1"),
        *("--collision.action", "warn"),
        *("--collision.mingap-factor", "0"),
        *("--collision.check-junctions", "true"),
        *("--insertion-checks", "none"),
        *("--no-step-log", "true"),
        *("--no-warnings", "true"),
        *("--xml-validation", "never"),
        *others,
    ]


ADDITIONAL_FILES = ("-a", "--additional-files", "--additional")
CONTROL = {"remote-port", "num-clients"}
"""The options with which SUMO waits for a program that controls it."""
WINDOW = {"start", "S", "quit-on-end", "Q", "gui-settings-file", "g", "window-size"}
"""The options of sumo-gui that a replay sets."""
SET_BY_US = {"n", "net", "c", "configuration", "configuration-file", *CONTROL, *WINDOW} | {
    word.removeprefix("--")
    for word in start_arguments(["", ""], 0, Config())
    if word.startswith("--") and word not in ADDITIONAL_FILES
}
"""The options that the user may not set."""
