"""The tools that people already have, used the way their documentation shows."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordVectorStatistics

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv

ID = "drl_av/Highway-v0"
DECISIONS = 10
CONFIG = (
    Config()
    .updated("simulation", decisions_per_episode=DECISIONS)
    .updated("traffic", vehicles_min=8, vehicles_max=8)
)
SEEDS = [21, 22]


def episode(seed: int) -> Iterator[np.ndarray[Any, Any]]:
    """The observations of an environment that has its process to itself, all decisions 1."""
    env = HighwayEnv(config=CONFIG)
    yield env.reset(seed=seed)[0]
    for _ in range(DECISIONS - 1):
        yield env.step(1)[0]
    env.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasium_s_vector_environments_drive_each_as_if_alone(mode: str) -> None:
    kwargs = {"context": "spawn"} if mode == "async" else {}
    vector = gymnasium.make_vec(
        ID, num_envs=2, vectorization_mode=mode, vector_kwargs=kwargs, config=CONFIG
    )
    try:
        together = [vector.reset(seed=SEEDS)[0]]
        together += [vector.step(np.array([1, 1]))[0] for _ in range(DECISIONS - 1)]
    finally:
        vector.close()
    for column, seed in enumerate(SEEDS):
        alone = [*episode(seed)]
        assert np.array_equal(alone, [observations[column] for observations in together])


def test_gymnasium_s_wrappers_record_the_statistics_of_episodes() -> None:
    env = RecordEpisodeStatistics(gymnasium.make(ID, config=CONFIG))
    env.reset(seed=1)
    rewards = []
    for _ in range(DECISIONS):
        _, reward, terminated, truncated, info = env.step(0)
        rewards.append(float(reward))
        assert not terminated
    env.close()
    assert truncated
    assert info["episode"]["l"] == DECISIONS
    assert info["episode"]["r"] == pytest.approx(sum(rewards))
    vector = RecordVectorStatistics(gymnasium.make_vec(ID, 2, "sync", config=CONFIG))
    vector.reset(seed=1)
    for _ in range(DECISIONS):
        *_, infos = vector.step(np.array([0, 0]))
    vector.close()
    assert infos["episode"]["l"].tolist() == [DECISIONS, DECISIONS]


@pytest.mark.parametrize("name", ["DQN", "PPO"])
def test_stable_baselines3_trains_beside_an_evaluation(name: str, tmp_path: Path) -> None:
    # imported here: torch comes along, and workers that import this file do without it
    import stable_baselines3
    from stable_baselines3.common.callbacks import EvalCallback
    from stable_baselines3.common.env_util import make_vec_env

    settings = {"DQN": {"learning_starts": 10}, "PPO": {"n_steps": 20, "batch_size": 20}}[name]
    training = make_vec_env(ID, n_envs=2, seed=0, env_kwargs={"config": CONFIG})
    evaluation = make_vec_env(ID, n_envs=1, seed=9, env_kwargs={"config": CONFIG})
    callback = EvalCallback(
        evaluation, n_eval_episodes=2, eval_freq=15, log_path=str(tmp_path), verbose=0
    )
    model = getattr(stable_baselines3, name)(
        "MlpPolicy", training, seed=0, device="cpu", **settings
    )
    model.learn(80, callback=callback)
    training.close()
    evaluation.close()
    found = np.load(tmp_path / "evaluations.npz")
    assert found["timesteps"].tolist() == [30, 60]
    assert (found["ep_lengths"] <= DECISIONS).all()
    assert np.isfinite(found["results"]).all()


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_workers_of_stable_baselines3_drive_as_dummies_do(method: str) -> None:
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    driven = []
    own = {"vec_env_cls": SubprocVecEnv, "vec_env_kwargs": {"start_method": method}}
    for kind in (own, {}):
        vector = make_vec_env(ID, n_envs=2, seed=5, env_kwargs={"config": CONFIG}, **kind)
        try:
            seen = [vector.reset()]
            for _ in range(2 * DECISIONS):
                seen.append(vector.step(np.array([1, 4]))[0])  # type: ignore[arg-type]
        finally:
            vector.close()
        driven.append(np.array(seen))
    assert np.array_equal(*driven)
