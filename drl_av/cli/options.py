"""Options that several verbs share, the conversion of their words, and the verb ``config``."""

import argparse
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from drl_av.config import SETTING, TRAFFIC_PRESETS, Config, with_files
from drl_av.config.functions import is_factory
from drl_av.config.presets import PRESETS, keeping_kind, preset, require_driving_setting
from drl_av.config.reference import SECTIONS, annotated_toml
from drl_av.config.simulation import WORLDS
from drl_av.drivers.agent import UNPICKLED
from drl_av.drivers.registry import driver_names
from drl_av.errors import ConfigError, ScenarioError
from drl_av.safety import CHECKS
from drl_av.scenarios.folder import summary_of, with_scenario

if TYPE_CHECKING:
    from drl_av.env.custom import CustomParts


def rate(text: str) -> float:
    """Convert a word to a multiple of real time, from 0.01 to 1000."""
    number = float(text)
    if not 0.01 <= number <= 1000:
        raise argparse.ArgumentTypeError(f"{text} is not from 0.01 to 1000")
    return number


rate.__name__ = "number"


def int_at_least(low: int) -> Callable[[str], int]:
    """Return the function that converts a word to a whole number of at least ``low``."""

    def parse(text: str) -> int:
        number = int(text)
        if number < low:
            raise argparse.ArgumentTypeError(f"{number} is less than {low}")
        return number

    parse.__name__ = "whole number"
    return parse


def numbers_of_vehicles(text: str) -> list[int]:
    """Convert whole numbers from 0 on, separated by commas, to a list."""
    try:
        return [int_at_least(0)(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a whole number; name drivers before it, or behind --driver"
        ) from None


Options = argparse.ArgumentParser | argparse._MutuallyExclusiveGroup
"""What options are added to: the parser of a verb, or a group of it."""


def add_number(
    parser: Options, name: str, low: int, meaning: str, default: int | None = None, shown: str = "N"
) -> None:
    """Add an option for a whole number of at least ``low``, which the help shows as ``shown``."""
    parser.add_argument(name, type=int_at_least(low), default=default, metavar=shown, help=meaning)


def add_path(parser: Options, name: str, shown: str, meaning: str, needed: bool = False) -> None:
    """Add an option for a path, which the help shows as ``shown``."""
    parser.add_argument(name, type=Path, metavar=shown, help=meaning, required=needed)


def add_text(parser: Options, name: str, shown: str, meaning: str) -> None:
    """Add an option for a word, which the help shows as ``shown``."""
    parser.add_argument(name, metavar=shown, help=meaning)


def add_flag(parser: Options, name: str, meaning: str) -> None:
    """Add an option that is either given or not."""
    parser.add_argument(name, action="store_true", help=meaning)


def driver_words() -> str:
    """Return the help text of an option for a driver: all forms that the option accepts."""
    return (
        f"{', '.join(driver_names())} (each pretrained one ships with drl-av), the folder of a "
        "run, a policy's .safetensors file, a stable-baselines3 .zip file, an .onnx file, or your "
        "own factory as module:factory; @CHECK after it names its safety check, as in "
        "pretrained@paper"
    )


def add_observation(parser: argparse.ArgumentParser) -> None:
    """Add the option of an observation other than the indicators to a verb that only drives."""
    observation = (
        "wide, a group of numbers by its name, or your own observation or tuple of groups as "
        "module:name (default: the 27 indicators)"
    )
    add_text(parser, "--observation", "NAME", observation)


def add_env_options(parser: argparse.ArgumentParser, whose: str, zips: bool = True) -> None:
    """Add the options of an environment to a parser: scenario, traffic, check, reward, settings.

    ``whose`` names the source of the defaults in the help, for example "the RUN's"; ``zips`` says
    whether the verb loads zip files.
    """
    if zips:
        parser.epilog = " ".join(filter(None, [parser.epilog, UNPICKLED]))
    of_run = whose.endswith("RUN's")  # else of the settings from which a training begins
    scenario = f"scenario folder, or the name of a shipped one (default: {whose})"
    add_text(parser, "--scenario", "DIR", scenario)
    parser.add_argument(
        "--world",
        choices=WORLDS,
        help="sumo, or the twin: SUMO's traffic, compiled, and so faster (default: "
        f"that of the settings{', but sumo for a RUN in the twin' * of_run})",
    )
    check = f"one of: {', '.join(CHECKS)}, or your own as module:function (default: {whose})"
    add_text(parser, "--safety-check", "NAME", check)
    drawn = ", but paper, or calm on an open road, for a RUN that drew kinds" * of_run
    traffic = f"one of: {', '.join(TRAFFIC_PRESETS)} (default: {whose} [traffic]{drawn})"
    add_text(parser, "--traffic", "KIND", traffic)
    reward = "your own reward as module:function (default: the paper's)"
    add_text(parser, "--reward", "NAME", reward)
    parser.add_argument(
        "--sumo-options",
        metavar="WORDS",
        default=(),
        help="options of SUMO itself, after = and in quotation marks, such as "
        "--sumo-options='--additional-files detectors.add.xml'; SUMO then starts again for each "
        "episode, and an output file holds the last one (default: none)",
    )
    config_files(parser, whose)


def config_files(parser: argparse.ArgumentParser, whose: str) -> None:
    """Add --config; the help says that the files replace ``whose`` settings."""
    parser.add_argument(
        "--config",
        action="append",
        default=[],
        metavar="FILE.toml",
        help=f"TOML settings that replace {whose}; given again, a file is laid over those before",
    )
    parser.add_argument(
        "-o",
        dest="config",
        action="append",
        type=_setting,
        metavar="SECTION.KEY=VALUE",
        help="one setting, such as traffic.truck_share=0.2, laid over those and files before it; "
        "traffic.kind resets the section",
    )


def _setting(text: str) -> str:
    if not SETTING.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} does not have the form SECTION.KEY=VALUE, such as traffic.truck_share=0.2"
        )
    return text


