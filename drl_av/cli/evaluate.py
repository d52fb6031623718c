"""The verb ``evaluate``: compares drivers on the same seeded traffic."""

import argparse
import sys
import time
from contextlib import closing
from pathlib import Path

from drl_av.cli.arguments import whole
from drl_av.cli.settings import driving, overridden
from drl_av.cli.status import INTERRUPTED
from drl_av.drivers.registry import default_config, driver_names, find_drivers
from drl_av.evaluation import DENSITIES

SAVE_EVERY_S = 5.0
"""Interval between two writes of the table; if SUMO aborts the process, newer rows are lost."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av evaluate`` to its parser."""
    parser.add_argument(
        "runs", nargs="*", metavar="RUN", help="folders of runs (default: the shipped driver)"
    )
    parser.add_argument(
        "--driver",
        nargs="+",
        default=[],
        metavar="NAME",
        help=f"more drivers: {', '.join(driver_names())} (the shipped driver), runs, your own "
        "factory as module:factory, a stable-baselines3 .zip file, or an .onnx file",
    )
    parser.add_argument(
        "--vehicles",
        nargs="+",
        type=whole(0),
        metavar="N",
        help=f"numbers of vehicles around the ego (default: {' '.join(map(str, DENSITIES))})",
    )
    parser.add_argument(
        "--episodes", type=whole(1), default=50, metavar="N", help="episodes per number of vehicles"
    )
    parser.add_argument(
        "--seed",
        type=whole(0),
        default=0,
        metavar="S",
        help="traffic seed of the first episode, below 1000000",
    )
    parser.add_argument("--jobs", type=whole(1), default=1, metavar="N", help="number of processes")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.csv", help="write a table with one row for each episode"
    )
    parser.add_argument("--json", type=Path, metavar="FILE.json", help="write the summary")
    driving(parser, "the first RUN's")


def evaluate(options: argparse.Namespace) -> int:
    """Drive all episodes, write one row for each, print the summary; return the exit status.

    If ``--out`` exists already, it is replaced only after the last episode.
    """
    from drl_av.cli.console import print_summaries, progress_bar
    from drl_av.env.metrics import EpisodeResult
    from drl_av.evaluation.comparison import Evaluation
    from drl_av.evaluation.statistics import summarize, write_summaries
    from drl_av.files import require_writable, write_table

    words = [*options.runs, *options.driver]
    require_writable(options.out, options.json, inputs=[options.config, *words])
    specs = find_drivers(words or ["pretrained"])
    config = overridden(default_config(specs), options)
    seeds = range(options.seed, options.seed + options.episodes)
    evaluation = Evaluation(config, specs, tuple(options.vehicles or ()), seeds)
    kept = _partial(options.out) if options.out and options.out.exists() else options.out
    rows, status, saved_s = [], 0, time.monotonic()
    try:
        with (
            progress_bar("evaluating", len(evaluation)) as bar,
            closing(evaluation.rows(options.jobs)) as found,
        ):
            for row in found:
                rows.append(row)
                bar.advance(f"{row.driver}, {row.vehicles} vehicles", row.decisions)
                if kept and time.monotonic() - saved_s > SAVE_EVERY_S:
                    write_table(kept, EpisodeResult, rows)
                    saved_s = time.monotonic()
    except KeyboardInterrupt:
        status = INTERRUPTED
        print(f"drl-av: interrupted after {len(rows)} episodes.", file=sys.stderr)
    finally:
        if rows and kept:
            write_table(kept, EpisodeResult, rows)
    if rows and kept != options.out and status == 0:
        write_table(options.out, EpisodeResult, rows)
        kept.unlink()
    elif rows and kept != options.out:
        print(f"drl-av: {options.out} is unchanged; the new rows are in {kept}.", file=sys.stderr)
    if rows and options.json:
        write_summaries(options.json, summarize(rows))
    if rows:
        print_summaries(summarize(rows))
    return status


def _partial(table: Path) -> Path:
    """Return the path of the temporary file for new rows, ``NAME.partial.csv`` beside the table."""
    return table.with_name(f"{table.stem}.partial{table.suffix}")
