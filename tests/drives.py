"""Driving an environment by the numbers of actions."""

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np

from drl_av.env.highway import HighwayEnv

KEEP, BRAKE, HARD_BRAKE, RIGHT, LEFT = 0, 2, 3, 4, 8
"""Numbers of actions; right and left at an unchanged speed."""
ID = "drl_av/Highway-v0"
Place = Callable[..., HighwayEnv]
"""Makes an environment from the vehicles that a scenario places."""


def start(env: HighwayEnv, vehicles: int, seed: int = 0) -> dict[str, Any]:
    return env.reset(seed=seed, options={"vehicles": vehicles})[1]


def y_m(env: HighwayEnv) -> float:
    return float(env.scene.snapshot.y_m[0])


def until_over(env: HighwayEnv, action: int, at_most: int = 20) -> dict[str, Any]:
    """Info of the step that ended the episode."""
    for _ in range(at_most):
        _, reward, terminated, _, info = env.step(action)
        if terminated:
            assert reward == env.config.reward.collision_reward
            return info
        assert not info["collision"]
    raise AssertionError(f"nothing ended in {at_most} decisions")


def trajectory(env: HighwayEnv, seed: int, decisions: int = 200) -> str:
    """SHA-256 over all positions and speeds of an episode of fixed decisions."""
    env.reset(seed=seed, options={"vehicles": 30})
    digest = hashlib.sha256()
    for decision in range(decisions + 1):
        shot = env.scene.snapshot
        for values in (shot.s_m, shot.y_m, shot.speed_m_s, shot.lateral_speed_m_s):
            digest.update(np.ascontiguousarray(values).tobytes())
        if decision == decisions or env.step(decision * 5 % 12)[2]:
            break
    return f"{env.decisions} {digest.hexdigest()}"


def trajectory_of_a_fresh_process(seed: int) -> str:
    env = HighwayEnv()
    try:
        return trajectory(env, seed)
    finally:
        env.close()
