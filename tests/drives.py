"""Driving an environment by the numbers of actions."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from programs import python

from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation.recording import Recording
from drl_av.files.table import Row

KEEP, BRAKE, HARD_BRAKE, RIGHT, LEFT = 0, 2, 3, 4, 8
"""Numbers of actions; right and left at an unchanged speed."""
ID = "drl_av/Highway-v0"
TESTS = str(Path(__file__).parent)
Place = Callable[..., HighwayEnv]
"""Makes an environment from the vehicles that a scenario places."""

RESULT = EpisodeResult(
    driver="idm",
    safety_check="paper",
    vehicles=5,
    seed=0,
    decisions=200,
    mean_speed_m_s=20.0,
    mean_reward=-0.25,
    mean_r_v=-0.5,
    mean_r_y=-0.25,
    mean_r_x=0.0,
    collided=False,
    ego_hit=False,
    collision="",
    safety_triggers=4,
    lane_changes=2,
    aborted_lane_changes=1,
    min_ttc_s=math.inf,
    min_headway_s=1.5,
    hard_brakes=0,
    d_safe_violations=0,
)
"""The row of an episode."""


def episode(driver: str, seed: int, speed_m_s: float, **changed: Any) -> EpisodeResult:
    """The row of another episode."""
    return replace(RESULT, driver=driver, seed=seed, mean_speed_m_s=speed_m_s, **changed)


def traffic_row(driver: str, traffic: str, seed: int, speed: float, hit: bool = False) -> Row:
    """The row of an episode in a kind of traffic, as a table has it."""
    return {
        "driver": driver,
        "traffic": traffic,
        "vehicles": "10",
        "seed": str(seed),
        "mean_speed_m_s": str(speed),
        "collided": str(hit),
        "ego_hit": str(hit),
    }


def hash_of(recording: Recording) -> str:
    """The SHA-256 of all positions and speeds of a recorded episode."""
    return hashlib.sha256(recording.states.tobytes()).hexdigest()


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


def printed_by_a_fresh_process(program: str) -> list[str]:
    """The words that a Python program prints in a process with another hash seed."""
    program = f"import sys; sys.path.insert(0, {TESTS!r}); {program}"
    done = python("-c", program, PYTHONHASHSEED="12345")
    assert done.returncode == 0, done.stderr
    return done.stdout.split()
