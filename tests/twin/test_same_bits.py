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
        ("overtaking", 5, "3302ab8deb4d60bf"),
        ("overtaking", 30, "ec5e3e7da5a8c217"),
        ("overtaking", 60, "66b65c2b6194d12a"),
        ("paper", 30, "3485e03e1e225287"),
        ("hazards", 30, "6d77516f613038f1"),
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
