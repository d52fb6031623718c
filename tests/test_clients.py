"""The tools that people already have, used the way their documentation shows."""

import csv
import json
import runpy
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, RecordVideo
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordVectorStatistics
from shown import ROOT, run

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
    with HighwayEnv(config=CONFIG) as env:
        yield env.reset(seed=seed)[0]
        for _ in range(DECISIONS - 1):
            yield env.step(1)[0]


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasium_s_vector_environments_drive_each_as_if_alone(mode: str) -> None:
    kwargs = {"context": "spawn"} if mode == "async" else {}
    vector = gymnasium.make_vec(
        ID, num_envs=2, vectorization_mode=mode, vector_kwargs=kwargs, config=CONFIG
    )
    with closing(vector):
        together = [vector.reset(seed=SEEDS)[0]]
        together += [vector.step(np.array([1, 1]))[0] for _ in range(DECISIONS - 1)]
    for column, seed in enumerate(SEEDS):
        alone = [*episode(seed)]
        assert np.array_equal(alone, [observations[column] for observations in together])


def test_gymnasium_s_wrappers_record_the_statistics_of_episodes() -> None:
    with RecordEpisodeStatistics(gymnasium.make(ID, config=CONFIG)) as env:
        env.reset(seed=1)
        rewards = []
        for _ in range(DECISIONS):
            _, reward, terminated, truncated, info = env.step(0)
            rewards.append(float(reward))
            assert not terminated
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


def test_stable_baselines3_logs_the_success_rate_and_the_scalars_of_an_episode(
    tmp_path: Path,
) -> None:
    from stable_baselines3 import DQN
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.logger import configure

    example = runpy.run_path(str(ROOT / "examples" / "sb3_dqn.py"))
    config = CONFIG.updated("safety", check="permit_all")
    monitored = {"info_keywords": example["SCALARS"]}
    made = {"env_kwargs": {"config": config}, "monitor_kwargs": monitored}
    training = make_vec_env(ID, seed=0, monitor_dir=str(tmp_path), **made)
    model = DQN("MlpPolicy", training, learning_starts=1000, seed=0, device="cpu")
    model.set_logger(configure(str(tmp_path), ["json"]))
    model.learn(40 * DECISIONS, log_interval=20, callback=example["LogScalars"]())
    training.close()
    logged = [json.loads(line) for line in (tmp_path / "progress.json").read_text().splitlines()]
    with (tmp_path / "0.monitor.csv").open(newline="") as file:
        file.readline()
        episodes = [*csv.DictReader(file)][:20]
    speed = sum(float(row["mean_speed_m_s"]) for row in episodes) / 20
    assert logged[0]["rollout/mean_speed_m_s"] == pytest.approx(speed, abs=0.01)
    hits = sum(row["ego_hit"] == "True" for row in episodes)
    assert 0 < hits < 20
    assert logged[0]["rollout/ego_hit"] == pytest.approx(hits / 20)
    successes = sum(int(row["l"]) == DECISIONS and row["ego_hit"] != "True" for row in episodes)
    assert logged[0]["rollout/success_rate"] == pytest.approx(successes / 20, abs=0.051)


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_workers_of_stable_baselines3_drive_as_dummies_do(method: str) -> None:
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import SubprocVecEnv

    driven = []
    own = {"vec_env_cls": SubprocVecEnv, "vec_env_kwargs": {"start_method": method}}
    for kind in (own, {}):
        with closing(make_vec_env(ID, 2, seed=5, env_kwargs={"config": CONFIG}, **kind)) as vector:
            seen = [vector.reset()]
            for _ in range(2 * DECISIONS):
                seen.append(vector.step(np.array([1, 4]))[0])  # type: ignore[arg-type]
        driven.append(np.array(seen))
    assert np.array_equal(*driven)


def test_gymnasium_s_record_video_films_an_episode(tmp_path: Path) -> None:
    config = CONFIG.updated("simulation", decisions_per_episode=2)
    made = gymnasium.make(ID, config=config, render_mode="rgb_array")
    with RecordVideo(made, str(tmp_path), disable_logger=True) as env:
        env.reset(seed=1)
        assert [env.step(0)[3] for _ in range(2)] == [False, True]
    [film] = tmp_path.glob("*.mp4")
    assert film.stat().st_size > 1000


