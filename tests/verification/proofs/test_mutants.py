"""Arguments that are wrong in one number: Z3 refutes each, and its numbers collide when driven.

The check drives the ego as the wrong argument says; the others keep to the bounds as they are. SUMO
and the kinematic simulator drive each case side by side and must agree on the collision.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import z3

import verification.adversary as simulator
from drl_av.arrays import IntArray
from drl_av.config import Config
from drl_av.driving.scene import Scene
from drl_av.road.snapshot import CollisionKind
from drl_av.safety import strict
from drl_av.safety.check import Verdicts
from drl_av.safety.reachability import stopping_distance
from drl_av.safety.strict import Strict
from verification.adversary import LENGTH_M, NONE, BatchStrict, Mover, Orders, World, one_by_one
from verification.approaches import APART_M
from verification.in_sumo import SumoWorld
from verification.proofs import followers, following, lane_changes
from verification.proofs.argument import Argument, argument
from verification.proofs.lateral import Span, lanes_under
from verification.proofs.lemma import Claim, Model, counterexample
from verification.proofs.motion import lines

CONFIG = Config().updated("safety", check="strict")
TRUE = argument(CONFIG)
STEP_S, LENGTH = Fraction(1, 2), Fraction(LENGTH_M)
NEARER = Fraction("0.0123")
"""Taken from a gap, lest bodies meet at the end of a step exactly, which is no collision yet."""
CENTER_M, LEFT_M = Fraction(38, 10), Fraction(76, 10)
KEEP, LEFT = 0, 8
MAINTAIN, ACCELERATE, HARD_BRAKE = 0, 1, 3
Terms = dict[str, Any]


def refuted(
    claims: Callable[[Argument], Iterator[Claim]], wrong: Argument, *also: Callable[[Terms], Any]
) -> Model:
    """A counterexample to a wrong argument, where the true one has none."""
    assert not any(counterexample(claim) for claim in claims(TRUE))
    models = (counterexample(c, *(fact(c.names) for fact in also)) for c in claims(wrong))
    return next(model for model in models if model)


def rolls(speed: Any, braking: int) -> list[Any]:
    """The pieces of a stopping distance, which is the largest of them."""
    return [line(speed) for line in lines(Fraction(braking), Fraction(60), STEP_S)]


def two(
    ahead_m: Any, ego: Any, other: Any, places_m: tuple[Any, Any], origin: int, target: int
) -> World:
    """The ego and another one, whose centre is so far ahead."""
    return World(
        x_m=np.array([[5000.0, 5000.0 + float(ahead_m)]]),
        y_m=np.array([places_m], dtype=float),
        speed_m_s=np.array([[float(ego), float(other)]]),
        lateral_m_s=np.zeros((1, 2)),
        origin=np.array([origin]),
        target=np.array([target]),
        lane_s=np.zeros((1, 3)),
    )


def one_lane(model: Model) -> World:
    """The ego and one ahead of it; the model has the ego's speed after a step of braking hard."""
    ahead_m, ego = model["gap"] + LENGTH - NEARER, model["ego_speed"] + 2
    return two(ahead_m, ego, model["other_speed"], (CENTER_M, CENTER_M), NONE, NONE)


def overlap(margin_m: float, braking: int) -> Callable[[Terms], Any]:
    """Models in which the ego comes to rest so far inside a lead that brakes as hard as that."""

    def holds(n: Terms) -> Any:
        ends_m = [n["ego_speed"] / 2 + m for m in rolls(n["ego_speed"], 4)]
        rest_m = [n["gap"] + m + margin_m for m in rolls(n["other_speed"], braking)]
        return z3.And(
            n["ego_speed"] <= 28,
            n["gap"] >= 0.25,
            z3.Or([z3.And([m <= end for m in rest_m]) for end in ends_m]),
        )

    return holds


def orders(proposal: int, rates: list[float], side: float = 0.0) -> Iterator[Orders]:
    """The same proposal in every decision; the last acceleration for ever."""
    for decision in range(14):
        rate = rates[min(decision, len(rates) - 1)]
        yield Orders(np.array([proposal]), np.array([[rate]]), np.array([[side]]))


