"""The command ``drl-av``: parses the arguments and runs a verb; each verb imports what it needs."""

import argparse
import sys
from collections.abc import Callable, Container, Sequence
from typing import NamedTuple

from drl_av import __version__
from drl_av.cli import evaluate, export, figures, learning, options, replay, scenario
from drl_av.cli.console import exit_status
from drl_av.config.section import did_you_mean


class Verb(NamedTuple):
    """A verb (subcommand) of ``drl-av``."""

    meaning: str
    """The verb's description in the help, one phrase."""
    add_options: Callable[[argparse.ArgumentParser], None]
    """The function that adds the verb's arguments to its parser."""
    run: Callable[[argparse.Namespace], int]
    """The function that runs the verb and returns the exit status."""


VERBS = {
    "scenario": Verb(
        "write a scenario folder for SUMO and drl-av", scenario.add_options, scenario.scenario
    ),
    "train": Verb(
        "train a driver (Algorithm 1, or PPO by a preset large)",
        learning.add_train_options,
        learning.train,
    ),
    "evaluate": Verb(
        "compare drivers on the same seeded traffic", evaluate.add_options, evaluate.evaluate
    ),
    "adapt": Verb(
        "keep training a driver while it drives (continual adaptation)",
        learning.add_adapt_options,
        learning.adapt,
    ),
    "replay": Verb("show a driver or a recorded episode", replay.add_options, replay.replay),
    "export": Verb("write a trained driver as an ONNX file", export.add_options, export.export),
    "config": Verb(
        "print all settings with their meaning", options.add_config_options, options.config
    ),
    "figures": Verb("draw the figures of tables and runs", figures.add_options, figures.figures),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line ``arguments``, by default those of this process.

    Returns the exit status: 0 for success, 1 after an error (one sentence on stderr), 130 after
    Ctrl-C. Bad usage raises SystemExit with status 2.
    """
    words = sys.argv[1:] if arguments is None else arguments

    def run() -> int:
        parser = command_line(words)
        if not words:
            parser.print_help()
            return 0
        if not words[0].startswith("-") and words[0] not in VERBS:
            parser.error(
                f"there is no verb {words[0]!r}{did_you_mean(words[0], VERBS)}; the verbs are: "
                f"{', '.join(VERBS)}"
            )
        given = parser.parse_args(words, argparse.Namespace(words=words))
        verb: Verb = given.verb
        return verb.run(given)

    return exit_status("drl-av", run)


def command_line(verbs: Container[str] = VERBS) -> argparse.ArgumentParser:
    """Build the argument parser of all verbs; only the verbs in ``verbs`` get their options.

    ``main`` passes the words of the command line, so that the other verbs import no modules for
    their options. The parser stores the chosen Verb as the attribute ``verb`` of the namespace, in
    which ``main`` stores the words of the command line as ``words``.
    """
    parser = argparse.ArgumentParser(
        prog="drl-av",
        description="Learn to drive on a highway, safely, in SUMO.",
        epilog="Every verb has its own --help.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"drl-av {__version__}")
    parsers = parser.add_subparsers(required=True, metavar="VERB")
    for name, verb in VERBS.items():
        own = parsers.add_parser(
            name,
            help=verb.meaning,
            description=f"{verb.meaning[0].upper()}{verb.meaning[1:]}.",
            formatter_class=_Help,
            allow_abbrev=False,
        )
        own.set_defaults(verb=verb)
        if name in verbs:
            verb.add_options(own)
    return parser


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Formats a verb's help with the defaults of its options, except None, False and []."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        none = action.default is None or action.default is False or action.default == []
        stated = "default" in (action.help or "")
        return action.help if none or stated else super()._get_help_string(action)
