"""The traffic of the twin stays the same to the bit, whatever makes it faster.

Where a change of its rules is meant to change it, the new hashes go here.
"""

import hashlib

import numpy as np
import pytest

from drl_av.config.presets import as_config
from drl_av.env.vector import TwinVectorEnv

WORLDS, DECISIONS = 16, 100


@pytest.mark.parametrize(
    ("kind", "vehicles", "expected"),
    [
        ("calm", 5, "caa01b35cbe920ed"),
        ("calm", 30, "eae3b13a32599ea7"),
        ("calm", 60, "bae4eab60a07a0c9"),
        ("overtaking", 5, "4b70da01c8ca403d"),
        ("overtaking", 30, "de035d31082327b7"),
        ("overtaking", 60, "bcb4f17ee70aa534"),
        ("paper", 30, "120e78d61324f2d2"),
        ("hazards", 30, "9ac675445acf1671"),
    ],
)
def test_the_traffic_of_an_episode_has_one_hash(kind: str, vehicles: int, expected: str) -> None:
    traffic = {"kind": kind, "random_lane_changes_per_s": 0.0, "keep_stopping_distance": False}
    number = {"vehicles_min": vehicles, "vehicles_max": vehicles}
    env = TwinVectorEnv(WORLDS, config=as_config({"traffic": traffic | number}))
    env.reset(seed=3_000_000)
    found, rows = hashlib.sha256(), np.arange(WORLDS)
    for decision in range(DECISIONS):
        env.step((decision // 9 * 5 + rows) % 12)
        found.update(env.episodes.scene[:, :4, : vehicles + 1].tobytes())
    assert found.hexdigest()[:16] == expected
