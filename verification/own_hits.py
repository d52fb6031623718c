"""Bounds how often the ego under ``strict`` hits a vehicle among people who may break the bounds.

    python -m verification.own_hits --tests 120000 --jobs 2

The tests are those of ``crash_tests.py`` with the bounds of real traffic. By the proof (``make
prove``) the ego hits nothing unless a vehicle breaks bound 1, 2 or 3. Bound 1 is never broken,
because these people brake at most as hard as it says; bounds 2 and 3 are broken only by a vehicle
that begins a lane change towards the ego. In most tests no vehicle tries to: each of the nine
vehicles tries with a known probability each second. The program therefore draws tests among those
in which at least one tries. Everything else is as likely as among people, so that no weights are
needed. The hits per test are the share of these tests among all, times the share of them in which
the ego hits a vehicle, with the 95 % interval of Clopper and Pearson.

A control drives tests in which no vehicle tries, with frequent hard braking ahead of the ego: the
exit status is 1 if the ego hits a vehicle there, which the proof excludes.
"""

import argparse
import sys
import time

import numpy as np

from drl_av.cli.arguments import whole
from drl_av.experiments.provenance import made_by
from drl_av.traffic.road import FloatArray
from verification.crash_rate import Rate, add_careless, exact_share
from verification.crash_tests import CHECKS, SECONDS, Outcome, run, settings
from verification.kinematic_simulator import ROAD, BoolArray, World
from verification.naturalistic import (
    ADVERSARY,
    CARELESS_SHARE,
    LANE_CHANGES_PER_S,
    PEOPLE,
    PER_LANE,
    Frequencies,
    Traffic,
)

CHANCES = SECONDS * PER_LANE * len(ROAD.open_lanes)
"""Number of draws in a test that decide who tries to change lanes towards the ego, and when."""
SHARE = 1.0 - (1.0 - LANE_CHANGES_PER_S) ** CHANCES
"""Share of the tests in which at least one vehicle tries."""


def tries(tests: int, rng: np.random.Generator) -> BoolArray:
    """Draw who tries, shape (tests, ``CHANCES``), given that at least one does in each test.

    The first one is drawn by its distribution function, those after it as among people.
    """
    drawn = rng.random((tests, CHANCES)) < LANE_CHANGES_PER_S
    never = np.log1p(-SHARE * rng.random(tests))
    first = np.floor(never / np.log1p(-LANE_CHANGES_PER_S)).astype(np.int64)
    chance, first = np.arange(CHANCES), np.minimum(first, CHANCES - 1)[:, None]
    result: BoolArray = (drawn & (chance > first)) | (chance == first)
    return result


class Approaching(Traffic):
    """People of whom at least one tries to change lanes towards the ego in each test."""

    def __init__(
        self,
        world: World,
        frequencies: Frequencies,
        rng: np.random.Generator,
        careless: float = CARELESS_SHARE,
    ) -> None:
        super().__init__(world, frequencies, rng, careless)
        self._second = 0
        self._tries = self._drawn(len(world.x_m)).reshape(len(world.x_m), SECONDS, -1)

    def _drawn(self, tests: int) -> BoolArray:
        return tries(tests, self._rng)

    def _change_lanes(self, world: World) -> None:
        super()._change_lanes(world)
        self._second += 1

    def _attempts(
        self, world: World, side: int, possible: BoolArray, dangerous: BoolArray
    ) -> BoolArray:
        away = super()._attempts(world, side, possible, dangerous)
        is_toward = np.sign(world.y_m[:, :1] - world.y_m[:, 1:]) == side
        return np.where(is_toward, possible & self._tries[:, self._second], away)


class Keeping(Approaching):
    """People of whom none tries to change lanes towards the ego."""

    def _drawn(self, tests: int) -> BoolArray:
        return np.zeros((tests, CHANCES), np.bool_)


def hits(hit: FloatArray) -> Rate:
    """Return the hits per test of all tests, given 1 or 0 for each test in which a vehicle tries.

    ``hit`` has shape (tests,).
    """
    found = exact_share(int(hit.sum()), len(hit))
    return Rate(*(SHARE * end for end in found))


def report(outcome: Outcome) -> str:
    """Return the text that reports the results."""
    found, km = hits(outcome.ego_hit), float(outcome.km.mean())
    return (
        f"{CHECKS['real']}: {len(outcome.km)} tests of {km:.2f} km among the {SHARE:.1%} in which "
        f"a vehicle tries to change lanes towards the ego\n  the ego hits a vehicle "
        f"{int(outcome.ego_hit.sum())} times: per test {found}, so more than "
        f"{km / found.upper:,.0f} km between hits"
    )


def main() -> int:
    """Drive the tests, then the control; print both; return 1 if the control has a hit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--tests", type=whole(1), default=120_000, help="for each share (default: 120000)"
    )
    parser.add_argument(
        "--control", type=whole(1), default=20_000, help="tests of the control (default: 20000)"
    )
    add_careless(parser)
    parser.add_argument("--seed", type=int, default=1, help="default: 1")
    parser.add_argument("--jobs", type=whole(1), default=1, help="number of processes (default: 1)")
    options = parser.parse_args()
    begun_s, config = time.monotonic(), settings("real")
    for careless in options.careless:
        print(f"{100 * careless:g} % of the lane changes are careless of the vehicle behind")
        how = (PEOPLE, options.seed, careless, Approaching, options.jobs)
        outcome = run(config, options.tests, *how)
        print(report(outcome), flush=True)
    how = (ADVERSARY, options.seed, CARELESS_SHARE, Keeping, options.jobs)
    control = run(config, options.control, *how)
    contradicted = int(control.ego_hit.sum())
    print(
        f"control: {options.control} tests in which no vehicle tries, the ego hits a vehicle "
        f"{contradicted} times"
    )
    print(made_by(time.monotonic() - begun_s))
    return 1 if contradicted else 0


if __name__ == "__main__":
    sys.exit(main())
