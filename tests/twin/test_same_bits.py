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
        ("calm", 30, "8792b7a330d1c161"),
        ("calm", 60, "cb11d435bc5ca55d"),
        ("overtaking", 5, "e77e77cbb181883c"),
        ("overtaking", 30, "fb01834ee24c0e3e"),
        ("overtaking", 60, "fd85afb4f0ccbd7b"),
        ("paper", 30, "8b77cab16cda3da7"),
        ("hazards", 30, "bac92e58a1f7f887"),
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
