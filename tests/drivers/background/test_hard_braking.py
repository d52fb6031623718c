"""Vehicles that brake hard at times."""

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.drivers.background.finite_state import HardBraking
from drl_av.drivers.driver import Decisions
from drl_av.env.highway import HighwayEnv

KEEP_ON = Decisions(np.array([1.0, 2.0]), np.array([1, -1]))
ROWS = np.array([2, 5])


def braking(chance: float, decisions: int, seed: int = 0) -> list[Decisions]:
    config = Config().updated("traffic", hard_brakes_per_s=chance, hard_brake_s=3)
    override = HardBraking(seed, 6, config)
    return [override(KEEP_ON, ROWS) for _ in range(decisions)]


def test_without_a_chance_the_decisions_stay() -> None:
    for found in braking(0.0, 50):
        assert found.acceleration_m_s2.tolist() == [1.0, 2.0]
        assert found.side.tolist() == [1, -1]


def test_one_that_brakes_keeps_its_lane_and_the_other_its_decision() -> None:
    found = braking(0.05, 400)
    hard = np.array([decisions.acceleration_m_s2 == -4.0 for decisions in found])
    sides = np.array([decisions.side for decisions in found])
    assert np.array_equal(sides == 0, hard)
    assert hard.any(axis=0).all()
    assert not hard.all(axis=1).all()


def test_it_brakes_for_three_decisions_about_every_twenty_of_the_others() -> None:
    (column,) = np.array([d.acceleration_m_s2 == -4.0 for d in braking(0.05, 20_000)]).T[:1]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], column.astype(int), [0]))))
    lengths = edges[1::2] - edges[::2]
    assert (lengths[:-1] % 3 == 0).all()  # two may follow each other at once
    assert lengths[:-1].min() == 3
    # 20 decisions until the next, then 3: a share of 3 / 23
    assert column.mean() == pytest.approx(3 / 23, abs=0.01)


def test_the_seed_determines_when() -> None:
    first, again, other = (
        np.array([d.acceleration_m_s2 for d in braking(0.05, 100, seed)]) for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_in_sumo_a_vehicle_brakes_at_4_m_s2_for_three_seconds_and_nothing_collides() -> None:
    config = Config().updated(
        "traffic", hard_braking_share=1.0, hard_brakes_per_s=0.05, hard_brake_s=3
    )
    with HighwayEnv(config=config, safety_check="strict") as env:
        env.reset(seed=3, options={"vehicles": 15})
        speeds = [env.scene.snapshot.speed_m_s]
        for _ in range(60):
            *_, collided, _, _ = env.step(0)
            assert not collided
            speeds.append(env.scene.snapshot.speed_m_s)
    change = np.diff(speeds, axis=0)[:, 1:]
    assert change.min() == pytest.approx(-4.0)
    three = (change[:-2] < -3.99) & (change[1:-1] < -3.99) & (change[2:] < -3.99)
    assert three.any()
