"""The verb ``evaluate``: compares drivers on the same seeded traffic."""

import argparse
import json
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.cli.arguments import int_at_least
from drl_av.cli.settings import add_env_options, driver_words, with_command_line
from drl_av.cli.status import INTERRUPTED
from drl_av.config import Config
from drl_av.drivers.registry import baselines, default_config, find_drivers
from drl_av.errors import ConfigError, pluralize
from drl_av.evaluation import DENSITIES, PASS_CRITERION

if TYPE_CHECKING:
    from drl_av.env.metrics import EpisodeResult
    from drl_av.evaluation.paired import PairedGain

SAVE_EVERY_S = 5.0
"""Time between two writes of the table.

If SUMO aborts the process, the rows after the last write are lost.
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av evaluate`` to its parser."""
    parser.epilog = PASS_CRITERION
    parser.add_argument(
        "runs",
        nargs="*",
        metavar="RUN",
        help="drivers: folders of runs, or any name that --driver takes "
        "(default: the shipped driver, under strict)",
    )
    parser.add_argument(
        "--driver",
        nargs="+",
        default=[],
        metavar="NAME",
        help=f"more drivers: {driver_words()}",
    )
    parser.add_argument(
        "--vehicles",
        nargs="+",
        type=int_at_least(0),
        metavar="N",
        help=f"numbers of vehicles around the ego (default: {' '.join(map(str, DENSITIES))}; "
        "the scenario's number on an open road, or where it places the vehicles)",
    )
    parser.add_argument(
        "--episodes",
        type=int_at_least(1),
        default=50,
        metavar="N",
        help="episodes per number of vehicles",
    )
    parser.add_argument(
        "--seed",
        type=int_at_least(0),
        default=0,
        metavar="S",
        help="traffic seed of the first episode, below 1000000",
    )
    parser.add_argument(
        "--jobs", type=int_at_least(1), default=1, metavar="N", help="number of processes"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE.csv",
        help="write a table with one row for each episode, and FILE.provenance.json beside it",
    )
    parser.add_argument(
        "--criticality",
        action="store_true",
        help="also measure comfort and criticality; adds columns to --out",
    )
    parser.add_argument(
        "--require-pass",
        action="store_true",
        help="end with status 1 if a driver fails beside the rule-based ones; see below",
    )
    parser.add_argument("--json", type=Path, metavar="FILE.json", help="write the summary")
    add_env_options(parser, "the first RUN's")


def evaluate(options: argparse.Namespace) -> int:
    """Drive all episodes, write one row for each, and print the summary; return the exit status.

    The status is 1 if a driver fails and ``--require-pass`` is given, 130 after Ctrl-C, else 0. If
    the file ``--out`` or ``--json`` exists, it is replaced only after the last episode.
    """
    from drl_av.cli.console import progress_bar
    from drl_av.cli.tables import print_gains, print_overall, print_styles, print_summaries
    from drl_av.env.metrics import EpisodeMetrics
    from drl_av.evaluation.comparison import Evaluation
    from drl_av.evaluation.criterion import judge
    from drl_av.evaluation.criticality import CriticalityMetrics, styles
    from drl_av.evaluation.statistics import overall, summarize, write_summaries
    from drl_av.files import require_suffix, require_writable

    words = [*options.runs, *options.driver]
    inputs = [*options.config, *words]
    require_writable(options.out, options.json, inputs=inputs)
    require_suffix(options.out, ".csv")
    require_suffix(options.json, ".json")
    if options.out:
        require_writable(provenance_file(options.out), options.json, inputs=inputs)
    specs = find_drivers(words or ["pretrained"])
    if options.require_pass:
        _require_rivals([spec.name for spec in specs])
    config = with_command_line(default_config(specs), options)
    seeds = range(options.seed, options.seed + options.episodes)
    metrics = CriticalityMetrics if options.criticality else EpisodeMetrics
    evaluation = Evaluation(config, specs, tuple(options.vehicles or ()), seeds, metrics)
    kept = _kept(options.out)
    rows, status, saved_s = [], 0, time.monotonic()
    try:
        with (
            progress_bar("evaluating", len(evaluation)) as bar,
            closing(evaluation.rows(options.jobs)) as found,
        ):
            for row in found:
                rows.append(row)
                bar.advance(f"{row.driver}, {pluralize(row.vehicles, 'vehicle')}", row.decisions)
                if kept and time.monotonic() - saved_s > SAVE_EVERY_S:
                    _write_rows(kept, rows)
                    saved_s = time.monotonic()
    except KeyboardInterrupt:
        status = INTERRUPTED
        print(f"drl-av: interrupted after {pluralize(len(rows), 'episode')}.", file=sys.stderr)
    finally:
        if rows and kept:
            _write_rows(kept, rows)
    if rows and kept and kept != options.out and status == 0:
        _write_rows(options.out, rows)
        kept.unlink()
    elif rows and kept != options.out:
        print(f"drl-av: {options.out} is unchanged; the new rows are in {kept}.", file=sys.stderr)
    rules = baselines(row.driver for row in rows)
    summaries, found_styles = summarize(rows), styles(rows)
    overalls, judgements = (overall(rows, rules), judge(rows)) if status == 0 else ([], [])
    if rows and options.json and status and options.json.exists():
        print(f"drl-av: {options.json} is unchanged.", file=sys.stderr)
    elif rows and options.json:
        parts: dict[str, Iterable[Any]] = {
            "by_vehicles": summaries,
            "overall": overalls,
            "criticality": found_styles,
            "judgements": judgements,
        }
        write_summaries(options.json, parts)
    if rows and options.out and (status == 0 or kept == options.out):
        _write_provenance(options, config)
    if rows:
        print_summaries(summaries)
    if status == 0:
        if found_gains := gains(rows, rules):
            print_gains(found_gains)
        print_overall(overalls)
    if found_styles:
        print_styles(found_styles)
    for judgement in judgements:
        print(judgement)
    if status == 0 and not rules:
        print("For pass or fail drive a rule-based driver beside it, such as --driver gap-mobil.")
    failed = not all(judgement.passed for judgement in judgements)
    return 1 if failed and options.require_pass else status


