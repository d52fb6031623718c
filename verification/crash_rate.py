"""Estimates the crash rate of the shipped driver among human drivers, by importance sampling.

    python -m verification.crash_rate --tests 20000

A test is 27 s on a three-lane highway, 800 m at 30 m/s, among nine human drivers, whose model is in
``naturalistic.py``. The adversary makes dangerous acts near the ego more frequent; the weights of
the tests remove the bias. For each check it prints the crashes per test with a 95 % interval, those
in which the ego hit a vehicle, and the distance between these. The published figures for a
three-lane SUMO highway are 4.36e-4 crashes per test for a shield and 2.22e-4 for a driver
(Comparison-DenseLearning-ProvablySafeRL). Its tests differ: drivers follow tables of data in SUMO,
change lanes within one second, and have other steering and gaps than in ``naturalistic.py``.
"""

import argparse
import re
import sys
import time
from typing import NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.policy_file import PRETRAINED
from drl_av.drivers.registry import load_driver
from drl_av.driving.affordances import ObservationScale
from drl_av.experiments.markdown import markdown_table
from drl_av.experiments.provenance import made_by
from drl_av.experiments.strictness import under
from drl_av.traffic.road import FloatArray
from verification.falsify import check_of
from verification.kinematic_simulator import ROAD, BatchCheck, IntArray, World
from verification.naturalistic import (
    ADVERSARY,
    CARELESS_SHARE,
    PEOPLE,
    Frequencies,
    Traffic,
    UnboundedMover,
    starts,
)

SECONDS = 27
"""Number of decisions of a test, one per second."""
BATCH = 500
"""Tests that are simulated together."""
CHECKS = ("permit_all", "paper", "strict", "real")
"""``real`` is ``strict`` with the bounds of real traffic."""


class Outcome(NamedTuple):
    """The results of all tests of one check; arrays have shape (tests,)."""

    weights: FloatArray
    """Importance weight of each test."""
    ego_hit: FloatArray
    """1 where the ego hit a vehicle, else 0."""
    was_hit: FloatArray
    """1 where a vehicle hit the ego, else 0."""
    km: FloatArray
    """Distance that the ego drove."""
    unanswered: FloatArray
    """Number of decisions in which the check permits no action, not even that of its choice."""


class Rate(NamedTuple):
    """An estimated crash rate per test, and both ends of its 95 % confidence interval."""

    value: float
    lower: float
    upper: float

    def __str__(self) -> str:
        return f"{self.value:.2e} ({self.lower:.2e} to {self.upper:.2e})"


def rate(crashed: FloatArray, weights: FloatArray) -> Rate:
    """Return the weighted share of crashes and its 95 % interval; arrays have shape (tests,).

    Without a crash the upper end is 3 / n (the rule of three) times the largest weight.
    """
    n, weighted = len(crashed), crashed * weights
    if not crashed.any():
        return Rate(0.0, 0.0, 3.0 / n * float(weights.max()))
    half = 1.96 * float(weighted.std(ddof=1)) / np.sqrt(n)
    value = float(weighted.mean())
    return Rate(value, max(0.0, value - half), value + half)


def settings(check: str) -> Config:
    """Return the config of one of ``CHECKS``."""
    if check == "permit_all":
        return Config().updated("safety", check=check)
    return under(Config(), check)


def proposals(world: World, driver: Driver, scale: ObservationScale) -> IntArray:
    """Ask the driver for its action number, 0 to 11, in each scene; shape (scenes,).

    It is 0 in scenes that ended with a collision.
    """
    proposed = np.zeros(len(world.x_m), np.int64)
    for row in range(len(world.x_m)):
        if row not in world.collisions:
            scene = world.scene(row)
            proposed[row] = driver.act(scene, scale(scene.affordances.vector())).number
    return proposed


