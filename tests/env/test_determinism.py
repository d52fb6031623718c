"""A seed is a trajectory, whatever runs before it or beside it."""

import pytest
from drives import start, trajectory

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
