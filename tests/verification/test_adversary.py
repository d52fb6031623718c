"""The adversary's world: others that move sideways at any speed within the bounds, and turn."""

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.road.snapshot import Collision, CollisionKind
from verification.adversary import BatchStrict, Mover, Orders, World
from verification.families import placed

STRICT = Config().updated("safety", check="strict")
SCENES, DECISIONS = 3000, 8
SIDES = [-1.0, -0.6, -0.2, -0.05, -0.01, 0.0, 0.01, 0.05, 0.2, 0.6, 1.0]


def test_the_fallback_stays_free_but_for_two_that_enter_one_lane_and_the_ego_hits_no_vehicle() -> (
    None
):
    rng = np.random.default_rng(7)
    lane, others = rng.integers(0, 3, SCENES), rng.integers(0, 3, (SCENES, 2))
    ahead_m = 100 * rng.random((SCENES, 2)) ** 1.5
    world = placed(lane, 30 * rng.random(SCENES), ahead_m, others, 30 * rng.random((SCENES, 2)))
    judge, mover, last = BatchStrict(STRICT), Mover(STRICT), np.full((SCENES, 2), 0.0)
    free = judge.free(world)
    watched = free.copy()
    for _ in range(DECISIONS):
        reversed = rng.random((SCENES, 2)) < 0.3
        last = np.where(reversed, rng.choice(SIDES, (SCENES, 2)), last)
        rates = rng.choice([-4.0, -2.0, 0.0, 2.0], (SCENES, 2))
        orders = Orders(rng.integers(0, 12, SCENES), rates, last)
        mover.decision(world, judge(world, orders.proposal), orders)
        assert not any(watched[row] and met.kind.ego_hit for row, met in world.collisions.items())
        watched[list(world.collisions)] = False
        # such an ego is two seconds into its lane change: over the line, its centre not yet
        place = world.y_m[:, 0] / 3.8
        entering = np.isclose(np.abs(place - np.round(place)), 0.4) & (world.target >= 0)
        assert judge.free(world)[watched & ~entering].all()


NOTHING = Orders(np.zeros(1, dtype=np.int64), np.zeros((1, 1)), np.zeros((1, 1)))
"""The ego maintains its speed, and the other one too."""


def beside(
    *others: tuple[float, int], ego_m_s: float = 30.0, other_m_s: float = 0.0, lane: int = 1
) -> World:
    """The ego, and vehicles that far ahead in these lanes."""
    ahead_m, lanes = (np.array([column]) for column in zip(*others, strict=True))
    speeds_m_s = np.full((1, len(others)), other_m_s)
    return placed(np.array([lane]), np.array([ego_m_s]), ahead_m, lanes, speeds_m_s)


@pytest.mark.parametrize(
    ("lane", "least_m", "collisions"),
    [
        # side by side, one body in the other
        (1, -1.8, {0: Collision(CollisionKind.HIT_AHEAD, "vehicle1")}),
        (2, 2.0, {}),
    ],
)
def test_the_ego_hits_a_vehicle_that_it_passes_within_a_step_only_in_its_own_lane(
    lane: int, least_m: float, collisions: dict[int, Collision]
) -> None:
    # 30 m/s are 15 m a step: from 0.5 m behind a standing vehicle, bodies 5 m long, past its front
    world = beside((5.5, lane))
    Mover(STRICT).decision(world, NOTHING.proposal, NOTHING)
    assert world.least_m[0, 0] == pytest.approx(least_m)
    assert world.collisions == collisions


def test_of_two_vehicles_in_its_way_the_ego_hits_the_one_that_it_reaches_first() -> None:
    # gaps of 7 and 4 m, both closed within a step of 15 m
    world = beside((12.0, 1), (9.0, 1))
    still = Orders(np.zeros(1, dtype=np.int64), np.zeros((1, 2)), np.zeros((1, 2)))
    Mover(STRICT).decision(world, still.proposal, still)
    assert world.collisions == {0: Collision(CollisionKind.HIT_AHEAD, "vehicle2")}


def test_the_ego_that_leaves_the_road_hits_its_edge() -> None:
    # 1 m from its side to the edge at 0.76 m/s: the third step of half a second
    world = beside((50.0, 1), ego_m_s=20.0, other_m_s=20.0, lane=2)
    left, mover = NOTHING._replace(proposal=np.array([8])), Mover(STRICT)
    mover.decision(world, left.proposal, left)
    assert world.collisions == {}
    mover.decision(world, left.proposal, left)
    assert world.collisions == {0: Collision(CollisionKind.HIT_EDGE, None)}


@pytest.mark.parametrize(
    ("y_m", "side", "goes"),
    [
        (7.4, -1.0, False),  # 0.0076 m/s is standing still: a movement begins
        (7.4, -0.01, True),
        (7.4, 1.0, True),  # back to the centre of its lane
        # its right side is over the line at 5.7 m by a centimetre at 6.59 m
        (6.595, -0.01, True),
        (6.591, -0.01, False),
    ],
)
def test_one_that_creeps_beside_the_ego_stands_still_for_bound_3(
    y_m: float, side: float, goes: bool
) -> None:
    world = beside((0.0, 2), ego_m_s=20.0, other_m_s=20.0)
    world.y_m[0, 1], world.lateral_m_s[0, 1] = y_m, -0.0076
    told = NOTHING._replace(side=np.array([[side]]))
    _, places_m = next(Mover(STRICT).steps(world, NOTHING.proposal, told))
    assert bool(places_m[0, 1] != y_m) is goes


def test_no_vehicle_begins_to_move_in_while_the_ego_passes() -> None:
    # at 3.5 m/s its side would touch the ego's in the step in which the ego passes it
    config = STRICT.updated("strict", lateral_speed_m_s=3.5)
    right = NOTHING._replace(side=np.full((1, 1), -1.0))
    # the ego comes 12.5 m nearer in a step: it ends 0.1 m ahead, or 1.5 m, or is past already
    for ahead_m, moves in ((7.4, False), (6.0, False), (-5.1, True)):
        world = beside((ahead_m, 2), other_m_s=5.0)
        world.y_m[:, 1] = 7.2
        steps = Mover(config).steps(world, right.proposal, right)
        first_m, second_m = (places_m[0, 1] for _, places_m in steps)
        assert bool(first_m < 7.2) is moves
        assert second_m < 7.2
        assert not world.collisions
