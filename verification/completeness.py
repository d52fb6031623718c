"""Measures how often ``strict`` refuses actions that a search shows to be safe, by family.

    python -m verification.completeness                # minutes
    python -m verification.completeness --scenes 400 --adversaries 200

The families of scenes are those of ``verification/families.py``. The states are those to which
a random adversary leads. Each refused action is tried against several adversaries. A refused
acceleration counts as safe if the ego can execute it for one decision and then brake hard, without
a collision. A refused maneuver counts as safe if the ego can complete it without a collision, while
it brakes hard or drives as fast as the check permits. More adversaries find more collisions, so the
shares of safe actions are upper bounds. The exit status is 1 if the check permits no action in some
state.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, IntArray
from drl_av.config import Config
from drl_av.driving.actions import ACCELERATE, ACTIONS, HARD_BRAKE, KEEP, SIGNS
from verification.adversary import NONE, ROAD, BatchCheck, BatchStrict, Mover, Orders, World
from verification.falsification import genes, orders, play
from verification.falsify import share, show
from verification.families import FAMILIES, PLACED, Family
from verification.program import Program, run_program

DECISIONS = 10
"""Number of decisions of a scene: enough for the ego to stop."""
RATES_M_S2, SIDES = (-4.0, 0.0, 2.0), (-1.0, 0.0, 1.0)
"""The accelerations and sides (-1 right, 1 left) among which an adversary's commands are chosen."""
SCRIPTS = np.array([(rate, side) for rate in RATES_M_S2 for side in SIDES])
CHANGES = 0.3
"""Probability that a vehicle's command changes at a decision."""


class Refusals(NamedTuple):
    """Pairs of a state and an action that the check refuses in this state."""

    world: World
    """The states: scene i is the state of pair i."""
    proposal: IntArray
    """The refused actions, 0 to 11; this field and the next have shape (scenes,)."""
    is_maneuver: BoolArray
    """True if the check refuses the lateral part of the action, False if only its acceleration."""

    def at(self, rows: IntArray) -> "Refusals":
        """Return copies of the pairs with the indices ``rows``."""
        return Refusals(rows_of(self.world, rows), self.proposal[rows], self.is_maneuver[rows])


STATE = ("x_m", "y_m", "speed_m_s", "lateral_m_s", "origin", "target", "lane_s")
"""Names of the arrays of a World that ``rows_of`` copies."""


def rows_of(world: World, rows: IntArray) -> World:
    """Return a World with copies of some scenes; ``rows`` holds their indices, shape (R,)."""
    arrays: Any = [getattr(world, name)[rows].copy() for name in STATE]
    return World(*arrays)


def visited(family: Family, config: Config, scenes: int, seed: int) -> World:
    """Simulate scenes under ``strict`` with a random adversary, and return all states.

    A state is the situation before a decision. Each state is one scene of the returned World.
    """
    rng, judge, mover = np.random.default_rng(seed), BatchStrict(config), Mover(config)
    world = family.start(rng.random((scenes, PLACED * family.others)), config)
    states = []
    for order in orders(rng.normal(size=(scenes, genes(family))), family, config):
        states.append(rows_of(world, np.arange(scenes)))
        mover.decision(world, judge(world, order.proposal), order)
    arrays: Any = [np.concatenate([getattr(each, name) for each in states]) for name in STATE]
    return World(*arrays)


