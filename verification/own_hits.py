"""Estimates how often the ego hits a vehicle under ``strict`` if others may break its bounds.

    python -m verification.own_hits --tests 120000 --jobs 2
    python -m verification.own_hits --driver my.zip

The tests are those of ``crash_simulation.py`` with the bounds of real traffic. By the proof (``make
prove``) the ego hits nothing unless a vehicle breaks bound 1, 2 or 3. These drivers never break
bound 1, because they brake no harder than it permits. Only a vehicle that begins a lane change
towards the ego can break bound 2 or 3. Each of the nine vehicles tries such a lane change with a
known probability each second, so that in most tests no vehicle tries one. The program therefore
draws only tests in which at least one vehicle tries. All else is as likely as among human drivers,
so no weights are needed. The number of hits per test is the share of such tests among all tests,
times the share of such tests with a hit. The 95 % interval is that of Clopper and Pearson.

A control consists of tests in which no vehicle tries a lane change towards the ego, with frequent
hard braking ahead of the ego. The proof excludes that the ego hits a vehicle in these tests; the
exit status is 1 if it does. The proof is that of ``strict``, so that there is no other check here.
"""

from typing import Any

import numpy as np

from drl_av.arrays import BoolArray, FloatArray
from verification.adversary import ROAD, World
from verification.crash_rate import Rate, add_careless, exact_share
from verification.crash_simulation import CHECKS, SECONDS, Outcome, drivers, run, settings
from verification.naturalistic import (
    ADVERSARY,
    CARELESS_SHARE,
    LANE_CHANGES_PER_S,
    PEOPLE,
    PER_LANE,
    Traffic,
)
from verification.program import Program, run_program

CHANCES = SECONDS * PER_LANE * len(ROAD.open_lanes)
"""Number of random draws in a test: each decides whether one vehicle tries to change lanes towards
the ego in one second."""
SHARE = 1.0 - (1.0 - LANE_CHANGES_PER_S) ** CHANCES
"""Share of the tests in which at least one vehicle tries to change lanes towards the ego."""


def tries(tests: int, rng: np.random.Generator) -> BoolArray:
    """Draw which chances are taken, at least one in each test; shape (tests, ``CHANCES``).

    A chance is one vehicle's chance to try a lane change in one second. The first chance taken is
    drawn by inverting its distribution function; each later chance is taken with the probability
    among human drivers.
    """
    drawn = rng.random((tests, CHANCES)) < LANE_CHANGES_PER_S
    never = np.log1p(-SHARE * rng.random(tests))
    first = np.floor(never / np.log1p(-LANE_CHANGES_PER_S)).astype(np.int64)
    chance, first = np.arange(CHANCES), np.minimum(first, CHANCES - 1)[:, None]
    result: BoolArray = (drawn & (chance > first)) | (chance == first)
    return result


class Approaching(Traffic):
    """Human drivers; in each test at least one tries to change lanes towards the ego."""

    def __init__(self, world: World, *given: Any) -> None:
        super().__init__(world, *given)
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
    """Human drivers; none tries to change lanes towards the ego."""

    def _drawn(self, tests: int) -> BoolArray:
        return np.zeros((tests, CHANCES), np.bool_)


def hits(hit: FloatArray) -> Rate:
    """Return the number of hits per test, over all tests, with its interval.

    ``hit``, shape (tests,), is 1 for a hit and 0 for none, for each test in which a vehicle tries.
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
    parser = Program(__doc__)
    parser.drivers("pretrained")
    parser.number("--tests", 120_000, "for each share")
    parser.number("--control", 20_000, "tests of the control")
    add_careless(parser)
    parser.number("--seed", 1, low=0)
    parser.number("--jobs", 1, "number of processes")
    options = parser.parse_args()
    config, contradicted = settings("real"), 0
    for driver in options.driver:
        drivers(driver, config, 1)
    for driver in options.driver:
        print(f"driver {driver}")
        for careless in options.careless:
            print(f"{100 * careless:g} % of the lane changes are careless of the vehicle behind")
            how = (PEOPLE, options.seed, careless, Approaching, options.jobs, driver)
            outcome = run(config, options.tests, *how)
            print(report(outcome), flush=True)
        how = (ADVERSARY, options.seed, CARELESS_SHARE, Keeping, options.jobs, driver)
        control = run(config, options.control, *how)
        hit = int(control.ego_hit.sum())
        contradicted += hit
        tests = f"control: {options.control} tests in which no vehicle tries"
        print(f"{tests}, the ego hits a vehicle {hit} times")
    print(parser.made_by())
    return 1 if contradicted else 0


if __name__ == "__main__":
    run_program(main)
