"""Simulates tests of 27 s: the shipped driver under a check, among naturalistic.py's human drivers.

In a test the ego drives about 800 m, at 30 m/s, among nine vehicles on a three-lane highway.
``naturalistic.starts`` draws the start.
"""

from typing import NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.policy_file import PRETRAINED
from drl_av.drivers.registry import load_driver
from drl_av.driving.observation_scale import ObservationScale
from drl_av.evaluation.processes import workers
from drl_av.road.road import FloatArray
from studies.study import with_check
from verification.adversary import ROAD, BatchCheck, IntArray, World
from verification.falsify import check_of
from verification.naturalistic import CARELESS_SHARE, Frequencies, Traffic, UnboundedMover, starts

SECONDS = 27
"""Number of decisions of a test, one per second."""
BATCH = 500
"""Number of tests that are simulated together."""
CHECKS = {
    "permit_all": "permit_all",
    "paper": "paper",
    "strict": "strict, bounds of our traffic",
    "real": "strict, bounds of real traffic",
}
"""The meaning of each name that ``settings`` takes."""


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
    """Number of decisions in which the check permits no action, not even the one it executes."""


def settings(check: str) -> Config:
    """Return the config of one of ``CHECKS``."""
    if check == "permit_all":
        return Config().updated("safety", check=check)
    return with_check(Config(), check)


def run(
    config: Config,
    tests: int,
    frequencies: Frequencies,
    seed: int,
    careless: float = CARELESS_SHARE,
    people: type[Traffic] = Traffic,
    jobs: int = 1,
) -> Outcome:
    """Simulate the tests of one check, and return their results.

    Args:
        config: The settings, with the check.
        tests: Number of tests.
        frequencies: Probabilities of dangerous acts near the ego.
        seed: The same seed gives all checks the same start scenes, except that gaps are widened to
            the size that the check requires.
        careless: Share of the human drivers' lane changes that ignore the vehicle behind.
        people: The class that decides for the other drivers.
        jobs: Number of processes; the results do not depend on it.
    """
    sizes = {first: min(BATCH, tests - first) for first in range(0, tests, BATCH)}
    calls = [
        (config, size, frequencies, (seed, first), careless, people)
        for first, size in sizes.items()
    ]
    if jobs == 1:
        parts = [_batch(*call) for call in calls]
    else:
        with workers(jobs) as submit:
            futures = [submit(_batch, *call) for call in calls]
            parts = [future.result() for future in futures]
    return Outcome(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _batch(
    config: Config,
    tests: int,
    frequencies: Frequencies,
    seed: tuple[int, int],
    careless: float,
    people: type[Traffic],
) -> Outcome:
    rng = np.random.default_rng(seed)
    world = starts(tests, config, rng)
    return drive(config, world, people(world, frequencies, rng, careless), check_of(config))


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


def proposals(world: World, driver: Driver, scale: ObservationScale) -> IntArray:
    """Ask the driver for its action number, 0 to 11, in each scene; shape (scenes,).

    The number is 0 in scenes that have ended with a collision.
    """
    proposed = np.zeros(len(world.x_m), np.int64)
    for row in range(len(world.x_m)):
        if row not in world.collisions:
            scene = world.scene(row)
            proposed[row] = driver.act(scene, scale(scene.affordances.vector())).number
    return proposed
