"""Simulates tests of 27 s: a driver under a check, among naturalistic.py's human drivers.

In a test the ego drives about 800 m, at 30 m/s, among nine vehicles on a three-lane highway.
``naturalistic.starts`` draws the start.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import MaskedPolicyDriver
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.drivers.rule_based import SumoDriver
from drl_av.driving.actions import ACTIONS
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.wide_observation import WIDE_SIZE
from drl_av.errors import ConfigError
from drl_av.evaluation.engines import workers
from verification.adversary import ROAD, BatchCheck, BatchStrict, World
from verification.ego_in_scenes import look
from verification.falsify import check_of, safety_check
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
REAL = {"braking_m_s2": 9.0, "lateral_speed_m_s": 2.1}
"""The bounds of real traffic, those of the study ``strict``."""


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
    """Return the config of one of ``CHECKS``, or of a check of the user, ``module:function``."""
    if check == "real":
        return settings("strict").updated("strict", **REAL)
    return Config().updated("safety", check=check)


def drivers(word: str, config: Config, tests: int) -> list[Driver]:
    """Return the driver that a word names, once for each test, because it may have a state.

    A driver from a file has none, so that one object drives all tests.

    Raises:
        ConfigError: there is no such driver, SUMO drives it, it needs a road to search on, or the
            word names a check after an @.
        RunError, CheckpointError: as ``make_drivers``.
    """
    [spec] = find_drivers([word])
    if spec.under is not None:
        raise ConfigError(f"{word} names a check: name it with --safety-check {spec.under}.")
    if spec.is_planner:
        raise ConfigError("The planner searches on a loop, not in these tests: take another.")
    check, objects = safety_check(config), tests if spec.run is None else 1
    made = [make_drivers([spec], config, check)[spec.name] for _ in range(objects)]
    if isinstance(made[0], SumoDriver):
        raise ConfigError(f"SUMO itself drives {word}, and is not in these tests: take another.")
    return made * (tests // objects)


def run(
    config: Config,
    tests: int,
    frequencies: Frequencies,
    seed: int,
    careless: float = CARELESS_SHARE,
    people: type[Traffic] = Traffic,
    jobs: int = 1,
    driver: str = "pretrained",
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
        driver: The driver, as ``drivers`` takes it.
    """

    def batch(first: int) -> Outcome:
        rng, size = np.random.default_rng((seed, first)), min(BATCH, tests - first)
        world = starts(size, config, rng)
        traffic, made = people(world, frequencies, rng, careless), drivers(driver, config, size)
        for number, each in enumerate(made, start=first):
            each.start(number)
        return drive(config, world, traffic, check_of(config), made)

    firsts = range(0, tests, BATCH)
    if jobs == 1:
        parts = [*map(batch, firsts)]
    else:
        with workers(jobs) as submit:
            parts = [future.result() for future in [submit(batch, first) for first in firsts]]
    return Outcome(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def drive(
    config: Config, world: World, traffic: Traffic, check: BatchCheck, egos: Sequence[Driver]
) -> Outcome:
    """Let a driver drive each scene of a world under a check; return the results.

    The world changes in place.
    """
    size, mover = len(world.x_m), UnboundedMover(config)
    scale = ObservationScale(config.observation, config.ego.max_speed_m_s, ROAD)
    begin_m = world.x_m[:, 0].copy()
    weights, unanswered = np.ones(size), np.zeros(size)
    for _ in range(SECONDS):
        executed = check(world, proposals(world, egos, scale, check))
        going = np.array([row not in world.collisions for row in range(size)])
        lacks = going & (check(world, executed) != executed)
        for number in range(len(ACTIONS) if lacks.any() else 0):
            lacks &= check(world, np.full(size, number)) != number
        unanswered += lacks
        orders = traffic.decide(world, executed)
        weights = np.where(going, traffic.weights, weights)
        mover.decision(world, executed, orders)
    hits = np.zeros((2, size))
    for row, collision in world.collisions.items():
        hits[0 if collision.kind.ego_hit else 1, row] = 1.0
    km = (world.x_m[:, 0] - begin_m) / 1000
    return Outcome(weights, hits[0], hits[1], km, unanswered)


def proposals(
    world: World, egos: Sequence[Driver], scale: ObservationScale, check: BatchCheck
) -> IntArray:
    """Ask the driver of each scene for its action number, 0 to 11; shape (scenes,).

    A driver that was trained at scale answers under ``strict`` for all scenes at once. The number
    of others is 0 in scenes that have ended with a collision.
    """
    if isinstance(egos[0], MaskedPolicyDriver) and isinstance(check, BatchStrict):
        wide = np.zeros((len(egos), WIDE_SIZE), np.float32)
        look(world.numbers(), egos[0].range_m, egos[0].max_speed_m_s, wide)
        permitted = check.verdicts(world) == np.arange(len(ACTIONS))
        logits = egos[0].logits_of(wide, permitted)
        return np.asarray(logits.argmax(axis=1), np.int64)
    proposed = np.zeros(len(world.x_m), np.int64)
    for row in range(len(world.x_m)):
        if row not in world.collisions:
            scene = world.scene(row)
            observation = scale(scene.indicators.values[:27])
            proposed[row] = egos[row].act(scene, observation).number
    return proposed
