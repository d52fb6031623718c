"""Several networks that learn apart, decide by their mean, and go on as they were."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError
from drl_av.evaluation.drivers import learned_driver
from drl_av.learning.adaptation import take_over
from drl_av.learning.ensemble import MeanPolicy
from drl_av.learning.qnetwork import GreedyPolicy, QNetwork
from drl_av.learning.run import Run
from drl_av.learning.training import Training

TOGETHER = (
    Config()
    .updated("simulation", decisions_per_episode=20)
    .updated("traffic", vehicles_min=3, vehicles_max=3)
    .updated("learning", episodes=4, networks=3, mirrored=True, evaluation_episodes=1)
)


@pytest.fixture
def env() -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=TOGETHER)) as env:
        yield env


def tiny(*parameters: float) -> GreedyPolicy:
    """One input, one hidden unit in one layer, two actions."""
    network = QNetwork(np.random.default_rng(0), 1, 2, (1,))
    network.flat.copy_(torch.tensor(parameters))
    return GreedyPolicy(network)


def test_two_that_disagree_decide_by_the_mean_of_their_values() -> None:
    # s = 3: z = 2 * 3 + 1 = 7, Q = (7 + 1, -7 + 2) = (8, -5)
    one = tiny(2.0, 1.0, 1.0, -1.0, 1.0, 2.0)
    # s = 3: z = -4 * 3 + 2 = -10 -> -0.1, Q = (10 * -0.1, 20 * -0.1 + 5) = (-1, 3)
    other = tiny(-4.0, 2.0, 10.0, 20.0, 0.0, 5.0)
    both, s_t = MeanPolicy([one, other]), np.array([3.0], np.float32)
    for _ in range(2):  # whoever is asked twice says the same
        assert both.values(s_t) == pytest.approx([3.5, -1.0], abs=1e-6)
    assert (one(s_t), other(s_t), both(s_t)) == (0, 1, 0)


def test_each_learns_at_every_decision_from_a_batch_of_its_own(env: HighwayEnv) -> None:
    training = Training(env)
    first, *others = training.networks
    for network in others:  # alike at first, so that the batches alone tell them apart
        network.flat.copy_(first.flat)
    for learner in training._learners.values():
        learner.sync_target()
    row = training.run_episode()
    assert [learner.steps for learner in training._learners.values()] == [row.decisions] * 3
    for network in others:
        assert not torch.equal(network.flat, first.flat)
    assert not torch.equal(others[0].flat, others[1].flat)


def test_three_that_take_turns_make_one_gradient_step_a_decision(env: HighwayEnv) -> None:
    # the first learns at decisions 1, 4, ..., 19, and in the next episode from its first one on
    env.config = TOGETHER.updated("learning", networks_take_turns=True)
    training = Training(env)
    steps = []
    for _ in range(2):
        assert training.run_episode().decisions == 20
        steps.append([learner.steps for learner in training._learners.values()])
    assert steps == [[7, 7, 6], [14, 14, 12]]


def test_what_is_saved_drives_as_the_training_did_and_goes_on_as_it_was(
    env: HighwayEnv, tmp_path: Path
) -> None:
    training, run = Training(env), Run(tmp_path / "run")
    training.run_episode()
    run.create(TOGETHER, training)
    driver, config = learned_driver(run.folder)
    assert config == TOGETHER
    states: Any = np.random.default_rng(1).standard_normal((200, 27)).astype(np.float32)
    decided = [training.driver.act(env.scene, s_t).number for s_t in states]
    assert [driver.act(env.scene, s_t).number for s_t in states] == decided
    assert len(set(decided)) > 1
    alone = [GreedyPolicy(network) for network in training.networks]
    assert any([policy(s_t) for s_t in states] != decided for policy in alone)

    bare = tmp_path / "driver.safetensors"
    bare.write_bytes(run.policy_file.read_bytes())
    for file, experienced in ((run.policy_file, True), (bare, False)):
        adapted = Training(env)
        assert take_over(adapted, file) is experienced
        for mine, its in zip(adapted.networks, training.networks, strict=True):
            assert torch.equal(mine.flat, its.flat)
        steps = [learner.steps for learner in adapted._learners.values()]
        assert steps == [20 if experienced else 0] * 3


@pytest.mark.parametrize("name", ["policy.safetensors", "driver.safetensors"])
def test_it_goes_on_with_as_many_as_it_has(name: str, env: HighwayEnv, tmp_path: Path) -> None:
    run = Run(tmp_path / "run")
    run.create(TOGETHER, Training(env))
    (run.folder / "driver.safetensors").write_bytes(run.policy_file.read_bytes())
    env.config = TOGETHER.updated("learning", networks=1)
    told = "was trained with learning.networks = 3: go on with as many, not 1"
    with pytest.raises(CheckpointError, match=told):
        take_over(Training(env), run.folder / name)
