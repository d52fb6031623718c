"""Adds the options that all verbs with an environment share, and applies them to a config."""

import argparse
import sys
from contextlib import suppress

from drl_av.config import TRAFFIC_PRESETS, Config, with_files
from drl_av.drivers.registry import driver_names
from drl_av.errors import ScenarioError
from drl_av.safety import CHECKS
from drl_av.scenarios.folder import summary_of, with_scenario


def driver_words() -> str:
    """Return the help text of an option for a driver: all forms that the option accepts."""
    return (
        f"{', '.join(driver_names())} (each pretrained one ships with drl-av), the folder of a "
        "run, a policy's .safetensors file, a stable-baselines3 .zip file, an .onnx file, or your "
        "own factory as module:factory"
    )


def add_env_options(parser: argparse.ArgumentParser, whose: str) -> None:
    """Add --scenario, --safety-check, --traffic and --config to a parser.

    ``whose`` names the source of the defaults in the help, for example "the RUN's".
    """
    parser.add_argument(
        "--scenario",
        metavar="DIR",
        help=f"scenario folder, or the name of a shipped one (default: {whose})",
    )
    parser.add_argument(
        "--safety-check",
        metavar="NAME",
        help=f"one of: {', '.join(CHECKS)} (default: {whose})",
    )
    parser.add_argument(
        "--traffic",
        metavar="KIND",
        help=f"one of: {', '.join(TRAFFIC_PRESETS)} (default: {whose} [traffic])",
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


def with_command_line(config: Config, options: argparse.Namespace) -> Config:
    """Return ``config``, changed by --traffic, --config, --scenario and --safety-check in turn.

    If the scenario was made from the user's own files, it says on stderr what was made of them.
    Raises ConfigError if the TOML file or a setting is wrong.
    """
    if options.traffic is not None:
        config = config.with_traffic(options.traffic)
    config = with_files(config, options.config)
    if options.safety_check is not None:
        config = config.updated("safety", check=options.safety_check)
    config = with_scenario(config, options.scenario)
    with suppress(ScenarioError):  # which the verb reports when it loads the scenario
        if summary := summary_of(config.simulation.scenario):
            print(summary, file=sys.stderr)
    return config