def collides(world: World, given: Iterator[Orders], check: Any, config: Config = CONFIG) -> bool:
    """Whether the ego and the other one collide, in SUMO and in the simulator alike."""
    found, expected, apart_m = SumoWorld(config).play(world, given, check, Mover(config))
    assert found == expected
    assert found is None or found.kind is not CollisionKind.HIT_EDGE
    assert apart_m < APART_M
    return found is not None


STRICT = BatchStrict(CONFIG)
HARDEST = -99.0


def test_a_lead_that_brakes_at_9_where_4_is_assumed() -> None:
    wrong = replace(TRUE, lead_braking_m_s2=Fraction(9))
    model = refuted(following.step_claims, wrong, overlap(1.0, 9), lambda n: n["clearance"] > 0.1)
    hard = CONFIG.updated("strict", braking_m_s2=9.0)
    for config, hit in ((hard, True), (CONFIG, False)):
        world = one_lane(model)
        assert collides(world, orders(KEEP + ACCELERATE, [HARDEST]), STRICT, config) is hit


def slack(world: World, proposal: IntArray) -> IntArray:
    """The check with a metre of slack: it sees the one ahead a metre farther away."""
    return STRICT(replace(world, x_m=world.x_m + np.array([0.0, 1.0])), proposal)


def test_a_metre_of_slack() -> None:
    wrong = replace(TRUE, clearance_m=TRUE.clearance_m - 1)
    model = refuted(following.step_claims, wrong, overlap(0.3, 4))
    assert collides(one_lane(model), orders(KEEP + ACCELERATE, [HARDEST]), slack)


def test_a_metre_of_slack_before_the_end_of_a_lane() -> None:
    wrong = replace(TRUE, clearance_m=TRUE.clearance_m - 1)
    model = refuted(following.lane_end_claims, wrong, overlap(0.3, 4))
    assert model["other_speed"] == model["other_speed_after"] == 0
    assert collides(one_lane(model), orders(KEEP + ACCELERATE, [0.0]), slack)


class Narrow(Strict):
    """The check, as plain Python, with a corridor of the ego's body alone, where it is."""

    def verdicts(self, scene: Scene) -> Verdicts:
        found, whole = Verdicts(np.empty(12, np.int64), np.empty(12, np.int64)), strict.corridor

        def body(y_m: float, width_m: float, change: Any, *of_road: Any) -> tuple[float, float]:
            return whole(y_m, width_m, (0, 0), *of_road)

        with patch.object(strict, "corridor", body):
            strict.strict_verdicts.python(*self._arguments(scene), *found)
        return found


def test_a_corridor_without_the_lane_change(monkeypatch: pytest.MonkeyPatch) -> None:
    def body(p: Any, y_m: Any, end: int, sign: int, a: Argument) -> Span:
        lowest, highest = (a.lane_m * lane for lane in lanes_under(p, y_m, a))
        return Span(lowest - a.width_m / 2, highest + a.width_m / 2)

    assert not any(counterexample(claim) for claim in lane_changes.corridor_claims(TRUE))
    monkeypatch.setattr(lane_changes, "corridor", body)
    # the other one is as far to the right as it may be without its side over the line at 1.9 m
    beside = (lambda n: n["y"] == Fraction(76, 100), lambda n: n["other_y"] == Fraction(282, 100))
    later = (lambda n: n["y_later"] == 2 * n["y"], lambda n: n["other_y_later"] == n["other_y"])
    facts = (*beside, *later)
    claims = lane_changes.corridor_claims(TRUE)
    models = (counterexample(c, *(fact(c.names) for fact in facts)) for c in claims)
    model = next(model for model in models if model)
    steady = CONFIG.updated("strict", lateral_speed_m_s=0.0)
    narrow = one_by_one(Narrow(steady.strict, steady.ego, steady.simulation))
    for check, hit in ((narrow, True), (STRICT, False)):
        world = two(0, 20, 20, (model["y"], model["other_y"]), 0, 1)
        assert collides(world, orders(LEFT, [0.0]), check) is hit


