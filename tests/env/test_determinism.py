"""A seed is a trajectory, whatever runs before it or beside it."""

import multiprocessing

import gymnasium
import numpy as np
import pytest
from drives import (
    ID,
    KEEP,
    printed_by_a_fresh_process,
    start,
    trajectory,
    trajectory_of_a_fresh_process,
)

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv


@pytest.fixture(scope="module")
def hashes(env: HighwayEnv) -> dict[int, str]:
    """Of two full episodes by their seed; the second was driven after the first and others."""
    made: dict[int, str] = {}
    for seed in range(50):
        text = trajectory(env, seed)
        if text.startswith("200 "):
            made[seed] = text
        if len(made) == 2:
            return made
    raise AssertionError("hardly an episode lasts")


def test_a_seed_is_the_same_trajectory_again_and_another_seed_another(
    env: HighwayEnv, hashes: dict[int, str]
) -> None:
    assert len(set(hashes.values())) == 2
    start(env, 7, seed=99)
    for action in (1, 5, 9):
        env.step(action)
    assert {seed: trajectory(env, seed) for seed in reversed(hashes)} == hashes


def test_a_seed_is_the_same_trajectory_after_sumo_was_ended_or_taken_over(
    env: HighwayEnv, unchecked: HighwayEnv, hashes: dict[int, str]
) -> None:
    seed, hashed = next(iter(hashes.items()))
    env.close()
    assert trajectory(env, seed) == hashed
    start(unchecked, 30, seed=1)
    unchecked.step(9)
    assert trajectory(env, seed) == hashed


def test_a_seed_is_the_same_trajectory_in_a_fresh_process(hashes: dict[int, str]) -> None:
    seed, hashed = max(hashes.items())
    program = f"import drives; print(drives.trajectory_of_a_fresh_process({seed}))"
    assert printed_by_a_fresh_process(program) == hashed.split()


def test_a_seed_is_the_same_trajectory_in_spawned_workers(hashes: dict[int, str]) -> None:
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        assert pool.map(trajectory_of_a_fresh_process, hashes) == list(hashes.values())


def test_reset_with_a_seed_gives_the_same_observation(env: HighwayEnv) -> None:
    first, info = env.reset(seed=4, options={"vehicles": 12})
    other, _ = env.reset(seed=5, options={"vehicles": 12})
    again, info_again = env.reset(seed=4, options={"vehicles": 12})
    assert np.array_equal(first, again)
    assert np.array_equal(info["indicators"], info_again["indicators"])
    assert not np.array_equal(first, other)


def test_two_drive_at_once_in_one_process(env: HighwayEnv, unchecked: HighwayEnv) -> None:
    start(env, 3)
    env.step(KEEP)
    start(unchecked, 3)
    for _ in range(2):
        unchecked.step(KEEP)
        env.step(KEEP)
    assert env.scene.snapshot.time_s == 3.0
    assert unchecked.scene.snapshot.time_s == 2.0


def test_several_drive_at_once_in_spawned_workers_each_as_if_alone(env: HighwayEnv) -> None:
    config = Config().updated("traffic", vehicles_min=20, vehicles_max=20)
    vector = gymnasium.make_vec(
        ID,
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},
        safety_check="permit_all",
        config=config,
    )
    try:
        observations, info = vector.reset(seed=[21, 22])
        together = [observations]
        assert info["vehicles"].tolist() == [20, 20]
        for action in (1, 0, 2, 1):
            observations, _, _, _, info = vector.step(np.array([action, 0]))
            together.append(observations)
        assert info["executed_action"].tolist() == [1, 0]
    finally:
        vector.close()
    alone = HighwayEnv(safety_check="permit_all", config=config)
    for column, seed in enumerate((21, 22)):
        observation, _ = alone.reset(seed=seed)
        assert np.array_equal(observation, together[0][column])
        for row, action in enumerate((1, 0, 2, 1), 1):
            observation = alone.step(action if column == 0 else 0)[0]
            assert np.array_equal(observation, together[row][column])
    alone.close()
