"""Drive random approaches in SUMO and in the simulator, and compare their collisions.

    python -m verification.approaches     # 10,000 for each step length, plant and road

In an approach, the ego meets one other vehicle. Both move at random, and no safety check is used.
Each plant, road and step length has its own approaches. The exit status is 1 if SUMO and the
simulator disagree on a collision or on a position.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.config.ego import LATERAL_PLANTS
from drl_av.road.snapshot import CollisionKind
from drl_av.safety.check import permit_all
from verification.adversary import LENGTH_M, Mover, Orders, World, one_by_one
from verification.falsify import show
from verification.families import placed
from verification.in_sumo import SumoWorld
from verification.program import Program, run_program

STEPS_S = (1.0, 0.5, 0.25)
ROADS = ("loop", "straight")
"""The roads of ``in_sumo`` on which a scene may lie anywhere, because no lane begins or ends."""
DECISIONS = 5
NEAR_M = 25.0
"""Largest distance between the other vehicle and the ego at the start."""
SIDES = (-1.0, 0.0, 0.0, 1.0)
APART_M = 1e-5
"""Largest permitted difference of positions in SUMO and the simulator, with the kinematic plant."""
IGNORED_M_S = 1e-3
"""SUMO ignores lateral movements below this speed. The steering plant commands such movements near
standstill."""


class Case(NamedTuple):
    """The settings with which ``compare`` drives random approaches in SUMO and the simulator."""

    plant: str = "kinematic"
    """The value of ``ego.lateral_plant``."""
    road: str = "loop"
    """One of ``ROADS``."""
    step_s: float = 0.5
    """Length of a SUMO step, seconds."""

    @property
    def config(self) -> Config:
        """The config with these settings, without a safety check."""
        config = Config().updated("safety", check="permit_all")
        config = config.updated("ego", lateral_plant=self.plant)
        return config.updated("simulation", step_length_s=self.step_s)

    @property
    def tolerance_m(self) -> float:
        """Largest permitted difference of positions in SUMO and the simulator, m."""
        return APART_M if self.plant == "kinematic" else IGNORED_M_S * self.step_s


def start(rng: np.random.Generator) -> World:
    """Return a random scene of the ego and one other vehicle, which do not overlap."""
    lane, other = rng.integers(0, 3, 2)
    least_m = LENGTH_M + 0.01 if lane == other else 0.0
    ahead_m = rng.choice([-1, 1]) * rng.uniform(least_m, NEAR_M)
    speeds = rng.uniform(0, 30, 1), rng.uniform(0, 40, (1, 1))
    return placed(np.array([lane]), speeds[0], np.array([[ahead_m]]), [[other]], speeds[1])


def orders(rng: np.random.Generator) -> Iterator[Orders]:
    """Yield random commands for both vehicles, for one decision after the other."""
    for _ in range(DECISIONS):
        acceleration = rng.uniform(-4, 2, (1, 1))
        yield Orders(rng.integers(0, 12, 1), acceleration, rng.choice(SIDES, (1, 1)))


def compare(case: Case, scenes: int, seed: int) -> dict[str, Any]:
    """Drive ``scenes`` random approaches in SUMO and in the simulator; return a row of the results.

    The two disagree about an approach if they report different collisions, or if a position differs
    by ``case.tolerance_m`` or more. The number of collisions in SUMO excludes those with the edge
    of the road.
    """
    sumo, mover = SumoWorld(case.config, case.road), Mover(case.config)
    rng = np.random.default_rng(seed)
    collisions, unlike, furthest_m = 0, 0, 0.0
    for _ in range(scenes):
        found, expected, off_m = sumo.play(start(rng), orders(rng), one_by_one(permit_all), mover)
        collisions += found is not None and found.kind is not CollisionKind.HIT_EDGE
        unlike += found != expected or off_m >= case.tolerance_m
        furthest_m = max(furthest_m, off_m)
    return {
        **case._asdict(),
        "approaches": scenes,
        "collisions": collisions,
        "unlike_the_simulator": unlike,
        "furthest_from_the_simulator_m": f"{furthest_m:.1e}",
    }


def main() -> int:
    parser = Program(__doc__)
    parser.number("--scenes", 10_000, "for each step length, plant and road")
    scenes = parser.parse_args().scenes
    cases = enumerate(product(LATERAL_PLANTS, ROADS, STEPS_S))
    rows = [compare(Case(*case), scenes, seed) for seed, case in cases]
    show(rows)
    print(parser.made_by())
    return 1 if any(row["unlike_the_simulator"] for row in rows) else 0


if __name__ == "__main__":
    run_program(main)
