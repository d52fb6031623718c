"""How fast everything is, each row measured beside its rival in this run.

    python tools/benchmark.py                       every row
    python tools/benchmark.py env train --json      some of them, for machines

    env          the environment at 30 vehicles, resets included, beside bare libsumo: the same
                 commands to the same vehicles, step by step, and nobody who looks
    step         a training step (sampled batch, double Q target, gradient, Adam) beside a bare
                 gradient step of PyTorch on one batch: autograd and fused Adam
    train        Algorithm 1 from end to end beside stable-baselines3's DQN on the same
                 environment with the same traffic seeds, network, batch and buffer; torch on one
                 thread in both; with the paper's 1 to 30 vehicles, and with 30 in every episode
    highway-env  the environment beside HighwayEnv's highway-v0 at 3 lanes, 30 vehicles and one
                 decision a second, simulated at its own default of 15 Hz
    processes    two processes that drive at once beside one
    scaling      the environment beside bare stepping at 5 to 240 vehicles, from 30 on at one
                 density, and how much the cost of a decision grows

Figures are medians over rounds in which all rows take turns, after a round of warm-up; a ratio is
the median of the ratios round by round. All but ``processes`` runs on one core.
"""

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import NamedTuple

import torch
from benchmark_rows import NUMBERS, ROWS, Row

from drl_av.experiments.provenance import made_by

SEEDS = 1_000
"""First traffic seed of the episodes that are timed."""


class Result(NamedTuple):
    """What a row came to."""

    name: str
    ours: float
    beside: float
    ratio: float
    wanted: str
    met: bool | None


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"of: {', '.join(ROWS)} (all)")
    parser.add_argument("--rounds", type=int, default=5, help="(default: 5)")
    parser.add_argument("--episodes", type=int, default=5, help="a round (default: 5)")
    parser.add_argument("--json", action="store_true", help="print a JSON list")
    options = parser.parse_args()
    if unknown := set(options.rows) - set(ROWS):
        parser.error(f"there is no row {unknown.pop()!r}; the rows are: {', '.join(ROWS)}")
    torch.set_num_threads(1)
    begun_s = time.monotonic()
    seeds = range(SEEDS, SEEDS + options.episodes)
    with ExitStack() as stack:
        rows = [row for name in options.rows or ROWS for row in ROWS[name](seeds, stack)]
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        results = list(in_turn(rows, options.rounds))
    if options.json:
        print(json.dumps([r._asdict() for r in results]))
    else:
        print(table(results))
        print(made_by(time.monotonic() - begun_s))


def in_turn(rows: Sequence[Row], rounds: int) -> Iterator[Result]:
    """Measure all rows in each round, and their rivals right after them."""
    pairs: dict[str, list[tuple[float, float]]] = {row.name: [] for row in rows}
    for number in range(rounds + 1):
        for row in rows:
            pair = row.ours(), row.beside()
            if number:
                pairs[row.name].append(pair)
        print(f"round {number} of {rounds}", file=sys.stderr)
    for row in rows:
        yield result(row, pairs[row.name])
    first, last = (f"{number} vehicles" for number in (NUMBERS[0], NUMBERS[-1]))
    if first in pairs:
        growths = [
            (few[0] / many[0], few[1] / many[1])
            for few, many in zip(pairs[first], pairs[last], strict=True)
        ]
        ours, bare = (statistics.median(side) for side in zip(*growths, strict=True))
        ratio = statistics.median(a / b for a, b in growths)
        name = f"cost of a decision, {last} / {first}"
        yield Result(name, ours, bare, ratio, "at most 1", ratio <= 1)


def result(row: Row, pairs: Sequence[tuple[float, float]]) -> Result:
    """Medians over the rounds."""
    ours, beside = (statistics.median(side) for side in zip(*pairs, strict=True))
    ratio = statistics.median(a / b for a, b in pairs)
    if row.least_ratio is None:
        return Result(row.name, ours, beside, ratio, "", None)
    wanted = f"at least {row.least_ratio:g}"
    if row.least_ours:
        wanted += f" and {row.least_ours:,.0f} a second"
    return Result(
        row.name,
        ours,
        beside,
        ratio,
        wanted,
        ratio >= row.least_ratio and ours >= row.least_ours,
    )


def table(results: Sequence[Result]) -> str:
    """A line a row: ours and the rival's in so many a second, and their ratio."""
    lines = [f"{'':<56}{'ours':>10}{'beside':>10}{'ratio':>8}  wanted"]
    for name, ours, beside, ratio, wanted, met in results:
        places = 1 if max(ours, beside) < 100 else 0
        told = {None: "", True: f"{wanted}: met", False: f"{wanted}: MISSED"}[met]
        numbers = f"{ours:>10,.{places}f}{beside:>10,.{places}f}{ratio:>8.2f}"
        lines.append(f"{name:<56}{numbers}  {told}".rstrip())
    return "\n".join(lines)


if __name__ == "__main__":
    main()