def on_road(world: World, proposal: IntArray) -> BoolArray:
    """Return whether each proposed action leads to a lane that exists; shape (scenes,)."""
    lane = np.round(world.y_m[:, 0] / ROAD.lane_width_m) + np.array(SIGNS)[proposal // 4]
    result: BoolArray = (world.target != NONE) | ((lane >= 0) & (lane < len(ROAD.open_lanes)))
    return result


def refusals(world: World, judge: BatchStrict) -> tuple[Refusals, BoolArray]:
    """Ask the check about all 12 actions in each state.

    Returns the refused pairs, and whether the check permits at least one action in each state,
    shape (scenes,).
    """
    scenes, rows, found = np.arange(len(world.x_m)), [], np.zeros(len(world.x_m), dtype=np.bool_)
    for number in range(len(ACTIONS)):
        proposal = np.full(len(scenes), number)
        executed = judge(world, proposal)
        found |= executed == proposal
        refused = scenes[(executed != proposal) & on_road(world, proposal)]
        is_maneuver = executed[refused] // 4 != number // 4
        rows.append(np.column_stack([refused, proposal[refused], is_maneuver]))
    table = np.concatenate(rows)
    return Refusals(rows_of(world, table[:, 0]), table[:, 1], table[:, 2] > 0), found


def adversary(
    number: int, shape: tuple[int, int], proposal: IntArray, rng: np.random.Generator
) -> Iterator[Orders]:
    """Yield the commands of adversary ``number`` for each decision; ``shape`` is (scenes, others).

    The first 9 adversaries give all vehicles one constant command, the next 9 a random constant
    command for each vehicle, and the others random commands that change.
    """
    script = np.full(shape, number % len(SCRIPTS))
    if number >= len(SCRIPTS):
        script = rng.integers(0, len(SCRIPTS), shape)
    for _ in range(DECISIONS):
        yield Orders(proposal, SCRIPTS[script, 0], SCRIPTS[script, 1])
        if number >= 2 * len(SCRIPTS):
            other = rng.integers(0, len(SCRIPTS), shape)
            script = np.where(rng.random(shape) < CHANGES, other, script)


Response = Callable[[World, IntArray], IntArray]
"""A function from a world and the proposed actions to the executed actions, 0 to 11; the actions
have shape (scenes,)."""


def forced(response: Response) -> BatchCheck:
    """Return a check that permits the first proposed actions; afterwards ``response`` decides."""
    made: list[IntArray] = []

    def check(world: World, proposal: IntArray) -> IntArray:
        made.append(proposal)
        brakes = np.full(len(proposal), 4 * KEEP + HARD_BRAKE)
        return proposal if len(made) == 1 else response(world, brakes)

    return check


def responses(config: Config, is_maneuver: bool) -> tuple[Response, ...]:
    """Return the ways in which the ego may drive on after a refused action.

    The action counts as safe if at least one of these responses avoids all collisions.
    """
    check = BatchStrict(config)
    if not is_maneuver:
        return check, lambda world, brakes: brakes
    return (
        lambda world, brakes: brakes,
        lambda world, brakes: check(world, np.full_like(brakes, 4 * KEEP + ACCELERATE)) % 4,
    )


def safe(pairs: Refusals, config: Config, adversaries: int, seed: int) -> BoolArray:
    """Return whether each refused action is safe, shape (scenes,).

    It is safe if some response avoids a collision with all adversaries. ``adversaries`` is the
    number of adversaries to try.
    """
    result = np.zeros(len(pairs.proposal), dtype=np.bool_)
    for is_maneuver in (False, True):
        for response in responses(config, is_maneuver):
            left = np.flatnonzero(~result & (pairs.is_maneuver == is_maneuver))
            for number in range(adversaries):
                some, rng = pairs.at(left), np.random.default_rng([seed, number])
                shape = some.world.x_m[:, 1:].shape
                told = adversary(number, shape, some.proposal, rng)
                _, ended = play(some.world, told, forced(response), Mover(config))
                left = left[ended == 0]
            result[left] = True
    return result


def measured(name: str, config: Config, scenes: int, adversaries: int, seed: int) -> dict[str, Any]:
    """Measure the family with this name, and return its row of the table."""
    judge, world = BatchStrict(config), visited(FAMILIES[name], config, scenes, seed)
    pairs, found = refusals(world, judge)
    every = [np.full(len(found), number) for number in range(len(ACTIONS))]
    proposals = sum(int(on_road(world, proposal).sum()) for proposal in every)
    is_safe, maneuver = safe(pairs, config, adversaries, seed), pairs.is_maneuver
    return {
        "family": name,
        "states": len(found),
        "without_action": int((~found).sum()),
        "fallback_not_free": int((~judge.free(world)).sum()),
        "refused_acceleration": float((~maneuver).sum() / proposals),
        "safe_of_these": share(is_safe[~maneuver]),
        "refused_maneuver": float(maneuver.sum() / proposals),
        "safe_of_those": share(is_safe[maneuver]),
    }


def main() -> int:
    parser = Program(__doc__)
    parser.some("--family", FAMILIES)
    parser.number("--scenes", 100, "for each family")
    parser.number("--adversaries", 60, "for each state")
    parser.number("--seed", 0, low=0)
    arguments = parser.parse_args()
    config = Config().updated("safety", check="strict")
    sizes = arguments.scenes, arguments.adversaries, arguments.seed
    rows = [measured(name, config, *sizes) for name in arguments.family]
    show(rows)
    print(parser.made_by())
    return 1 if any(row["without_action"] for row in rows) else 0


if __name__ == "__main__":
    run_program(main)
