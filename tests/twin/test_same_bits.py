"""The traffic of the twin stays the same to the bit, whatever makes it faster."""

import hashlib

import numpy as np
import pytest

from drl_av.config.presets import as_config
from drl_av.env.vector import TwinVectorEnv

WORLDS, DECISIONS = 16, 100


@pytest.mark.parametrize(
    ("kind", "vehicles", "expected"),
    [
        ("calm", 5, "fe16b2d9620b054e"),
        ("calm", 30, "8e5025a5aa82cc46"),
        ("calm", 60, "e15c7bf63b7f5f51"),
        ("overtaking", 5, "1b7e37ddd9c79b28"),
        ("overtaking", 30, "345d26c9c17573a8"),
        ("overtaking", 60, "7303dc5e111719ee"),
    ],
)
def test_the_traffic_of_an_episode_has_one_hash(kind: str, vehicles: int, expected: str) -> None:
    env = TwinVectorEnv(WORLDS, config=as_config({"traffic": {"kind": kind}}))
    env.reset(seed=3_000_000, options={"vehicles": vehicles})
    found, rows = hashlib.sha256(), np.arange(WORLDS)
    for decision in range(DECISIONS):
        env.step((decision // 9 * 5 + rows) % 12)
        found.update(env.episodes.scene[:, :4, : vehicles + 1].tobytes())
    assert found.hexdigest()[:16] == expected
