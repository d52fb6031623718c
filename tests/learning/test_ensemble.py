"""Several networks that learn apart, decide by their mean, and go on as they were."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.drivers.learned import network_values
from drl_av.drivers.registry import load_driver
from drl_av.env.highway import HighwayEnv
from drl_av.errors import CheckpointError
from drl_av.learning.adaptation import take_over
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


def test_each_learns_at_every_decision_from_a_batch_of_its_own(env: HighwayEnv) -> None:
    training = Training(env)
    first, *others = training.networks
    for network in others:  # alike at first, so that the batches alone tell them apart
        network.flat[:] = first.flat
    for learner in training._learners.values():
        learner.sync_target()
    row = training.run_episode()
    assert [learner.steps for learner in training._learners.values()] == [row.decisions] * 3
    for network in others:
        assert not np.array_equal(network.flat, first.flat)
    assert not np.array_equal(others[0].flat, others[1].flat)


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
    driver, config = load_driver(run.folder)
    assert config == TOGETHER
    states: Any = np.random.default_rng(1).standard_normal((200, 27)).astype(np.float32)
    decided = [training.driver.act(env.scene, s_t).number for s_t in states]
    assert [driver.act(env.scene, s_t).number for s_t in states] == decided
    assert len(set(decided)) > 1
    alone = [network_values(network) for network in training.networks]
    assert any([values(s_t).argmax() for s_t in states] != decided for values in alone)

    bare = tmp_path / "driver.safetensors"
    bare.write_bytes(run.policy_file.read_bytes())
    for file, experienced in ((run.policy_file, True), (bare, False)):
        adapted = Training(env)
        assert take_over(adapted, file) is experienced
        for mine, its in zip(adapted.networks, training.networks, strict=True):
            assert np.array_equal(mine.flat, its.flat)
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
