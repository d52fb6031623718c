"""A training is assembled from its settings, from the beginning or from a trained driver."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from worlds import ALONE

from drl_av.config import Config
from drl_av.drivers.learned import network_values
from drl_av.drivers.policy_file import load, save_policy
from drl_av.drivers.registry import load_learned
from drl_av.driving.mirror import MIRROR, mirrored_observations
from drl_av.env.highway import HighwayEnv
from drl_av.learning.algorithm_1 import build_training
from drl_av.learning.run_folder import Run, warm_start

SMALL = (
    Config()
    .updated("simulation", decisions_per_episode=20)
    .updated("traffic", vehicles_min=3, vehicles_max=3)
    .updated("learning", episodes=4, mirrored=True, evaluation_episodes=1)
)


@pytest.fixture(scope="module")
def road() -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=SMALL)) as env:
        yield env


@pytest.fixture
def env(road: HighwayEnv) -> HighwayEnv:
    road.config = SMALL
    return road


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_training_on_mirrored_scenes_decides_alike_on_both_sides_then_and_ever_after(
    mirrored: bool, env: HighwayEnv, tmp_path: Path
) -> None:
    env.config = Config().updated("learning", mirrored=mirrored, batch_size=8)
    training = build_training(env)
    save_policy(tmp_path / "policy.safetensors", training.network, env.config)
    driver, _ = load_learned(tmp_path / "policy.safetensors")
    states = np.random.default_rng(1).standard_normal((50, 27)).astype(np.float32)
    alike = [
        each.act(ALONE, mirrored_observations(s)).number
        == MIRROR.action_permutation[each.act(ALONE, s).number]
        for each in (training.driver, driver)
        for s in states
    ]
    assert all(alike) is mirrored


def test_mirroring_reflects_every_second_row_that_is_learned_from(env: HighwayEnv) -> None:
    weights = []
    for mirrored in (False, True):
        env.config = SMALL.updated("learning", mirrored=mirrored, epsilon_end=1.0)
        training = build_training(env)
        training.run_episode()
        weights.append(training.network.flat)
    assert not np.array_equal(*weights)


def test_what_is_saved_drives_as_the_training_did_and_continues_as_it_was(
    env: HighwayEnv, tmp_path: Path
) -> None:
    training, run = build_training(env), Run(tmp_path / "run")
    training.run_episode()
    run.create(training)
    run.save(training)
    driver, config = load_learned(run.folder)
    assert config == SMALL
    states: Any = np.random.default_rng(1).standard_normal((200, 27)).astype(np.float32)
    decided = [training.driver.act(ALONE, s_t).number for s_t in states]
    assert [driver.act(ALONE, s_t).number for s_t in states] == decided
    assert len(set(decided)) > 1
    alone = network_values(training.network)
    assert [alone(s_t).argmax() for s_t in states] != decided

    bare = tmp_path / "driver.safetensors"
    bare.write_bytes(run.policy_file.read_bytes())
    for file, experienced in ((run.policy_file, True), (bare, False)):
        adapted = build_training(env)
        assert warm_start(adapted, file) is experienced
        assert np.array_equal(adapted.network.flat, training.network.flat)
        tensors, numbers = adapted.state()
        assert tensors["learner.step"] == (20 if experienced else 0)
        assert len(tensors["buffer.safe.rows"]) == (20 if experienced else 0)
        assert numbers["episodes_done"] == 0
        if experienced:
            its_own, _ = load(run.checkpoint_file)
            assert {k: v.tobytes() for k, v in tensors.items()} == {
                k: v.tobytes() for k, v in its_own.items()
            }