SETTINGS_OF_OPTIONS = {
    "traffic": "traffic.kind",
    "world": "simulation.world",
    "safety_check": "safety.check",
    "scenario": "simulation.scenario",
}
"""The settings for which ``add_env_options`` adds options."""


def require_one_word(options: argparse.Namespace, settings: Mapping[str, str]) -> None:
    """Raise ConfigError if the user gives an option and -o for the same one of ``settings``."""
    for option, setting in settings.items():
        if getattr(options, option, None) is not None and any(
            str(word).startswith(f"{setting}=") for word in options.config
        ):
            raise ConfigError(
                f"--{option.replace('_', '-')} and -o {setting} are the same setting: leave one of "
                "them out."
            )


def require_driving_settings(options: argparse.Namespace) -> None:
    """Raise ConfigError if -o names a setting of trainings: a driver drives as it has learned."""
    for word in map(str, options.config):
        if found := SETTING.match(word):
            require_driving_setting("{}.{}".format(*found.groups()), f"-o {word}", "--vehicles")


def with_command_line(config: Config, options: argparse.Namespace) -> Config:
    """Return ``config``, changed by the options of ``add_env_options`` in turn.

    If the scenario was made from the user's own files, it says on stderr what was made of them.
    Raises ConfigError if the TOML file or a setting is wrong.
    """
    require_one_word(options, SETTINGS_OF_OPTIONS)
    if options.traffic is not None:
        config = config.with_traffic(options.traffic)
    config = keeping_kind(options.traffic, config, with_files(config, options.config))
    if options.world is not None:
        config = config.updated("simulation", world=options.world)
    if options.safety_check is not None:
        config = config.updated("safety", check=options.safety_check)
    config = with_scenario(config, options.scenario, options.traffic)
    with suppress(ScenarioError):  # which the verb reports when it loads the scenario
        if summary := summary_of(config.simulation.scenario):
            print(summary, file=sys.stderr)
    return config


def custom_parts(options: argparse.Namespace) -> "CustomParts":
    """Return the user's own check, reward and observation of the command line.

    Raises ConfigError if the reward does not have the form ``module:name``.
    """
    from drl_av.env.custom import CustomParts

    check = options.safety_check
    custom = CustomParts(
        check if check is not None and is_factory(check) else None,
        options.reward,
        getattr(options, "observation", None),
        options.sumo_options,
    )
    if custom.reward is not None and not is_factory(str(custom.reward)):
        raise ConfigError(f"--reward is {custom.reward!r}, but must have the form module:name.")
    return custom


def add_config_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av config`` to its parser."""
    parser.add_argument(
        "section",
        nargs="?",
        metavar="SECTION",
        help=f"one of: {', '.join(SECTIONS)} (default: all)",
    )
    parser.add_argument(
        "--preset", default="paper", metavar="NAME", help=f"one of: {', '.join(PRESETS)}"
    )
    config_files(parser, "the preset's")


def config(options: argparse.Namespace) -> int:
    """Print the settings as TOML with comments; return the exit status 0."""
    settings = with_files(preset(options.preset), options.config)
    print(annotated_toml(settings, options.section), end="")
    return 0
