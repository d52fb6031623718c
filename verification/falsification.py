"""Searches for collisions under a safety check: families of scenes, an adversary with CMA-ES.

The adversary chooses the start, the commands of every other vehicle in each decision, and the
proposed actions of the ego. The simulator limits the other vehicles to the bounds of
``safety/strict.py``.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.safety.reachability import STILL_M_S
from drl_av.safety.stopping import reach, stopping_distance
from drl_av.traffic.road import FloatArray, Road
from verification.kinematic_simulator import (
    LENGTH_M,
    NONE,
    ROAD,
    BatchCheck,
    BoolArray,
    IntArray,
    Mover,
    Orders,
    World,
)

DECISIONS = 14
"""Decisions of a scene: enough for braking to a standstill, and for two lane changes."""
POPULATION, GENERATIONS = 100, 20
"""Scenes in a generation of CMA-ES, and generations until it restarts."""
PLACED, RATES = 6, 2
"""Number of genes for the start of each other vehicle, and for each vehicle in each decision."""


CREEPING_M_S = 0.9 * STILL_M_S
"""A lateral speed at which the check treats a vehicle as not moving sideways, m/s."""
BRAKES = 99.0
"""A braking command, m/s^2, that the simulator reduces to the hardest allowed one."""


class Family(NamedTuple):
    """A family of scenes: the function that creates its starts, and a scripted adversary."""

    others: int
    """Number of other vehicles."""
    start: Callable[[FloatArray, Config], World]
    """Creates the starts from numbers in (0, 1), shape (scenes, PLACED * others)."""
    script: tuple[float, float, int]
    """The scripted adversary: the others' acceleration, m/s^2, and side; the proposed action."""
    road_kind: str = "loop"
    """The kind of the road in SUMO, a key of ``in_sumo.ROADS``."""


def needed_gap(speed: FloatArray, other: FloatArray, config: Config) -> FloatArray:
    """Return the smallest gap, m, to a vehicle ahead that the check's own criterion calls safe.

    ``speed`` is the ego's, ``other`` that of the vehicle ahead, m/s. The criterion of ``strict`` is
    a free fallback maneuver; that of the other checks is eq. 2 of the paper.
    """
    if config.safety.check == "strict":
        strict, sim = config.strict, config.simulation
        rolled_m = reach(speed, -config.ego.hard_brake_m_s2, config.ego, sim)
        rest_m = stopping_distance(other, strict.braking_m_s2, sim.step_length_s)
        spare_m: FloatArray = np.maximum(rolled_m - rest_m, 0.0)
        return spare_m + strict.clearance_m + 1e-3
    closing = np.maximum(speed - other, 0.0)
    return config.safety.minimum_gap_m + config.safety.minimum_ttc_s * closing + 1e-3


def placed(
    ego_lane: IntArray,
    ego_speed: FloatArray,
    x_m: FloatArray,
    lane: Any,
    speed: FloatArray,
    at_m: FloatArray | float = 5000.0,
    road: Road = ROAD,
) -> World:
    """Return a World of vehicles in the centres of their lanes.

    ``x_m``, ``lane`` and ``speed`` of the other vehicles have shape (scenes, others); ``x_m`` is
    how far their centres are ahead of the ego's, which is at ``at_m`` along the road.
    """
    scenes = len(ego_speed)
    return World(
        np.reshape(at_m, (-1, 1)) + np.column_stack([np.zeros(scenes), x_m]),
        np.column_stack([ego_lane, lane]) * ROAD.lane_width_m,
        np.column_stack([ego_speed, speed]),
        np.zeros((scenes, 1 + x_m.shape[1])),
        np.full(scenes, NONE),
        np.full(scenes, NONE),
        np.full((scenes, len(ROAD.open_lanes)), np.inf),
        road=road,
    )


def ahead(u: FloatArray, ego: FloatArray, speed: FloatArray, config: Config) -> FloatArray:
    """Return how far ahead of the ego a vehicle starts, m: its gap is safe, up to 60 m larger."""
    return LENGTH_M + needed_gap(ego, speed, config) + 60.0 * u**3


def lead_brakes(u: FloatArray, config: Config) -> World:
    """Create scenes with one vehicle ahead in the ego's lane."""
    ego, speed = 30.0 * u[:, 0], 40.0 * u[:, 1]
    x_m = ahead(u[:, 2], ego, speed, config)
    one = np.ones(len(u), dtype=np.int64)
    return placed(one, ego, x_m[:, None], one[:, None], speed[:, None])


def cut_in(u: FloatArray, config: Config) -> World:
    """Create scenes with one vehicle in the left lane, from beside the ego to 130 m ahead."""
    ego, speed = 30.0 * u[:, 0], 40.0 * u[:, 1]
    one = np.ones(len(u), dtype=np.int64)
    return placed(one, ego, 130.0 * u[:, 2:3], 2.0 * one[:, None], speed[:, None])


def both_sides(u: FloatArray, config: Config) -> World:
    """Create scenes with the ego in the right lane and a vehicle near it in the left lane.

    Both can change to the middle lane. Another vehicle is ahead in the ego's lane.
    """
    ego, speed = 30.0 * u[:, 0], np.column_stack([40.0 * u[:, 1], 40.0 * u[:, 2]])
    zero = np.zeros(len(u), dtype=np.int64)
    x_m = np.column_stack([100.0 * u[:, 3] - 50.0, ahead(u[:, 4], ego, speed[:, 1], config)])
    return placed(zero, ego, x_m, np.column_stack([zero + 2.0, zero]), speed)


