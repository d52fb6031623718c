"""Runs the studies behind the published tables and figures: ``python -m studies NAME``."""

import argparse
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from drl_av.cli.arguments import int_at_least
from drl_av.cli.console import progress_bar
from drl_av.cli.settings import config_files
from drl_av.cli.status import exit_status
from drl_av.config.schema import did_you_mean
from drl_av.evaluation.engines import require_ray
from studies.experiment import reproduce as make
from studies.options import ENGINES, VARIANTS, ReproduceOptions
from studies.registry import EXPERIMENTS


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments to a parser."""
    usual = ReproduceOptions()
    meanings = "; ".join(f"{name}: {each.meaning}" for name, each in EXPERIMENTS.items())
    parser.add_argument(
        "experiments",
        nargs="*",
        type=_experiment,
        metavar="EXPERIMENT",
        help=f"{meanings} (default: all)",
    )
    numbers = {
        "--seeds": (usual.seeds, "trainings of each variant; the paper has 200"),
        "--episodes": (usual.episodes, "episodes of each training, of a schedule of 10000"),
        "--full-seeds": (
            usual.full_seeds,
            "trainings that continue to the schedule's end; fast and adaptation have at least one",
        ),
        "--drives": (usual.drives, "evaluation episodes at each number of vehicles"),
        "--jobs": (usual.jobs, "parallel processes on this machine"),
    }
    for option, (default, meaning) in numbers.items():
        low = 0 if option == "--full-seeds" else 1
        parser.add_argument(
            option, type=int_at_least(low), default=default, metavar="N", help=meaning
        )
    parser.add_argument(
        "--variants",
        nargs="+",
        choices=VARIANTS,
        default=VARIANTS,
        metavar="NAME",
        help=f"variants of the learning curves: {', '.join(VARIANTS)} (default: all)",
    )
    parser.add_argument(
        "--engine",
        choices=ENGINES,
        default=usual.engine,
        help="loky: this machine; ray: the cluster at RAY_ADDRESS, or this machine",
    )
    parser.add_argument(
        "--runs",
        type=Path,
        default=usual.runs,
        metavar="DIR",
        help="folder of the trainings; all machines of a cluster must share it",
    )
    parser.add_argument(
        "--out", type=Path, default=usual.out, metavar="DIR", help="folder of the results"
    )
    config_files(parser, "each experiment's")


def _experiment(text: str) -> str:
    if text not in EXPERIMENTS:
        hint = did_you_mean(text, EXPERIMENTS)
        raise argparse.ArgumentTypeError(
            f"there is no experiment {text!r}{hint}; they are: {', '.join(EXPERIMENTS)}"
        )
    return text


def run(options: argparse.Namespace) -> int:
    """Run the chosen studies one after the other; return the exit status 0.

    Raises DrlAvError before the first episode if ``--engine`` is ``ray`` and Ray is not installed.
    """
    if options.engine == "ray":
        require_ray()
    asked = {key: value for key, value in vars(options).items() if key in ReproduceOptions._fields}
    absolute = {"runs": options.runs.absolute(), "config": tuple(options.config)}  # for a cluster
    wanted = ReproduceOptions(**asked)._replace(**absolute)
    try:
        for name in options.experiments or EXPERIMENTS:
            with progress_bar(name, 0) as bar, closing(make(EXPERIMENTS[name], wanted)) as steps:
                for progress in steps:
                    bar.reach(progress.done, progress.total, progress.label)
                    if progress.line:
                        bar.say(progress.line)
    except KeyboardInterrupt:
        print("studies: the same command continues from here.", file=sys.stderr)
        raise
    return 0


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser("python -m studies", description=__doc__)
    add_options(parser)
    options = parser.parse_args(words)
    return exit_status("studies", lambda: run(options))


if __name__ == "__main__":
    sys.exit(main())
