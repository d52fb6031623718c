"""The verb ``config``: prints all settings with meaning, unit, bounds and source."""

import argparse

from drl_av.cli.settings import config_files
from drl_av.config import with_files
from drl_av.config.presets import PRESETS, preset
from drl_av.config.reference import SECTIONS, annotated_toml


def add_options(parser: argparse.ArgumentParser) -> None:
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