def standing(u: FloatArray, config: Config) -> World:
    """Create scenes with a standing vehicle ahead in the ego's lane, and one in the next lane."""
    ego, zero = 30.0 * u[:, 0], np.zeros(len(u), dtype=np.int64)
    speed = np.zeros((len(u), 2))
    x_m = np.column_stack([ahead(u[:, 1], ego, speed[:, 0], config), 200.0 * u[:, 2] - 20.0])
    return placed(zero, ego, x_m, np.column_stack([zero, zero + 1.0]), speed)


def overtaker(u: FloatArray, config: Config) -> World:
    """Create scenes with a fast vehicle behind in the next lane, and one ahead in the own lane."""
    ego, zero = 30.0 * u[:, 0], np.zeros(len(u), dtype=np.int64)
    speed = np.column_stack([20.0 + 20.0 * u[:, 1], 40.0 * u[:, 2]])
    x_m = np.column_stack([-150.0 * u[:, 3], ahead(u[:, 4], ego, speed[:, 1], config)])
    return placed(zero, ego, x_m, np.column_stack([zero + 1.0, zero]), speed)


def anything(u: FloatArray, config: Config) -> World:
    """Create scenes with four vehicles anywhere; those in the ego's lane have safe gaps to it."""
    ego_lane = np.floor(3 * u[:, 20]).astype(np.int64)
    lane, speed = np.floor(3 * u[:, 4:8]), 40.0 * u[:, 8:12]
    ego = 30.0 * u[:, 21]
    x_m, far_m = 240.0 * u[:, :4] - 120.0, ahead(u[:, 12:16], ego[:, None], speed, config)
    x_m = with_safe_gaps(x_m, far_m, lane == ego_lane[:, None], ego, speed, config)
    return placed(ego_lane, ego, x_m, lane, speed)


def with_safe_gaps(
    x_m: FloatArray,
    far_m: FloatArray,
    own: BoolArray,
    ego: FloatArray,
    speed: FloatArray,
    config: Config,
) -> FloatArray:
    """Return ``x_m``, shape (scenes, others), changed to safe gaps in the ego's lane, metres.

    There, which ``own`` marks, a vehicle ahead moves to ``far_m``, and one behind so far back that
    it can stop behind the ego. ``ego``, shape (scenes,), and ``speed`` are speeds, m/s.
    """
    step_s = config.simulation.step_length_s
    stops_m = [
        stopping_distance(v, config.strict.follower_braking_m_s2, step_s) for v in (speed, ego)
    ]
    near_m = LENGTH_M + 2.0 + speed * step_s + np.maximum(stops_m[0] - stops_m[1][:, None], 0.0)
    return np.where(own, np.where(x_m > 0, far_m, np.minimum(x_m, -near_m)), x_m)


FAMILIES: dict[str, Family] = {
    "lead-brakes": Family(1, lead_brakes, (-BRAKES, 0, 1)),
    "cut-in": Family(1, cut_in, (-BRAKES, -1, 1)),
    "both-sides": Family(2, both_sides, (0.0, -1, 9)),
    "standing": Family(2, standing, (0.0, 0, 9)),
    "overtaker": Family(2, overtaker, (2.0, 0, 9)),
    "anything": Family(4, anything, (-BRAKES, 1, 9)),
}
CONSTANT_SPEED = Family(1, lead_brakes, (0.0, 0, 0))
"""The simplest family: the vehicle ahead keeps its speed, and the proposed action is maintain."""


class Tally(NamedTuple):
    """How many scenes were simulated, and in how many the ego had a collision."""

    scenes: int
    ego_hits: int
    """Scenes in which the ego hit a vehicle."""
    was_hit: int
    """Scenes in which a vehicle hit the ego."""
    least_m: float
    """Smallest separation of the ego in all scenes, metres; negative if bodies overlap."""


def genes(family: Family) -> int:
    """Return the number of genes that encode one scene of a family."""
    return PLACED * family.others + RATES * (family.others + 1) * DECISIONS


def orders(genome: FloatArray, family: Family, config: Config) -> Iterator[Orders]:
    """Yield the commands of each decision; ``genome``, shape (scenes, genes), encodes them.

    In each decision every vehicle has an acceleration gene and a lateral gene. Both genes of the
    ego together select its proposed action. For the other vehicles:

    - An acceleration gene of 0 is half-way between the bounds of the acceleration. From 2/3 on it
      is the upper bound, and from -2/3 on the lower one.
    - The sign of a lateral gene is the direction, left positive. Above 0.7 in size, the vehicle
      moves at the highest lateral speed; above 0.4 it creeps at ``CREEPING_M_S``, else it keeps its
      lateral position.
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

    Both have shape (scenes,). The result is 0 without a collision, 1 if the ego hit something, 2 if
    a vehicle hit the ego.
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
    losses = np.where(ended == 2, 1.0, least_m)
    tally = Tally(
        len(genome), int((ended == 1).sum()), int((ended == 2).sum()), float(least_m.min())
    )
    return tally, losses
