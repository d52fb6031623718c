"""The verb ``evaluate``: compares drivers on the same seeded traffic."""

import argparse
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.cli.console import INTERRUPTED
from drl_av.cli.options import (
    add_env_options,
    add_flag,
    add_number,
    add_observation,
    add_path,
    custom_parts,
    driver_words,
    numbers_of_vehicles,
    require_driving_settings,
    with_command_line,
)
from drl_av.drivers.registry import baselines, default_config, find_drivers
from drl_av.errors import ConfigError, pluralize
from drl_av.evaluation import (
    DENSITIES,
    LOKY,
    NEAR_MISS_DRAC_M_S2,
    NEAR_MISS_TTC_S,
    PASS_CRITERION,
    PROVENANCE,
    RAY,
)

if TYPE_CHECKING:
    from drl_av.env.metrics import EpisodeResult
    from drl_av.evaluation.episodes import Evaluation
    from drl_av.evaluation.table import ResultTable

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
        help="drivers: folders of runs; NAME=PATTERN, such as 'ppo=runs/seed-*', for several "
        "trainings of one kind; or any name that --driver takes "
        "(default: the shipped driver, under strict)",
    )
    parser.add_argument(
        "--driver", nargs="+", default=[], metavar="NAME", help=f"more drivers: {driver_words()}"
    )
    parser.add_argument(
        "--vehicles",
        nargs="+",
        type=numbers_of_vehicles,
        metavar="N",
        help=f"numbers of vehicles around the ego (default: {' '.join(map(str, DENSITIES))}; "
        "the scenario's number on an open road, or where it places the vehicles)",
    )
    add_number(parser, "--episodes", 1, "episodes per number of vehicles", 50)
    first = "traffic seed of the first episode, below 1000000"
    add_number(parser, "--seed", 0, first, 0, shown="S")
    add_number(parser, "--jobs", 1, "number of processes", 1)
    parser.add_argument(
        "--engine",
        choices=(LOKY, RAY),
        default=LOKY,
        help="loky: this machine; ray: the cluster at RAY_ADDRESS, or this machine",
    )
    add_path(
        parser,
        "--out",
        "FILE.csv",
        "write a table with one row for each episode, and FILE.provenance.json beside it; "
        "episodes that it has already are not driven again",
    )
    measures = "also measure comfort and criticality; adds columns to --out"
    add_flag(parser, "--criticality", measures)
    passes = "end with status 1 unless each driver passes beside the rule-based ones; see below"
    add_flag(parser, "--require-pass", passes)
    kept = parser.add_mutually_exclusive_group()
    add_path(kept, "--record", "DIR", "keep each episode that is driven as a recording")
    add_path(
        kept,
        "--record-failures",
        "DIR",
        f"keep the episodes with a collision or a time to collision of {NEAR_MISS_TTC_S:g} s "
        f"or less, with --criticality also those with a DRAC of {NEAR_MISS_DRAC_M_S2:g} m/s^2 or "
        "more",
    )
    add_path(parser, "--json", "FILE.json", "write the summary")
    add_env_options(parser, "the first RUN's, but those of trainings")
    add_observation(parser)


def evaluate(options: argparse.Namespace) -> int:
    """Drive the episodes, write one row for each, and print the summary; return the exit status.

    Episodes that the table ``--out`` has already are not driven. The status is 1 if a driver does
    not pass and ``--require-pass`` is given, 130 after Ctrl-C, else 0.

    Raises DrlAvError if the table exists and was made with other settings or drivers.
    """
    from drl_av.cli.tables import (
        print_gains,
        print_overall,
        print_styles,
        print_summaries,
        title_of,
    )
    from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
    from drl_av.evaluation.criterion import judge
    from drl_av.evaluation.criticality import CriticalityMetrics, styles
    from drl_av.evaluation.episodes import Evaluation, Setup, warn_of_checks
    from drl_av.evaluation.recording import RecordingFolder
    from drl_av.evaluation.statistics import (
        gains_over_fastest,
        grouped,
        overall,
        summarize,
        write_summaries,
    )
    from drl_av.files.atomic import make_folder, require_suffix, require_writable
    from drl_av.simulation.sumo_options import files_of_sumo

    if options.engine == RAY:
        from drl_av.evaluation.engines import require_ray

        require_ray()
    words = [*options.runs, *options.driver]
    inputs = [*options.config, *words, options.record, options.record_failures]
    by_sumo = files_of_sumo(options.sumo_options)
    require_writable(options.out, options.json, inputs=inputs, by_sumo=by_sumo)
    require_suffix(options.out, ".csv")
    require_suffix(options.json, ".json")
    if options.out:
        beside = options.out.with_suffix(PROVENANCE)
        require_writable(beside, options.json, inputs=inputs, by_sumo=by_sumo)
    specs = find_drivers(words or ["pretrained"])
    if options.require_pass:
        _require_rivals([spec.name for spec in specs])
    require_driving_settings(options)
    config = with_command_line(default_config(specs), options)
    if options.safety_check is None:
        warn_of_checks(specs, config.safety.check)
    seeds = range(options.seed, options.seed + options.episodes)
    metrics = CriticalityMetrics if options.criticality else EpisodeMetrics
    vehicles = tuple(number for part in options.vehicles or () for number in part)
    recordings = None
    if folder := options.record or options.record_failures:
        make_folder(folder, "--record" if options.record else "--record-failures")
        recordings = RecordingFolder(folder.absolute(), failures_only=not options.record)
    setup = Setup(config, specs, metrics, custom_parts(options), recordings)
    evaluation = Evaluation(setup, vehicles, seeds)
    table = _table(options.out, evaluation) if options.out else None
    driven, status = dict[tuple[int, int, str], EpisodeResult](), 0
    try:
        for row in _rows(evaluation, table, options):
            driven[row.vehicles, row.seed, row.driver] = row
    except KeyboardInterrupt:
        status = INTERRUPTED
        print(f"drl-av: interrupted after {pluralize(len(driven), 'episode')}.", file=sys.stderr)
    rows = [driven[job.key] for job in evaluation.jobs if job.key in driven]
    rules = baselines(row.driver for row in rows)
    summaries, found_styles = summarize(rows), styles(rows)
    rivals = rules or list(dict.fromkeys(row.group for row in rows if row.is_training))
    overalls, judgements = (overall(rows, rivals), judge(rows)) if status == 0 else ([], [])
    if rows and options.json and status and options.json.exists():
        print(f"drl-av: {options.json} is unchanged.", file=sys.stderr)
    elif rows and options.json:
        tables: dict[str, Iterable[Any]] = {
            "by_vehicles": summaries,
            "overall": overalls,
            "criticality": found_styles,
            "judgements": judgements,
        }
        write_summaries(options.json, tables)
    if config.simulation.world == "twin":
        print("Driven in the twin, not in SUMO.")
    if rows:
        print_summaries(summaries)
    title = title_of((row.compared_as, row.safety_check) for row in rows)
    if status == 0:
        if found_gains := gains_over_fastest(rows, rules):
            print_gains(found_gains, title)
        print_overall(overalls, title)
    if found_styles:
        print_styles(found_styles, title)
    for judgement in judgements:
        print(judgement)
    passed = {judgement.driver: judgement.passed for judgement in judgements}
    for group, own in grouped((r for r in rows if r.is_training), lambda row: row.group).items():
        if found := [passed[name] for name in {row.driver for row in own} & passed.keys()]:
            print(f"{group}: {sum(found)} of {pluralize(len(found), 'training')} pass")
    if status == 0 and not rules:
        print("For pass or fail drive a rule-based driver beside it, such as gap-mobil.")
    failed = not all(judgement.passed for judgement in judgements)
    return 1 if failed and options.require_pass else status


