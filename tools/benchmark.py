"""Measures the speed of environment and training, each beside a rival in the same run.

    python tools/benchmark.py                       measure all rows
    python tools/benchmark.py env train --json      measure some rows, print JSON

    env          the environment as gymnasium.make makes it, with action masks, at 30 vehicles, with
                 resets, under each safety check, beside bare libsumo, which executes the same
                 commands step by step, without observations and decisions
    traffic      the environment in traffic of our own drivers (paper, hazards) beside traffic that
                 SUMO drives (calm)
    planner      decisions of the planner beside those of pretrained, at 30 vehicles, without the
                 steps of the environment
    worlds       256 worlds of the twin with 30 vehicles each, on one thread, under each safety
                 check, beside the environment; in each kind of traffic, beside calm; with 112
                 vehicles, as many as can start, beside 30; and with 65 on the road merge, where
                 vehicles enter and leave, beside a loop
    envpool      256 worlds of the twin beside 256 of EnvPool's Highway-v0 at 3 lanes, 30 vehicles
                 and one decision per second, which it simulates at its own default of 15 Hz; each
                 on one thread, per CPU second
    step         a training step (sampled batch, double Q target, gradient, Adam) beside a bare
                 gradient step of PyTorch on one batch: autograd and fused Adam
    train        Algorithm 1 of the paper beside stable-baselines3's DQN on the same environment
                 with the same traffic seeds, network, batch and buffer; torch on one thread in
                 both; with the paper's 1 to 30 vehicles, and with 30 in every episode; then
                 Algorithm 1 in the twin beside SUMO
    large        PPO in the twin, the preset ``large``, on all cores, beside Algorithm 1 there
    highway-env  the environment beside HighwayEnv's highway-v0 at 3 lanes, 30 vehicles and one
                 decision per second, simulated at its own default of 15 Hz
    processes    two processes that drive at the same time beside one
    scaling      the environment beside bare libsumo at 5 to 240 vehicles, from 30 on at one
                 density; a last row compares the cost of a decision at 240 and at 5 vehicles
    straight     the environment beside bare libsumo on a straight road of 12 km with about 500
                 vehicles; in each decision some vehicles enter and some leave
    roads        the environment on an open road, with a ramp and without, beside a loop with as
                 many vehicles; then bare libsumo on both roads

Numbers are per second, medians over rounds in which all rows take turns, after a round of warm-up;
a ratio is the median of the ratios of the rounds. All rows but ``large`` and ``processes`` run on
one core.
"""

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from importlib import import_module
from typing import Any, NamedTuple

from benchmark_rows import (
    NUMBERS,
    Row,
    env_rows,
    envpool_rows,
    highway_env_rows,
    planner_rows,
    processes_rows,
    roads_rows,
    scaling_rows,
    straight_rows,
    traffic_rows,
    worlds_rows,
)

from drl_av.cli.options import int_at_least
from verification.program import made_by


def of_learning(name: str) -> Callable[[Sequence[int], ExitStack], list[Row]]:
    """Return the function ``name`` of ``benchmark_learning``; a call of it loads torch."""

    def rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
        found: list[Row] = getattr(import_module("benchmark_learning"), name)(seeds, stack)
        return found

    return rows


EXTRAS = {
    "envpool": "benchmark",
    "highway_env": "benchmark",
    "torch": "train",
    "sb3_contrib": "train",
    "stable_baselines3": "dev",
}
"""The extra of drl-av with which each package is installed that only some rows need."""
ROWS: dict[str, Callable[[Sequence[int], ExitStack], list[Row]]] = {
    "env": env_rows,
    "traffic": traffic_rows,
    "planner": planner_rows,
    "worlds": worlds_rows,
    "envpool": envpool_rows,
    "step": of_learning("step_rows"),
    "train": of_learning("train_rows"),
    "large": of_learning("large_rows"),
    "highway-env": highway_env_rows,
    "processes": processes_rows,
    "scaling": scaling_rows,
    "straight": straight_rows,
    "roads": roads_rows,
}
SEEDS = 1_000
"""First traffic seed of the episodes that are timed."""


class Result(NamedTuple):
    """The result of a row: medians per second of ours and of the rival, and the median ratio.

    ``met`` is whether the medians are as ``wanted``; it is None if the row demands nothing.
    """

    name: str
    ours: float
    beside: float
    ratio: float
    wanted: str
    met: bool | None


def main() -> None:
    """Parse the command line, measure the rows, and print their results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"of: {', '.join(ROWS)} (all)")
    number: dict[str, Any] = {"type": int_at_least(1), "default": 5}
    parser.add_argument("--rounds", help="number of rounds (default: 5)", **number)
    parser.add_argument("--episodes", help="in each round (default: 5)", **number)
    parser.add_argument("--json", action="store_true", help="print a JSON list")
    options = parser.parse_args()
    if unknown := set(options.rows) - set(ROWS):
        parser.error(f"there is no row {unknown.pop()!r}; the rows are: {', '.join(ROWS)}")
    begun_s = time.monotonic()
    seeds = range(SEEDS, SEEDS + options.episodes)
    with ExitStack() as stack:
        rows = [row for name in options.rows or ROWS for row in measurable(name, seeds, stack)]
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        results = list(in_turn(rows, options.rounds))
    if options.json:
        print(json.dumps([r._asdict() for r in results]))
    else:
        print(table(results))
        print(made_by(time.monotonic() - begun_s))


def measurable(name: str, seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the rows ``name``; none if a package is missing, which a line on stderr names."""
    try:
        return ROWS[name](seeds, stack)
    except ModuleNotFoundError as error:
        if error.name not in EXTRAS:
            raise
        needed = f"pip install 'drl-av[{EXTRAS[error.name]}]'"
        print(f"{name}: not measured, it needs {error.name}: {needed}", file=sys.stderr)
        return []


def in_turn(rows: Sequence[Row], rounds: int) -> Iterator[Result]:
    """Measure all rows in each round, each rival right after its row; yield the results.

    The first of ``rounds`` + 1 rounds is for warm-up and does not count.
    """
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
    """Return the medians over the rounds; ``pairs`` holds (ours, rival's) per second by round."""
    ours, beside = (statistics.median(side) for side in zip(*pairs, strict=True))
    ratio = statistics.median(a / b for a, b in pairs)
    wanted, met = "", None
    if row.least_ratio is not None:
        wanted = f"at least {row.least_ratio:g}"
        wanted += f" and {row.least_ours:,.0f} a second" if row.least_ours else ""
        met = ratio >= row.least_ratio and ours >= row.least_ours
    return Result(row.name, ours, beside, ratio, wanted, met)


def table(results: Sequence[Result]) -> str:
    """Return the results as text, one line for each row."""
    lines = [f"{'':<56}{'ours':>10}{'beside':>10}{'ratio':>8}  wanted"]
    for name, ours, beside, ratio, wanted, met in results:
        places = 1 if max(ours, beside) < 100 else 0
        verdict = {None: "", True: f"{wanted}: met", False: f"{wanted}: MISSED"}[met]
        numbers = f"{ours:>10,.{places}f}{beside:>10,.{places}f}{ratio:>8.2f}"
        lines.append(f"{name:<56}{numbers}  {verdict}".rstrip())
    return "\n".join(lines)


if __name__ == "__main__":
    main()
