"""The adversary's world: others that move sideways at any speed within the bounds, and turn."""

import numpy as np
import pytest

from drl_av.config import Config
from verification.batch_check import BatchStrict
from verification.falsification import placed
from verification.kinematic_simulator import Mover, Orders, collision

STRICT = Config().updated("safety", check="strict")
SCENES, DECISIONS = 3000, 8
LANE = np.array([1])
SIDES = [-1.0, -0.6, -0.2, -0.05, 0.0, 0.05, 0.2, 0.6, 1.0]


def test_the_way_out_stays_free_but_for_two_that_enter_one_lane_and_the_ego_hits_nobody() -> None:
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
        told = Orders(rng.integers(0, 12, SCENES), rates, last)
        least_m = mover.decision(world, judge(world, told.proposal), told)
        hit = watched & (least_m < 0).any(axis=1)
        met = [collision(world, int(row)) for row in np.flatnonzero(hit)]
        assert not any(m is None or m.kind.ego_hit for m in met)
        watched &= ~hit
        # such an ego is two seconds into its lane change: over the line, its centre not yet
        place = world.y_m[:, 0] / 3.8
        entering = np.isclose(np.abs(place - np.round(place)), 0.4) & (world.target >= 0)
        assert judge.free(world)[watched & ~entering].all()


def test_whom_the_ego_would_come_through_in_one_step_it_hits() -> None:
    # 30 m/s are 15 m a step: from 0.5 m behind a standing vehicle, bodies 5 m long, past its front
    world = placed(LANE, np.array([30.0]), np.array([[5.5]]), LANE[:, None], np.zeros((1, 1)))
    told = Orders(np.zeros(1, dtype=np.int64), np.zeros((1, 1)), np.zeros((1, 1)))
    least_m = Mover(STRICT).decision(world, told.proposal, told)
    assert least_m[0, 0] < 0
    met = collision(world, 0)
    assert met is not None
    assert met.kind.ego_hit


def test_whom_the_ego_passes_in_the_next_lane_it_does_not_hit() -> None:
    world = placed(LANE, np.array([30.0]), np.array([[5.5]]), LANE[:, None] + 1, np.zeros((1, 1)))
    told = Orders(np.zeros(1, dtype=np.int64), np.zeros((1, 1)), np.zeros((1, 1)))
    assert Mover(STRICT).decision(world, told.proposal, told)[0, 0] == pytest.approx(2.0)
