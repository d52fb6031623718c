"""What can be said to ``drl-av``: every verb's options, with their units and defaults."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path

from drl_av import __version__
from drl_av.cli.arguments import rate as _rate
from drl_av.cli.arguments import whole as _whole
from drl_av.cli.reproduction import add_options as _reproduce_options
from drl_av.config import REPLAYS, SAFETY_CHECKS, Config, load_config
from drl_av.presets import PRESETS
from drl_av.studies import DENSITIES

Verb = Callable[[argparse.Namespace], int]


def command_line(verbs: Mapping[str, Verb]) -> argparse.ArgumentParser:
    """The parser; what it returns holds the verb that was asked for as ``verb``."""
    parser = argparse.ArgumentParser(
        prog="drl-av",
        description="Learn to drive on a highway, safely, in SUMO.",
        epilog="Every verb has its own --help.",
        formatter_class=_Verbs,
    )
    parser.add_argument("--version", action="version", version=f"drl-av {__version__}")
    parsers = parser.add_subparsers(required=True, metavar="VERB")
    for name, verb in verbs.items():
        meaning, add_options = _VERBS[name]
        own = parsers.add_parser(
            name,
            help=meaning,
            description=f"{meaning[0].upper()}{meaning[1:]}.",
            formatter_class=_Help,
        )
        own.set_defaults(verb=verb)
        add_options(own)
    return parser


class _Verbs(argparse.HelpFormatter):
    """Tells what a verb does beside its name, for whose indentation argparse leaves no room."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = 13