def _table(path: Path, evaluation: "Evaluation") -> "ResultTable":
    """Open the table of an evaluation; its rows are in the order in which they are driven."""
    from drl_av.env.custom import custom_inputs
    from drl_av.evaluation.table import Inputs, ResultTable, checksums

    ranks = [
        list(dict.fromkeys(each))
        for each in zip(*(job.key for job in evaluation.jobs), strict=True)
    ]

    def place(row: dict[str, str]) -> tuple[object, ...]:
        values = int(row["vehicles"]), int(row["seed"]), row["driver"]
        known = zip(ranks, values, strict=True)
        return tuple((rank.index(v), v) if v in rank else (len(rank), v) for rank, v in known)

    setup = evaluation.setup
    besides = custom_inputs(setup.config, setup.custom)
    inputs = Inputs({"": setup.config.without_training}, checksums(setup.specs), custom=besides)
    return ResultTable(path, inputs, place, PROVENANCE)


def _rows(
    evaluation: "Evaluation", table: "ResultTable | None", options: argparse.Namespace
) -> "Iterator[EpisodeResult]":
    """Yield the result of each episode: first those in the table, then the others, driven now."""
    from drl_av.cli.console import progress_bar
    from drl_av.env.metrics import USUAL, EpisodeResult
    from drl_av.evaluation.criticality import CriticalityResult
    from drl_av.evaluation.episodes import drive_episodes
    from drl_av.evaluation.table import report_corrupt_table, results_of, settings_mismatch
    from drl_av.files.table import column_types

    jobs, held = evaluation.jobs, set[tuple[int, int, str]]()
    if table:
        kind = CriticalityResult if options.criticality else EpisodeResult
        columns = column_types(kind).keys()
        if other := ({*next(iter(table.rows), columns)} ^ columns) - USUAL.keys():
            raise settings_mismatch(table.path, table.beside, f"column {min(other)}")
        with report_corrupt_table(table.path):
            results = results_of(table.rows, kind)
        wanted = {job.key for job in jobs}
        found_there = [row for row in results if (row.vehicles, row.seed, row.driver) in wanted]
        held = {(row.vehicles, row.seed, row.driver) for row in found_there}
        yield from found_there
        if held and (options.record or options.record_failures):
            print(
                f"drl-av: {table.path} has {pluralize(len(held), 'episode')} already, not driven "
                "again and not recorded: choose another --out to record them.",
                file=sys.stderr,
            )
    left = [job for job in jobs if job.key not in held]
    facts = {"engine": options.engine, "processes": options.jobs}
    saved_s = begun_s = time.monotonic()
    has_new = False
    before_s = table.seconds.get("", 0.0) if table else 0.0
    try:
        with (
            progress_bar("evaluating", len(jobs), len(held)) as bar,
            closing(drive_episodes(left, options.jobs, options.engine)) as found,
        ):
            for row in found:
                bar.advance(f"{row.driver}, {pluralize(row.vehicles, 'vehicle')}", row.decisions)
                if table:
                    has_new |= table.add({name: str(cell) for name, cell in row.cells().items()})
                    table.seconds[""] = before_s + time.monotonic() - begun_s
                    if time.monotonic() - saved_s > SAVE_EVERY_S:
                        table.save(**facts)
                        saved_s = time.monotonic()
                yield row
    finally:
        if table and has_new:
            table.save(**facts)


def _require_rivals(names: Sequence[str]) -> None:
    """Raise ConfigError unless there is a rule-based driver and another one to judge."""
    rules = baselines(names)
    if not rules or len(rules) == len(names):
        raise ConfigError(
            "--require-pass compares a driver with a rule-based one, but the drivers are "
            f"{', '.join(names)}: name one of each kind, such as pretrained --driver gap-mobil."
        )
