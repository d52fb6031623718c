"""Several networks that learn apart and decide together: their mean, in one network too."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from drl_av.config import Config
from drl_av.env import HighwayEnv
from drl_av.learning import checkpoint
from drl_av.learning.adaptation import take_over
from drl_av.learning.ensemble import MeanPolicy, divided, merged
from drl_av.learning.qnetwork import GreedyPolicy, QNetwork
from drl_av.learning.training import Training

TOGETHER = (
    Config()
    .updated("simulation", decisions_per_episode=20)
    .updated("traffic", vehicles_min=3, vehicles_max=3)
    .updated("learning", episodes=4, networks=3, mirrored=True, evaluation_episodes=1)
)


def tiny(*parameters: float) -> QNetwork:
    """One input, one hidden unit in one layer, two actions."""
    network = QNetwork(np.random.default_rng(0), 1, 2, (1,))
    network.flat.copy_(torch.tensor(parameters))
    return network


def test_two_networks_of_one_hidden_unit_are_one_of_two() -> None:
    # s = 3: z = 2 * 3 + 1 = 7, Q = (7 + 1, -7 + 2) = (8, -5)
    one = tiny(2.0, 1.0, 1.0, -1.0, 1.0, 2.0)
    # s = 3: z = -4 * 3 + 2 = -10 -> -0.1, Q = (10 * -0.1, 20 * -0.1 + 5) = (-1, 3)
    other = tiny(-4.0, 2.0, 10.0, 20.0, 0.0, 5.0)
    both = merged([one, other])
    assert both.sizes == (1, 2, 2)
    s_t = np.array([3.0], np.float32)
    for policy in (GreedyPolicy(both), MeanPolicy([GreedyPolicy(one), GreedyPolicy(other)])):
        assert policy.values(s_t) == pytest.approx([3.5, -1.0], abs=1e-6)
        assert policy(s_t) == 0  # the other alone would take 1


@given(count=st.integers(1, 5), seed=st.integers(0, 1000), units=st.integers(1, 9))
def test_merged_networks_value_as_their_mean_and_can_be_divided_again(
    count: int, seed: int, units: int
) -> None:
    rng = np.random.default_rng(seed)
    networks = [QNetwork(rng, hidden=(units, units)) for _ in range(count)]
    whole = merged(networks)
    s_t = rng.normal(size=27).astype(np.float32)
    mean = np.mean([GreedyPolicy(network).values(s_t) for network in networks], axis=0)
    np.testing.assert_allclose(GreedyPolicy(whole).values(s_t), mean, atol=1e-5)
    parts = divided(whole, count)
    mean = np.mean([GreedyPolicy(part).values(s_t) for part in parts], axis=0)
    np.testing.assert_allclose(GreedyPolicy(whole).values(s_t), mean, atol=1e-5)
    for part, network in zip(parts, networks, strict=True):
        for mine, its in zip(part.layers[:-1], network.layers[:-1], strict=True):  # type: ignore[arg-type]
            assert torch.equal(mine.weight, its.weight)
            assert torch.equal(mine.bias, its.bias)


def test_a_training_of_three_learns_three_and_drives_by_their_mean(tmp_path: Path) -> None:
    with closing(HighwayEnv(config=TOGETHER)) as env:
        training = Training(env)
        begun = [learner.network.flat.clone() for learner in training.learners.values()]
        row = training.run_episode()
        learnt = [learner.network for learner in training.learners.values()]
        assert [learner.steps for learner in training.learners.values()] == [row.decisions] * 3
        for before, network in zip(begun, learnt, strict=True):
            assert not torch.equal(before, network.flat)
        assert not torch.equal(learnt[0].flat, learnt[1].flat)

        s_t, _ = env.reset(seed=1)
        values = training.policy.values(s_t)
        file = tmp_path / "driver.safetensors"
        checkpoint.save_policy(file, training.network, TOGETHER)
        stored, _ = checkpoint.load_policy(file)
        assert stored.sizes == (27, 300, 300, 12)
        adapted = Training(env)
        assert not take_over(adapted, file)
        for network in (stored, adapted.network):
            apart = [GreedyPolicy(own).values(s_t) for own in divided(network, 3)]
            alone = [GreedyPolicy(own).values(s_t) for own in learnt]
            np.testing.assert_allclose(np.mean(apart, axis=0), np.mean(alone, axis=0), atol=1e-5)
        np.testing.assert_allclose(adapted.policy.values(s_t), values, atol=1e-5)
