"""Estimates the crash rate of a driver among human drivers, by default the shipped one's.

    python -m verification.crash_rate --tests 40000 --jobs 2        # by importance sampling
    python -m verification.crash_rate --people --tests 400000       # by plain sampling
    python -m verification.crash_rate --driver my.zip pretrained --safety-check paper my_check:mine

``crash_simulation.py`` defines the tests, ``naturalistic.py`` the model of the human drivers. An
adversary makes dangerous acts near the ego more frequent; the weights of the tests remove the bias.
With ``--people`` there is no adversary, and each weight is 1. For each check the program prints,
with 95 % intervals, the crashes per test and the crashes in which the ego hit a vehicle. It also
prints a lower bound of the mean distance between two hits by the ego.
The published figures for a three-lane SUMO highway are 4.36e-4 crashes per test for a shield and
2.22e-4 for a driver (Comparison-DenseLearning-ProvablySafeRL). The tests of this publication
differ from ours: its human drivers follow tables of data in SUMO and change lanes within one
second, and their steering and gaps are not those of ``naturalistic.py``.
"""

import argparse
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from drl_av.arrays import FloatArray
from verification.crash_simulation import CHECKS, Outcome, drivers, run, settings
from verification.naturalistic import ADVERSARY, CARELESS_SHARE, PEOPLE
from verification.program import Program, run_program


class Rate(NamedTuple):
    """An estimated crash rate per test, and both ends of its 95 % confidence interval."""

    value: float
    lower: float
    upper: float

    def __str__(self) -> str:
        return f"{self.value:.2e} ({self.lower:.2e} to {self.upper:.2e})"


def rate(crashed: FloatArray, weights: FloatArray) -> Rate:
    """Return the weighted share of crashes and its 95 % interval; arrays have shape (tests,).

    If all weights are 1, the interval is exact. Otherwise it is that of the normal distribution,
    and to its upper end 3 / n (the rule of three) times the largest weight is added, because the
    crashes that no test has seen may have such weights.
    """
    n, weighted = len(crashed), crashed * weights
    if (weights == 1.0).all():
        return exact_share(int(crashed.sum()), n)
    half = 1.96 * float(weighted.std(ddof=1)) / np.sqrt(n)
    value, unseen = float(weighted.mean()), 3.0 / n * float(weights.max())
    return Rate(value, max(0.0, value - half), min(value + half + unseen, 1.0))


def exact_share(hits: int, tests: int) -> Rate:
    """Return the share of tests with a hit, and its 95 % interval by Clopper and Pearson."""
    from scipy import stats

    lower = float(stats.beta.ppf(0.025, hits, tests - hits + 1)) if hits else 0.0
    upper = float(stats.beta.ppf(0.975, hits + 1, tests - hits)) if hits < tests else 1.0
    return Rate(hits / tests, lower, upper)


def report(check: str, outcome: Outcome) -> str:
    """Return the text that reports the results of one check."""
    crashed = outcome.ego_hit + outcome.was_hit
    rates = [rate(hits, outcome.weights) for hits in (crashed, outcome.ego_hit, outcome.was_hit)]
    km = float((outcome.km * outcome.weights).sum() / outcome.weights.sum())
    between = f"{km / rates[1].upper:,.0f}" if rates[1].upper else "inf"
    return (
        f"{CHECKS.get(check, check)}: {len(crashed)} tests of {km:.2f} km, "
        f"{int(crashed.sum())} with a crash\n"
        f"  crashes per test {rates[0]}\n  the ego hits a vehicle {rates[1]}, "
        f"so more than {between} km between hits\n  the ego is hit {rates[2]}\n"
        f"  decisions without a permitted action: {int(outcome.unanswered.sum())}; mean weight "
        f"{outcome.weights.mean():.3f}"
    )


def add_careless(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--careless``: shares of careless lane changes, each from 0 to 1."""
    text = "shares of the lane changes that are careless (default: 0.01 0.5)"
    given: dict[str, Any] = {
        "nargs": "+",
        "type": share,
        "default": (CARELESS_SHARE, 0.5),
        "metavar": "SHARE",
    }
    parser.add_argument("--careless", help=text, **given)


def share(text: str) -> float:
    """Return a share that the command line names, between 0 and 1."""
    found = float(text)
    if not 0 < found < 1:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1")
    return found


def main() -> int:
    """Simulate the tests of each check and print its report; return 0."""
    parser = Program(__doc__)
    parser.number("--tests", 40_000, "for each check and share", low=2)
    parser.drivers("pretrained")
    parser.checks(CHECKS, nargs="+", default=list(CHECKS))
    add_careless(parser)
    parser.number("--seed", 0, low=0)
    text = "no adversary: every weight is 1 (plain sampling)"
    parser.add_argument("--people", action="store_true", help=text)
    parser.number("--jobs", 1, "number of processes")
    options = parser.parse_args()
    for driver, check in product(options.driver, options.safety_check):
        drivers(driver, settings(check), 1)
    frequencies = PEOPLE if options.people else ADVERSARY
    for careless in options.careless:
        print(f"{100 * careless:g} % of the lane changes are careless of the vehicle behind")
        for driver, check in product(options.driver, options.safety_check):
            how = (frequencies, options.seed, careless)
            found = run(settings(check), options.tests, *how, driver=driver, jobs=options.jobs)
            print(f"driver {driver}\n{report(check, found)}", flush=True)
    print(parser.made_by())
    return 0


if __name__ == "__main__":
    run_program(main)
