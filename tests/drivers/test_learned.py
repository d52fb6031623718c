"""The learned driver decides by value, and in a mirror by the mean of both sides."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import ALONE, TINY_MIRROR

from drl_av.config import Config
from drl_av.drivers.learned import (
    LearnedDriver,
    Values,
    learned_driver,
    mirrored_values,
    network_values,
)
from drl_av.drivers.network import QNetwork
from drl_av.driving.mirror import MIRROR, mirrored_observations
from drl_av.errors import ConfigError

ACCELERATE = 1
ACCELERATE_LEFT = 9
S_T: Any = np.zeros(27, np.float32)


def stated(values: dict[int, float]) -> Values:
    """The values that a story gives, -1 for what it does not name."""
    return lambda s_t: np.array([values.get(number, -1.0) for number in range(12)], np.float32)


@pytest.mark.parametrize("mirrored", [False, True])
def test_an_observation_of_another_length_is_refused_with_the_remedy(mirrored: bool) -> None:
    network = QNetwork(np.random.default_rng(0), observation_size=27)
    driver = learned_driver(network, Config().updated("learning", mirrored=mirrored))
    with pytest.raises(ConfigError, match=r"has 30 numbers, but this driver observes 27: .*way"):
        driver.act(ALONE, np.zeros(30, np.float32))


def test_the_driver_follows_parameters_that_change_in_place() -> None:
    network, other = (QNetwork(np.random.default_rng(seed)) for seed in (0, 1))
    values = network_values(network)
    assert not np.array_equal(values(S_T), network_values(other)(S_T))
    network.flat[:] = other.flat
    assert np.array_equal(values(S_T), network_values(other)(S_T))


def test_of_equal_values_the_first_is_taken() -> None:
    driver = LearnedDriver(stated({ACCELERATE: 0.5, ACCELERATE_LEFT: 0.5}))
    assert driver.act(ALONE, S_T).number == ACCELERATE


def test_in_a_mirror_the_values_are_the_mean_of_both_sides() -> None:
    plain = network_values(QNetwork(np.random.default_rng(3), 3, 3, hidden=(4,)))
    s = np.array([0.3, 0.7, -1.0], np.float32)
    here, there = plain(s), plain(np.array([0.7, 0.3, 1.0], np.float32))
    expected = [(here[0] + there[0]) / 2, (here[1] + there[2]) / 2, (here[2] + there[1]) / 2]
    assert np.allclose(mirrored_values(plain, TINY_MIRROR)(s), expected)
    assert not np.allclose(plain(s), expected)


@given(seed=st.integers(0, 10_000))
def test_it_changes_left_where_in_the_mirror_it_changes_right(seed: int) -> None:
    rng = np.random.default_rng(seed)
    driver = LearnedDriver(mirrored_values(network_values(QNetwork(rng))))
    s = rng.standard_normal(27).astype(np.float32)
    reflected = driver.act(ALONE, mirrored_observations(s)).number
    assert reflected == MIRROR.action_permutation[driver.act(ALONE, s).number]


def test_the_settings_of_the_training_say_whether_it_decides_in_a_mirror() -> None:
    network = QNetwork(np.random.default_rng(1))
    s = np.random.default_rng(0).standard_normal(27).astype(np.float32)
    plain, mirrored = (
        learned_driver(network, Config().updated("learning", mirrored=on)).values(s)
        for on in (False, True)
    )
    assert np.array_equal(plain, network_values(network)(s))
    assert np.array_equal(mirrored, mirrored_values(network_values(network))(s))
    assert not np.allclose(plain, mirrored)