class _Help(argparse.ArgumentDefaultsHelpFormatter):
    """Tells the defaults, but those that are none."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        none = action.default is None or action.default is False or action.default == []
        told = "default" in (action.help or "")
        return action.help if none or told else super()._get_help_string(action)


def _driving(parser: argparse.ArgumentParser, whose: str) -> None:
    parser.add_argument(
        "--scenario",
        metavar="DIR",
        help=f"scenario folder, or the name of a shipped one (default: {whose})",
    )
    parser.add_argument(
        "--safety-check",
        metavar="NAME",
        help=f"one of: {', '.join(SAFETY_CHECKS)} (default: {whose})",
    )
    parser.add_argument(
        "--config", metavar="FILE.toml", help=f"settings as TOML, laid over {whose}"
    )


def overridden(config: Config, options: argparse.Namespace) -> Config:
    """Lay what the command line says over a config."""
    config = load_config(options.config, config)
    if options.scenario is not None:
        config = config.updated("simulation", scenario=options.scenario)
    if options.safety_check is not None:
        config = config.updated("safety", check=options.safety_check)
    folder = Path(config.simulation.scenario)
    if folder.is_dir():
        config = config.updated("simulation", scenario=str(folder.absolute()))
    return config


def _scenario(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to write; must be new")
    parser.add_argument(
        "--circumference-m", type=float, default=500.0, metavar="M", help="every lane's, in metres"
    )
    parser.add_argument("--lanes", type=_whole(1), default=3, metavar="N", help="number of lanes")
    parser.add_argument(
        "--lane-width-m", type=float, default=3.8, metavar="M", help="every lane's, in metres"
    )
    parser.add_argument(
        "--barricade",
        type=_whole(0),
        nargs="+",
        default=(),
        metavar="LANE",
        help="lanes to close, 0 the rightmost (default: none)",
    )


def _train(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, required=True, metavar="RUN", help="the run's folder; must be new"
    )
    parser.add_argument(
        "--preset", metavar="NAME", help=f"one of: {', '.join(PRESETS)} (default: paper)"
    )
    numbers = ", ".join(f"{name} {found.learning.episodes}" for name, found in PRESETS.items())
    parser.add_argument(
        "--episodes",
        type=_whole(1),
        metavar="N",
        help=f"of at most 200 s each (default: the preset's, {numbers})",
    )
    parser.add_argument(
        "--seed", type=_whole(0), metavar="S", help="of all that is random (default: the preset's)"
    )
    parser.add_argument(
        "--replay", metavar="KIND", help=f"one of: {', '.join(REPLAYS)} (default: the preset's)"
    )
    _driving(parser, "the preset's")
    parser.add_argument("--resume", action="store_true", help="go on where the run was stopped")
    parser.add_argument(
        "--tensorboard", action="store_true", help="also write TensorBoard events into the run"
    )


def _evaluate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", nargs="*", metavar="RUN", help="runs' folders (default: the driver that ships)"
    )
    parser.add_argument(
        "--driver",
        nargs="+",
        default=[],
        metavar="NAME",
        help="also these: idm, idm-mobil, idm-sumo, random, pretrained (which ships), or RUNs",
    )
    parser.add_argument(
        "--vehicles",
        nargs="+",
        type=_whole(0),
        metavar="N",
        help=f"numbers of vehicles around the ego (default: {' '.join(map(str, DENSITIES))})",
    )
    parser.add_argument(
        "--episodes", type=_whole(1), default=50, metavar="N", help="for each number of vehicles"
    )
    parser.add_argument(
        "--seed",
        type=_whole(0),
        default=0,
        metavar="S",
        help="of the first episode's traffic, below 1000000",
    )
    parser.add_argument("--jobs", type=_whole(1), default=1, metavar="N", help="processes")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write a row an episode")
    parser.add_argument("--json", type=Path, metavar="FILE.json", help="write the summary")
    _driving(parser, "the first RUN's")


def _adapt(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run",
        nargs="?",
        metavar="RUN",
        help="folder of the run to begin from (default: the driver that ships)",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="RUN2", help="the new run's folder; must be new"
    )
    parser.add_argument(
        "--episodes", type=_whole(1), metavar="N", help="of at most 200 s each (default: 30000)"
    )
    parser.add_argument(
        "--learning-rate",
        type=float,
        metavar="X",
        help="Adam's step size; 0 learns nothing, on the same traffic (default: 1e-05)",
    )
    parser.add_argument(
        "--seed", type=_whole(0), metavar="S", help="of all that is random (default: the RUN's)"
    )
    _driving(parser, "the RUN's")
    parser.add_argument(
        "--resume", action="store_true", help="go on where RUN2 was stopped; needs no RUN"
    )
    parser.add_argument(
        "--tensorboard", action="store_true", help="also write TensorBoard events into RUN2"
    )


def _replay(parser: argparse.ArgumentParser) -> None:
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "source",
        nargs="?",
        metavar="RUN | RECORDING",
        help="a run's folder, or what --record kept (default: the driver that ships)",
    )
    which.add_argument(
        "--driver", metavar="NAME", help="idm, idm-mobil, idm-sumo, random or pretrained"
    )
    parser.add_argument("--seed", type=_whole(0), metavar="S", help="of the traffic (default: 0)")
    parser.add_argument(
        "--vehicles", type=_whole(0), metavar="N", help="vehicles around the ego (default: 15)"
    )
    parser.add_argument(
        "--decisions",
        type=_whole(1),
        metavar="N",
        help="at most so many, one a second (default: the RUN's, 200)",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--gui", action="store_true", help="in sumo-gui (default)")
    how.add_argument("--video", type=Path, metavar="FILE.mp4", help="as .mp4 or .gif, no screen")
    parser.add_argument("--rate", type=_rate, default=2.0, metavar="X", help="times real time")
    parser.add_argument("--record", type=Path, metavar="FILE.npz", help="keep the episode")
    _driving(parser, "the RUN's")


def _figures(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="FILE.csv | RUN | RESULTS",
        help="tables that evaluate wrote, in m/s, folders of runs, and of reproduce's results",
    )
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder for them")


_VERBS: dict[str, tuple[str, Callable[[argparse.ArgumentParser], None]]] = {
    "scenario": ("write a scenario folder for SUMO and drl-av", _scenario),
    "train": ("train a driver (Algorithm 1)", _train),
    "evaluate": ("compare drivers on the same seeded traffic", _evaluate),
    "adapt": ("drive greedily, and go on learning (continuous adaptation)", _adapt),
    "replay": ("watch a driver, or a recorded episode again", _replay),
    "figures": ("draw the paper's figures as PNG files", _figures),
    "reproduce": (
        "make the paper's results anew, going on where it stopped",
        _reproduce_options,
    ),
}
