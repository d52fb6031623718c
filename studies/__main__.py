"""Runs the studies behind the published tables and figures: ``python -m studies NAME``."""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from drl_av.cli.console import Bar, exit_status, progress_bar
from drl_av.cli.options import config_files, int_at_least
from drl_av.config.section import did_you_mean
from drl_av.errors import pluralize
from drl_av.evaluation import LOKY, RAY
from drl_av.evaluation.engines import require_ray
from studies.engine import draw, make
from studies.options import QUICK, RESULTS, Options
from studies.registry import STUDIES, Study
from studies.study import FileStudy


def command_line() -> argparse.ArgumentParser:
    """Build the argument parser."""
    usual = Options()
    meanings = "; ".join(f"{name}: {each.meaning}" for name, each in STUDIES.items())
    parser = argparse.ArgumentParser(
        "python -m studies", description=__doc__, argument_default=argparse.SUPPRESS
    )
    parser.add_argument(
        "names",
        nargs="*",
        default=[],
        metavar="NAME",
        help=f"{meanings}; or a TOML file of your own (default: all)",
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        default=False,
        help="a quick form in a folder of its own: one training of a kind, two short episodes in "
        "each cell; its numbers mean nothing",
    )
    for name, dest, meaning in (
        ("--trainings", "most_trainings", "at most N seeds of each training"),
        ("--episodes", "most_episodes", "at most N evaluation episodes in each cell"),
        ("--jobs", "jobs", f"number of processes (default: {usual.jobs})"),
    ):
        parser.add_argument(name, dest=dest, type=int_at_least(1), metavar="N", help=meaning)
    parser.add_argument(
        "--engine",
        choices=(LOKY, RAY),
        help="loky: this machine; ray: the cluster at RAY_ADDRESS, or this machine",
    )
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="DIR",
        help="folder of the trainings, shared by all machines of a cluster "
        f"(default: {usual.runs})",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the results (default: docs/results)"
    )
    config_files(parser, "those of all drivers, but none that a study itself sets")
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = command_line()
    given = parser.parse_args(words)
    for name in given.names:
        if name not in STUDIES and not name.endswith(".toml"):
            hint = did_you_mean(name, STUDIES)
            parser.error(f"there is no study {name!r}{hint}; they are: {', '.join(STUDIES)}")
    return exit_status("studies", lambda: _run(given))


def _run(given: argparse.Namespace) -> int:
    """Run the chosen studies one after the other; return the exit status 0.

    Raises DrlAvError before the first episode if ``--engine`` is ``ray`` and Ray is not installed.
    """
    if vars(given).get("engine") == RAY:
        require_ray()
    options = _options(given)
    try:
        for name in given.names or STUDIES:
            study = STUDIES[name] if name in STUDIES else FileStudy(Path(name))
            with progress_bar(name, 0) as bar:
                _make(study, options, name, bar)
    except KeyboardInterrupt:
        print("studies: the same command continues from here.", file=sys.stderr)
        raise
    return 0


def _options(given: argparse.Namespace) -> Options:
    own = {name: value for name, value in vars(given).items() if name in Options._fields}
    own["config"] = tuple(given.config)
    if given.quick:
        out = own.get("out") or Path(tempfile.mkdtemp(prefix="quick-results-", dir=Path.cwd()))
        own = {"runs": out / "runs", "most_trainings": 1, "most_episodes": 2, **own}
        own |= {"out": out, "config": (str(QUICK), *given.config), "most_vehicles": 2}
    options = Options(**own)
    return options._replace(runs=options.runs.absolute())  # for a cluster


def _make(study: Study, options: Options, word: str, bar: Bar) -> None:
    done = 0
    with closing(make(study, options)) as steps:
        for progress in steps:
            done = progress.done
            bar.reach(*progress)
    path = options.out / f"{study.name}.csv"
    if done:
        bar.say(f"{path}: {pluralize(done, 'episode')} more")
    else:
        quick = f"; for a quick form in a folder of its own: python -m studies {word} --quick"
        bar.say(f"{path} is complete: nothing was driven{'' if options.most_episodes else quick}")
    for figure in draw(study, options.out):
        bar.say(str(figure))
    if options.out != RESULTS:  # where the documentation shows them
        for table in study.tables.values():
            bar.say(f"\n{table(options.out)}")


if __name__ == "__main__":
    sys.exit(main())