def test_a_reaction_one_step_less() -> None:
    wrong = replace(TRUE, response_s=Fraction(0))
    passes: list[Callable[[Terms], Any]] = [
        lambda n: n["rate"] == 0,
        # no contact in the decision, in which it accelerates
        lambda n: n["gap"] + n["ego_speed"] > n["follower_speed"] + 1.5,
        # a step after the decision, in which both brake: the ego has rolled 1.5 v - 1 m, it 0.5 s
        # times the sum of v + 1, v + 2 and v
        lambda n: n["gap"] + 1.5 * n["ego_speed"] - 0.8 <= 1.5 * n["follower_speed"] + 1.5,
    ]
    model = refuted(followers.response_claims, wrong, *passes)
    sudden = BatchStrict(CONFIG.updated("strict", follower_response_s=0.0))
    # a second into a lane change to the left; the one behind is there, at the right of its lane
    for check, hit in ((sudden, True), (STRICT, False)):
        speeds = model["ego_speed"], model["follower_speed"]
        world = two(NEARER - model["gap"] - LENGTH, *speeds, (0.76, 2.82), 0, 1)
        first, *rest = orders(LEFT + HARD_BRAKE, [2.0])
        told = iter([first._replace(proposal=np.array([LEFT + MAINTAIN])), *rest])
        assert collides(world, told, check) is hit


@dataclass
class Late:
    """The check with the others' lateral positions of a decision ago."""

    seen: World | None = None

    def __call__(self, world: World, proposal: IntArray) -> IntArray:
        before, self.seen = self.seen or world, replace(world)
        sideways = {
            name: np.column_stack([getattr(world, name)[:, :1], getattr(before, name)[:, 1:]])
            for name in ("y_m", "lateral_m_s")
        }
        return STRICT(replace(world, **sideways), proposal)


def test_an_abort_a_second_later() -> None:
    wrong = replace(TRUE, abort_decisions=2)
    model = refuted(lane_changes.entering_claims, wrong, lambda n: n["other_y"] == LEFT_M)
    # side by side at 20 m/s; the other one brakes as the ego does
    for check, hit in ((Late(), True), (STRICT, False)):
        world = two(0, 20, 20, (model["y"], model["other_y"]), 0, 1)
        assert collides(world, orders(LEFT, [0.0, 0.0, HARDEST], -1.0), check) is hit


def test_a_cut_in_gap_without_the_decision(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = replace(TRUE, cut_in_steps=0)
    model = refuted(
        following.cut_in_claims,
        wrong,
        lambda n: z3.And(n["rate"] == 2, n["ego_speed"] >= 16, n["ego_speed"] <= 29),
        lambda n: n["other_stopping"] == 10,  # from 10 m/s
        lambda n: z3.Or(
            [
                n["gap"] + 10.5 <= (n["ego_speed"] + 1) / 2 + rolled_m
                for rolled_m in rolls(n["ego_speed"] + 1, 4)
            ]
        ),
    )

    def without(speed: Any, rate: Any, other: Any, strict: Any, ego: Any, sim: Any) -> Any:
        stops = [stopping_distance(v, 4.0, sim.step_length_s) for v in (speed, other)]
        return np.maximum(stops[0] - stops[1], 0.0) + strict.clearance_m

    # the speeds and the gap of the model are those after the first of the decision's two steps
    before = model["ego_speed"] - 1
    gap_m = model["gap"] + STEP_S * (model["ego_speed"] - 10)
    for as_wrong, hit in ((True, True), (False, False)):
        if as_wrong:
            monkeypatch.setattr(simulator, "cut_in_gap", without)
        world = two(gap_m + LENGTH, before, 12, (CENTER_M, LEFT_M), NONE, NONE)
        given = orders(KEEP + ACCELERATE, [HARDEST], -1.0)
        assert collides(world, given, STRICT) is hit
        monkeypatch.undo()
