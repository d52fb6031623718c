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
from drl_av.drivers.registry import find_drivers, load_learned, make_drivers
from drl_av.driving.mirror import MIRROR, mirrored_observations
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import CheckpointError
from drl_av.learning.algorithm_1 import Training, build_training
from drl_av.learning.run_folder import Run, warm_start

TOGETHER = (
    Config()
    .updated("simulation", decisions_per_episode=20)
    .updated("traffic", vehicles_min=3, vehicles_max=3)
    .updated("learning", episodes=4, networks=3, mirrored=True, evaluation_episodes=1)
)


@pytest.fixture(scope="module")
def road() -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=TOGETHER)) as env:
        yield env


@pytest.fixture
def env(road: HighwayEnv) -> HighwayEnv:
    road.config = TOGETHER
    return road


def steps(training: Training) -> list[int]:
    """Gradient steps that each network has made."""
    tensors, _ = training.state()
    return [int(tensors[name]) for name in tensors if name.endswith(".step")]


def test_each_learns_at_every_decision_from_a_batch_of_its_own(env: HighwayEnv) -> None:
    training = build_training(env)
    first, *others = training.networks
    tensors, numbers = training.state()
    for name in ("learner1", "learner2"):  # alike at first: only the batches tell them apart
        tensors |= {f"{name}.{net}": tensors["learner.online"] for net in ("online", "target")}
    training.restore(tensors | {"learner.target": tensors["learner.online"]}, numbers)
    row = training.run_episode()
    assert steps(training) == [row.decisions] * 3
    for network in others:
        assert not np.array_equal(network.flat, first.flat)
    assert not np.array_equal(others[0].flat, others[1].flat)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_training_on_mirrored_scenes_decides_alike_on_both_sides_then_and_ever_after(
    mirrored: bool, env: HighwayEnv, tmp_path: Path
) -> None:
    env.config = Config().updated("learning", mirrored=mirrored, batch_size=8)
    training = build_training(env)
    save_policy(tmp_path / "policy.safetensors", training.networks, env.config)
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
        env.config = TOGETHER.updated("learning", mirrored=mirrored, epsilon_end=1.0)
        training = build_training(env)
        training.run_episode()
        weights.append(training.networks[0].flat)
    assert not np.array_equal(*weights)


def test_the_settings_say_what_is_stored_of_each_decision(env: HighwayEnv) -> None:
    def rows(**learning: Any) -> tuple[int, Any]:
        """Rows of both buffers after one episode, and the discounts in Buf_C."""
        env.config = TOGETHER.updated("learning", networks=1, batch_size=8, **learning)
        env.config = env.config.updated("traffic", vehicles_min=30, vehicles_max=30)
        training = build_training(env)
        assert training.run_episode().decisions == 20
        tensors, _ = training.state()
        safe, collision = (tensors[f"buffer.{name}.rows"] for name in ("safe", "collision"))
        return len(safe) + len(collision), set(collision[:, -1].tolist())

    plain, ends = rows()
    more, _ = rows(counterfactuals=12)
    assert 20 < plain <= 2 * 20 < more <= 12 * 20 + 20
    assert ends == {0.0}
    assert rows(unsafe_penalty=0.5)[1] == {np.float32(0.9)}


def test_what_is_saved_drives_as_the_training_did_and_continues_as_it_was(
    env: HighwayEnv, tmp_path: Path
) -> None:
    training, run = build_training(env), Run(tmp_path / "run")
    training.run_episode()
    run.create(training)
    run.save(training)
    driver, config = load_learned(run.folder)
    assert config == TOGETHER
    states: Any = np.random.default_rng(1).standard_normal((200, 27)).astype(np.float32)
    decided = [training.driver.act(ALONE, s_t).number for s_t in states]
    assert [driver.act(ALONE, s_t).number for s_t in states] == decided
    assert len(set(decided)) > 1
    alone = [network_values(network) for network in training.networks]
    assert any([values(s_t).argmax() for s_t in states] != decided for values in alone)

    bare = tmp_path / "driver.safetensors"
    bare.write_bytes(run.policy_file.read_bytes())
    for file, experienced in ((run.policy_file, True), (bare, False)):
        adapted = build_training(env)
        assert warm_start(adapted, file) is experienced
        for mine, its in zip(adapted.networks, training.networks, strict=True):
            assert np.array_equal(mine.flat, its.flat)
        tensors, numbers = adapted.state()
        assert steps(adapted) == [20 if experienced else 0] * 3
        assert len(tensors["buffer.safe.rows"]) == (20 if experienced else 0)
        assert numbers["episodes_done"] == 0
        if experienced:
            its_own, _ = load(run.checkpoint_file)
            assert {k: v.tobytes() for k, v in tensors.items()} == {
                k: v.tobytes() for k, v in its_own.items()
            }


@pytest.mark.parametrize("name", ["policy.safetensors", "driver.safetensors"])
def test_it_continues_with_as_many_as_it_has(name: str, env: HighwayEnv, tmp_path: Path) -> None:
    run = Run(tmp_path / "run")
    training = build_training(env)
    run.create(training)
    run.save(training)
    (run.folder / "driver.safetensors").write_bytes(run.policy_file.read_bytes())
    env.config = TOGETHER.updated("learning", networks=1)
    message = "was trained with learning.networks = 3: continue with as many, not 1"
    with pytest.raises(CheckpointError, match=message):
        warm_start(build_training(env), run.folder / name)


@pytest.mark.parametrize("permitted_only", [False, True])
def test_an_untrained_driver_that_asks_the_check_triggers_no_rule(
    permitted_only: bool, env: HighwayEnv, tmp_path: Path
) -> None:
    config = TOGETHER.updated("learning", permitted_only=permitted_only, seed=3)
    env.config = config
    training = build_training(env)
    file = tmp_path / "policy.safetensors"
    save_policy(file, training.networks, config)
    read = make_drivers(find_drivers([str(file)]), config)
    triggers = [
        sum(decision.triggered for decision in rollout(env, driver, 7, 3))
        for driver in (training.driver, *read.values())
    ]
    assert triggers == [0, 0] if permitted_only else min(triggers) > 0