def test_maskable_ppo_of_sb3_contrib_chooses_permitted_actions_only() -> None:
    from sb3_contrib import MaskablePPO
    from sb3_contrib.common.maskable.evaluation import evaluate_policy
    from sb3_contrib.common.maskable.utils import get_action_masks
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecEnv

    vector = make_vec_env(ID, n_envs=2, seed=0, env_kwargs={"config": CONFIG})
    assert isinstance(vector, VecEnv)
    model = MaskablePPO("MlpPolicy", vector, n_steps=20, batch_size=20, seed=0, device="cpu")
    model.learn(80)
    evaluate_policy(model, vector, n_eval_episodes=2, warn=False)
    observations = vector.reset()
    fired = []
    for _ in range(DECISIONS - 1):
        masks = get_action_masks(vector)
        assert masks.shape == (2, 12)
        actions, _ = model.predict(observations, action_masks=masks)  # type: ignore[arg-type]
        observations, _, _, infos = vector.step(actions)  # type: ignore[assignment]
        fired += [info["rule"] for info in infos]
    vector.close()
    assert set(fired) == {"none"}


def test_rl_zoo3_trains_and_enjoys_with_the_hyperparameters_that_ship(tmp_path: Path) -> None:
    short = "config:{'simulation': {'decisions_per_episode': 10}}"
    shared = ["--algo", "dqn", "--env", ID, "--gym-packages", "drl_av", "-f", str(tmp_path)]
    shared += ["--env-kwargs", short, "--device", "cpu", "--seed", "1"]
    shipped = ["--conf-file", str(ROOT / "examples" / "rl_zoo3.yml"), "-n", "60"]
    shipped += ["--eval-freq", "30", "--eval-episodes", "1", "--eval-env-kwargs", short]
    printed = run(tmp_path, "-m", "rl_zoo3.train", *shared, *shipped).stdout
    assert "Eval num_timesteps=60" in printed
    printed = run(tmp_path, "-m", "rl_zoo3.enjoy", *shared, "--no-render", "-n", "25").stdout
    assert "Mean reward" in printed


def test_torchrl_collects_an_episode_and_finds_its_specs_kept() -> None:
    from torchrl.envs.libs.gym import GymEnv
    from torchrl.envs.utils import check_env_specs

    env = GymEnv(ID, config=CONFIG)
    check_env_specs(env, seed=3)
    rollout = env.rollout(2 * DECISIONS)
    env.close()
    assert rollout["observation"].shape == (DECISIONS, 27)
    assert rollout["next", "truncated"].flatten().tolist() == [False] * 9 + [True]


def test_tianshou_trains_in_two_environments_of_one_process() -> None:
    from tianshou.algorithm import DQN
    from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
    from tianshou.algorithm.optim import AdamOptimizerFactory
    from tianshou.data import Collector, CollectStats, VectorReplayBuffer
    from tianshou.env import DummyVectorEnv
    from tianshou.trainer import OffPolicyTrainerParams
    from tianshou.utils.net.common import Net

    training, evaluation = (
        DummyVectorEnv([lambda: gymnasium.make(ID, config=CONFIG) for _ in range(2)])
        for _ in range(2)
    )
    net = Net(state_shape=(27,), action_shape=12, hidden_sizes=[8])
    actions = gymnasium.spaces.Discrete(12)
    policy = DiscreteQLearningPolicy(model=net, action_space=actions, eps_training=0.5)
    agent = DQN(policy=policy, optim=AdamOptimizerFactory(lr=1e-3), target_update_freq=10)
    params = OffPolicyTrainerParams(
        training_collector=Collector[CollectStats](
            agent, training, VectorReplayBuffer(100, 2), exploration_noise=True
        ),
        test_collector=Collector[CollectStats](agent, evaluation),
        max_epochs=1,
        epoch_num_steps=60,
        collection_step_num_env_steps=20,
        update_step_num_gradient_steps_per_sample=0.1,
        batch_size=16,
        test_step_num_episodes=2,
        verbose=False,
        show_progress=False,
    )
    found = agent.run_training(params)
    for vector in (training, evaluation):
        vector.close()
    assert (found.train_step, found.test_episode) == (60, 4)
