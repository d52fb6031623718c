"""Half of a minibatch is seen in the mirror."""

import numpy as np
import pytest
from worlds import TINY_MIRROR

from drl_av.config import Config, LearningConfig
from drl_av.errors import ConfigError
from drl_av.learning.algorithm_1 import mirror_half, require_symmetry
from drl_av.learning.replay import TwoBuffers
from drl_av.road.road import Road

HALF_AND_HALF = LearningConfig(safe_capacity=10, collision_capacity=10, collision_fraction=0.5)


def test_half_of_the_safe_and_half_of_the_collision_rows_are_mirrored():
    buffer = TwoBuffers(3, HALF_AND_HALF)
    buffer.add_safe(np.array([0, 1, 0]), 1, -0.1, np.array([2, 3, 1]))
    buffer.add_collision(np.array([4, 5, 0]), 1, -5.0)
    before = buffer.state()["safe.rows"]
    batch = mirror_half(buffer.sample(8, np.random.default_rng(0)), TINY_MIRROR)
    assert np.array_equal(buffer.state()["safe.rows"], before)  # the experience itself stays
    assert batch.a_t.tolist() == [2, 1, 2, 1, 2, 1, 2, 1]
    assert batch.s_t[:, 0].tolist() == [1, 0, 1, 0, 5, 4, 5, 4]
    assert batch.s_tp1[:2].tolist() == [[3, 2, -1], [2, 3, 1]]
    assert batch.r_tp1.tolist() == [np.float32(-0.1)] * 4 + [-5.0] * 4


def test_a_lane_that_is_always_the_desired_one_is_no_road_to_mirror_unless_it_is_the_middle_one():
    def config(desired: str, lateral_m: float, mirrored: bool = True) -> Config:
        reward = {"desired": desired, "desired_lateral_m": lateral_m}
        return Config().updated("reward", **reward).updated("learning", mirrored=mirrored)

    road = Road(500.0, 3.8, (True, True, True))
    with pytest.raises(ConfigError, match="is not the middle of the road"):
        require_symmetry(config("fixed", 7.6), road)
    require_symmetry(config("fixed", 3.8), road)
    require_symmetry(config("fixed", 7.6, mirrored=False), road)
    require_symmetry(config("traffic", 7.6), road)