def run(
    config: Config,
    tests: int,
    frequencies: Frequencies,
    seed: int,
    careless: float = CARELESS_SHARE,
    people: type[Traffic] = Traffic,
) -> Outcome:
    """Simulate the tests of one check, and return their results.

    ``config`` names the check. ``careless`` is the share of the human drivers' lane changes that
    ignore the vehicle behind. ``people`` is the class that decides for the other drivers. With the
    same seed, two checks get the same start scenes, apart from gaps that are widened to the size
    that the check requires.
    """
    batches = [range(first, min(first + BATCH, tests)) for first in range(0, tests, BATCH)]
    check = check_of(config)
    parts = []
    for each in batches:
        rng = np.random.default_rng((seed, each.start))
        world = starts(len(each), config, rng)
        parts.append(drive(config, world, people(world, frequencies, rng, careless), check))
    return Outcome(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def drive(config: Config, world: World, traffic: Traffic, check: BatchCheck) -> Outcome:
    """Let the shipped driver drive the scenes of a world under a check; return the results.

    The world changes in place.
    """
    size, driver, mover = len(world.x_m), load_driver(PRETRAINED), UnboundedMover(config)
    scale = ObservationScale(config.observation, config.ego.max_speed_m_s, ROAD)
    begin_m = world.x_m[:, 0].copy()
    weights, unanswered = np.ones(size), np.zeros(size)
    for _ in range(SECONDS):
        executed = check(world, proposals(world, driver, scale))
        going = np.array([row not in world.collisions for row in range(size)])
        unanswered += going & (check(world, executed) != executed)
        orders = traffic.decide(world, executed)
        weights = np.where(going, traffic.weights, weights)
        mover.decision(world, executed, orders)
    hits = np.zeros((2, size))
    for row, collision in world.collisions.items():
        hits[0 if collision.kind.ego_hit else 1, row] = 1.0
    km = (world.x_m[:, 0] - begin_m) / 1000
    return Outcome(weights, hits[0], hits[1], km, unanswered)


def report(check: str, outcome: Outcome) -> str:
    """Return the text that reports the results of one check."""
    crashed = outcome.ego_hit + outcome.was_hit
    rates = [rate(hits, outcome.weights) for hits in (crashed, outcome.ego_hit, outcome.was_hit)]
    km = float((outcome.km * outcome.weights).sum() / outcome.weights.sum())
    between = f"{km / rates[1].upper:,.0f}" if rates[1].upper else "inf"
    return (
        f"{check}: {len(crashed)} tests of {km:.2f} km, {int(crashed.sum())} crashes under the "
        f"adversary\n  crashes per test {rates[0]}\n  the ego hits a vehicle {rates[1]}, "
        f"so more than {between} km between hits\n  the ego is hit {rates[2]}\n"
        f"  decisions without a permitted action: {int(outcome.unanswered.sum())}; mean weight "
        f"{outcome.weights.mean():.3f}"
    )


ENTRY = re.compile(
    r"^(\w+): \d+ tests of ([\d.]+) km.*\n  crashes per test (.*)\n"
    r"  the ego hits a vehicle (.*), so more than ([\d,]+|inf) km",
    re.MULTILINE,
)
"""What ``report`` prints of a check: name, km of a test, crashes, own hits, km between those."""


def table(printed: str) -> str:
    """Return the Markdown table of what this program printed; each interval is one of 95 %."""
    names = [
        "careless",
        "check",
        "crashes per test",
        "crashes per km",
        "the ego's own hits per test",
    ]
    lines = []
    for part in re.split(r"^(?=[\d.]+ % of the lane changes)", printed, flags=re.MULTILINE)[1:]:
        for check, km, crashes, own, between in ENTRY.findall(part):
            numbers = [
                float(number) / float(km) for number in re.findall(r"[\d.]+e[-+]\d+", crashes)
            ]
            share = f"{part.split(' ', 1)[0]} %"
            lines.append([share, check, crashes, str(Rate(*numbers)), own, between])
    return markdown_table([*names, "km between those, more than"], lines)


def add_careless(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--careless``: shares between 0 and 1 of the lane changes."""
    parser.add_argument(
        "--careless",
        nargs="+",
        type=_share,
        default=(CARELESS_SHARE, 0.5),
        metavar="SHARE",
        help="shares of the lane changes that are careless (default: 0.01 0.5)",
    )


def _share(text: str) -> float:
    share = float(text)
    if not 0 < share < 1:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1")
    return share


def main() -> int:
    """Simulate the tests of each check and print its report; return 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--tests", type=int, default=20_000, help="for each check and share (default: 20000)"
    )
    parser.add_argument("--checks", nargs="+", choices=CHECKS, default=CHECKS, help="default: all")
    add_careless(parser)
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument(
        "--people", action="store_true", help="no adversary: every weight is 1 (plain sampling)"
    )
    options = parser.parse_args()
    begun_s = time.monotonic()
    frequencies = PEOPLE if options.people else ADVERSARY
    for careless in options.careless:
        print(f"{100 * careless:g} % of the lane changes are careless of the vehicle behind")
        for check in options.checks:
            found = run(settings(check), options.tests, frequencies, options.seed, careless)
            print(report(check, found), flush=True)
    print(made_by(time.monotonic() - begun_s))
    return 0


if __name__ == "__main__":
    sys.exit(main())
