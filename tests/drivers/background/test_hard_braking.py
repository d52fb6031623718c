"""Vehicles that brake hard at times."""

from typing import Any

import numpy as np
import pytest
from worlds import ROAD, ahead, snapshot

from drl_av.config import Config
from drl_av.drivers.background.finite_state import HardBraking
from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.env.highway import HighwayEnv
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.population import DriverModel

VEHICLE_TYPES = load_scenario(find_scenario("circular_three_lane")).vehicle_types

ROWS = [2, 5]
MODELS = np.array([0, 1, 4, 0, 2, 4])


def braking(chance: float, decisions: int, seed: int = 0) -> np.ndarray[Any, Any]:
    """Which of the two vehicles brake hard, shape (decisions, 2); the others never do."""
    config = Config().updated("traffic", hard_brakes_per_s=chance, hard_brake_s=3)
    draw, left, found = HardBraking(seed, MODELS, config), np.zeros(6, np.int64), []
    for _ in range(decisions):
        draw(left)
        found.append(left[ROWS] > 0)
        left = np.maximum(left - 1, 0)
    return np.array(found)


def test_without_a_chance_nothing_brakes() -> None:
    assert not braking(0.0, 50).any()


def test_each_brakes_at_times_and_not_both_always() -> None:
    hard = braking(0.05, 400)
    assert hard.any(axis=0).all()
    assert not hard.all(axis=1).all()


def test_it_brakes_for_three_decisions_about_every_twenty_of_the_others() -> None:
    column = braking(0.05, 20_000)[:, 0]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], column.astype(int), [0]))))
    lengths = edges[1::2] - edges[::2]
    assert (lengths[:-1] % 3 == 0).all()  # two may follow each other at once
    assert lengths[:-1].min() == 3
    # 20 decisions until the next, then 3: a share of 3 / 23
    assert column.mean() == pytest.approx(3 / 23, abs=0.01)


def test_the_seed_determines_when() -> None:
    first, again, other = (braking(0.05, 100, seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_drawn_at_once_they_are_those_of_the_decisions_one_by_one() -> None:
    config = Config().updated("traffic", hard_brakes_per_s=0.3)
    at_once = HardBraking(7, MODELS, config).begun(40).tolist()
    one_by_one = HardBraking(7, MODELS, config)
    found = [[n, row] for n in range(40) for _, row in one_by_one.begun(1).tolist()]
    assert at_once == found != []


def test_one_that_brakes_hard_keeps_its_lane() -> None:
    # behind a slow vehicle it would else change to the left, as the finite-state machine
    shot = snapshot(ahead(30.0, speed_m_s=18.0))
    models = np.array([DriverModel.HARD_BRAKING, DriverModel.SUMO])
    for per_s, command in ((0.0, (0, 1)), (1.0, (0, 0))):
        traffic = {"hard_braking_share": 1.0, "hard_brakes_per_s": per_s}
        config = Config().with_traffic("calm").updated("traffic", **traffic)
        drivers = TrafficDrivers(config, ROAD, VEHICLE_TYPES)
        drivers.start(models, np.array([30.0, 30.0]), 0)
        (row,), (acceleration,), (side,) = drivers(shot)
        assert (row, side) == command
        assert (acceleration == -4.0) is (side == 0)


def test_in_sumo_a_vehicle_brakes_at_4_m_s2_for_three_seconds_and_nothing_collides() -> None:
    traffic = {"hard_braking_share": 1.0, "hard_brakes_per_s": 0.05, "hard_brake_s": 3}
    config = Config().with_traffic("calm").updated("traffic", **traffic)
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
