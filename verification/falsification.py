"""Searches for collisions under a safety check, with an adversary that CMA-ES optimizes.

The adversary chooses the start, the commands of every other vehicle in each decision, and the
proposed actions of the ego. The simulator limits the other vehicles to the bounds of
``safety/strict.py``.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.config import Config
from drl_av.errors import needed_by
from drl_av.safety.reachability import STILL_M_S
from verification.adversary import BatchCheck, Mover, Orders, World
from verification.families import PLACED, Family

DECISIONS = 14
"""Number of decisions of a scene: enough to brake to a standstill, and for two lane changes."""
POPULATION, GENERATIONS = 100, 20
"""Number of scenes in a generation of CMA-ES, and of generations until it restarts."""
RATES = 2
"""Number of genes for each vehicle and decision; another ``PLACED`` genes define the start."""


CREEPING_M_S = 0.9 * STILL_M_S
"""A lateral speed so low that the check treats the vehicle as not moving sideways."""


class Tally(NamedTuple):
    """The numbers of simulated scenes and of scenes with a collision of the ego."""

    scenes: int
    ego_hits: int
    """Number of scenes in which the ego hit a vehicle."""
    was_hit: int
    """Number of scenes in which a vehicle hit the ego."""
    least_m: float
    """Smallest separation of the ego from a vehicle, over all scenes; negative after an overlap."""


def genes(family: Family) -> int:
    """Return the number of genes that encode one scene of a family."""
    return PLACED * family.others + RATES * (family.others + 1) * DECISIONS


def orders(genome: FloatArray, family: Family, config: Config) -> Iterator[Orders]:
    """Yield the commands of each decision; ``genome``, shape (scenes, genes), encodes them.

    In each decision every vehicle has an acceleration gene and a lateral gene. For the ego, both
    genes together select the proposed action. For the other vehicles:

    - An acceleration gene of 0 is half-way between the bounds of the acceleration. From 2/3 on it
      is the upper bound, and from -2/3 on the lower one.
    - The sign of a lateral gene is the direction, left positive. If its absolute value is above
      0.7, the vehicle moves at the highest lateral speed; above 0.4 it moves at ``CREEPING_M_S``;
      otherwise it keeps its lateral position.
    """
    strict, n = config.strict, family.others
    commands = genome[:, PLACED * n :].reshape(len(genome), DECISIONS, RATES, n + 1)
    span = (strict.acceleration_m_s2 + strict.braking_m_s2) / 2
    middle = (strict.acceleration_m_s2 - strict.braking_m_s2) / 2
    creep = min(CREEPING_M_S / strict.lateral_speed_m_s, 1.0) if strict.lateral_speed_m_s else 0.0
    for decision in range(DECISIONS):
        rate, side = commands[:, decision, 0], commands[:, decision, 1]
        wish = np.where(rate[:, 0] > -0.7, 1, np.where(rate[:, 0] > -1.2, 0, 3))
        lateral = np.where(side[:, 0] > 0.5, 2, np.where(side[:, 0] < -0.5, 1, 0))
        size = np.abs(side[:, 1:])
        share = np.where(size > 0.7, 1.0, np.where(size > 0.4, creep, 0.0))
        yield Orders(
            4 * lateral + wish,
            middle + span * np.clip(1.5 * rate[:, 1:], -1.0, 1.0),
            share * np.sign(side[:, 1:]),
        )


def scripted(family: Family, scenes: int) -> Iterator[Orders]:
    """Yield the commands of the family's scripted adversary for each decision."""
    rate, side, proposal = family.script
    shape = (scenes, family.others)
    for _ in range(DECISIONS):
        yield Orders(np.full(scenes, proposal), np.full(shape, rate), np.full(shape, float(side)))


def play(
    world: World, commands: Iterator[Orders], check: BatchCheck, mover: Mover
) -> tuple[FloatArray, IntArray]:
    """Simulate all scenes of ``world``; return the ego's smallest separation, m, and the result.

    Both have shape (scenes,). The result is 0 without a collision, 1 if the ego hit something, and
    2 if a vehicle hit the ego.
    """
    for order in commands:
        mover.decision(world, check(world, order.proposal), order)
    ended = np.zeros(len(world.x_m), dtype=np.int64)
    for row, collision in world.collisions.items():
        ended[row] = 1 if collision.kind.ego_hit else 2
    return world.least_m.min(axis=1), ended


def search(
    family: Family, config: Config, check: BatchCheck, mover: Mover, scenes: int, seed: int
) -> Iterator[Tally]:
    """Search for collisions with CMA-ES over ``scenes`` scenes; yield a Tally for each generation.

    The adversary minimizes the ego's smallest separation.
    """
    with needed_by("The search", "cma", "'drl-av[verify]'"):
        import cma
    left, restart = scenes, 0
    while left > 0:
        options = {"popsize": POPULATION, "verbose": -9, "CMA_diagonal": True}
        options |= {"seed": 1 + seed + restart}
        start = np.random.default_rng([seed, restart]).normal(size=genes(family))
        learner = cma.CMAEvolutionStrategy(start, 0.7, options)
        for _ in range(min(GENERATIONS, -(-left // POPULATION))):
            asked = learner.ask()
            tally, losses = _generation(np.array(asked), family, config, check, mover)
            learner.tell(asked, losses.tolist())
            left -= tally.scenes
            yield tally
        restart += 1


def _generation(
    genome: FloatArray, family: Family, config: Config, check: BatchCheck, mover: Mover
) -> tuple[Tally, FloatArray]:
    placing = genome[:, : PLACED * family.others]
    world = family.start(1 / (1 + np.exp(-1.7 * placing)), config)
    least_m, ended = play(world, orders(genome, family, config), check, mover)
    ego_hits, was_hit = (int((ended == kind).sum()) for kind in (1, 2))
    return Tally(len(genome), ego_hits, was_hit, float(least_m.min())), least_m