def _require_rivals(names: Sequence[str]) -> None:
    """Raise ConfigError unless there is a rule-based driver and another one to judge."""
    rules = baselines(names)
    if not rules or len(rules) == len(names):
        raise ConfigError(
            "--require-pass compares a driver with a rule-based one, but the drivers are "
            f"{', '.join(names)}: name one of each kind, such as pretrained --driver gap-mobil."
        )


def _write_rows(table: Path, rows: Sequence["EpisodeResult"]) -> None:
    from drl_av.files import write_table

    cells = [row.cells() for row in rows]
    write_table(table, cells[0], cells)


def _write_provenance(options: argparse.Namespace, config: Config) -> None:
    """Write ``NAME.provenance.json`` beside the table: command, versions, machine and settings."""
    from drl_av.evaluation.provenance import provenance
    from drl_av.files import write_atomic

    seeds = f"{options.seed} to {options.seed + options.episodes - 1}"
    facts = provenance(config, seeds=seeds, settings=asdict(config))
    write_atomic(provenance_file(options.out), json.dumps(facts, indent=2).encode() + b"\n")


def provenance_file(table: Path) -> Path:
    """Return the path of the file with the provenance of a table (how it was made)."""
    return table.with_suffix(".provenance.json")


def gains(rows: Sequence["EpisodeResult"], rules: Sequence[str]) -> list["PairedGain"]:
    """Compute each other driver's gain over the fastest rule-based driver, at each density.

    Only the rule-based drivers that miss their exit or fail to merge least often count.
    """
    from drl_av.evaluation.paired import paired
    from drl_av.evaluation.statistics import fewest_missed

    names = list(dict.fromkeys(row.driver for row in rows))
    eligible = fewest_missed(rows, rules)
    if not eligible:
        return []
    found = [paired(rows, name, eligible) for name in names if name not in rules]
    return sorted((g for own in found for g in own if g.best), key=lambda gain: gain.vehicles)


def _kept(table: Path | None) -> Path | None:
    """Return the path at which to keep the rows of an evaluation before its end.

    It is ``NAME.partial.csv`` beside the table ``NAME.csv`` if this table exists.

    Raises:
        ConfigError: that file exists, so it has the rows of an interrupted evaluation.
    """
    if table is None or not table.exists():
        return table
    partial = table.with_name(f"{table.stem}.partial{table.suffix}")
    if partial.exists():
        raise ConfigError(
            f"{partial} has the rows of an interrupted evaluation: rename or remove it, or choose "
            "another --out."
        )
    return partial
