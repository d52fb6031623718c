"""Prepares the rows of ``benchmark.py`` about learning; ``benchmark_rows`` prepares the others."""

import multiprocessing
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from benchmark_rows import VEHICLES, Row, crowded, exploring

from drl_av.config import Config
from drl_av.config.presets import PRESETS
from drl_av.drivers.network import QNetwork
from drl_av.env.highway import HighwayEnv
from drl_av.env.scene_values import Observation
from drl_av.learning.algorithm_1 import build_training, make_buffer
from drl_av.learning.learner import Learner

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

STEPS = 500
"""Number of gradient steps in a round."""
UPDATES = 3
"""Number of updates of the preset ``large`` in a round."""


def step_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of training steps per second beside bare gradient steps of PyTorch."""
    config, rng = Config().learning, np.random.default_rng(0)
    buffer, learner = make_buffer(config, 27), Learner(QNetwork(rng))
    for _ in range(5_000):
        s_t, s_tp1 = rng.normal(size=(2, 27)).astype(np.float32)
        buffer.add_safe(s_t, int(rng.integers(12)), -0.1, s_tp1)
        buffer.add_collision(s_t, int(rng.integers(12)), -3.0)

    def ours() -> None:
        learner.update(buffer.sample(config.batch_size, rng))

    bare = partial(repeat, bare_step(config.batch_size))
    return [Row("training step | bare gradient step", partial(repeat, ours), bare)]


def repeat(step: Callable[[], None]) -> float:
    """Call ``step`` STEPS times, and return the calls per second."""
    begun = time.perf_counter()
    for _ in range(STEPS):
        step()
    return STEPS / (time.perf_counter() - begun)


def bare_step(rows: int) -> Callable[[], None]:
    """Return a function that makes a gradient step of double DQN in plain PyTorch.

    All steps use the same batch of ``rows`` transitions.
    """
    rng = np.random.default_rng(0)
    online, target = multilayer_perceptron(), multilayer_perceptron()
    adam = torch.optim.Adam(online.parameters(), lr=1e-4, fused=True)
    s_t, s_tp1 = (torch.from_numpy(rng.normal(size=(rows, 27)).astype("f4")) for _ in range(2))
    a_t = torch.from_numpy(rng.integers(12, size=(rows, 1)))

    def step() -> None:
        with torch.no_grad():
            a_next = online(s_tp1).argmax(1, keepdim=True)
            y = -0.1 + 0.9 * target(s_tp1).gather(1, a_next)[:, 0]
        loss = ((y - online(s_t).gather(1, a_t)[:, 0]) ** 2).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()

    return step


def multilayer_perceptron() -> torch.nn.Module:
    """Return the Q-network of the paper as a module of PyTorch."""
    return torch.nn.Sequential(
        torch.nn.Linear(27, 100),
        torch.nn.LeakyReLU(),
        torch.nn.Linear(100, 100),
        torch.nn.LeakyReLU(),
        torch.nn.Linear(100, 12),
    )


def train_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the rows of training: decisions per second, with a gradient step for each.

    With 30 vehicles most of the time is SUMO's. In the twin nearly all is the gradient steps'.
    """
    few, most = Config().traffic.vehicles_min, Config().traffic.vehicles_max
    in_sumo = exploring(Config().with_traffic("calm"))
    in_twin = in_sumo.updated("simulation", world="twin")
    worlds = (training(config, seeds, stack) for config in (in_twin, in_sumo))
    return [
        train_row(f"{few} to {most} vehicles", in_sumo, seeds, stack, 2.5),
        train_row(f"{VEHICLES} vehicles", crowded(), seeds, stack),
        Row(f"training, {few} to {most} vehicles, in the twin | in SUMO", *worlds, 3.0),
    ]


def large_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of decisions per second of the preset ``large``, which drives in two threads.

    Beside it is Algorithm 1 in the twin.
    """
    context = multiprocessing.get_context("spawn")
    pipe, far = context.Pipe()
    context.Process(target=learn_large, args=(far,), daemon=True).start()
    far.close()
    stack.callback(pipe.send, False)
    pipe.recv()

    def ours() -> float:
        pipe.send(True)
        return float(pipe.recv())

    beside = training(exploring(Config()).updated("simulation", world="twin"), seeds, stack)
    return [Row("preset large, all cores | Algorithm 1 in the twin", ours, beside)]


def learn_large(pipe: "Connection[Any, Any]") -> None:
    """Run in a process on all cores: for each True on ``pipe``, learn and send the rate."""
    from drl_av.learning.large_scale import learner_of
    from drl_av.learning.twin_worlds import TwinWorlds

    config = PRESETS["large"]
    learner, batch = learner_of(config, TwinWorlds(config, 0)), config.ppo.batch_size
    pipe.send(True)
    while pipe.recv():
        begun = time.perf_counter()
        for _ in range(UPDATES):
            learner.learn(batch, reset_num_timesteps=False)
        pipe.send(UPDATES * batch / (time.perf_counter() - begun))


def train_row(
    name: str,
    config: Config,
    seeds: Sequence[int],
    stack: ExitStack,
    least_ratio: float | None = None,
) -> Row:
    """Return a row of our training beside stable-baselines3's, on the same few traffic seeds."""
    ours = training(config, seeds, stack)
    rival = stable_baselines3(stack.enter_context(closing(Rounds(config, seeds))))
    beside = partial(learn, rival, seeds)
    return Row(f"training, {name} | stable-baselines3's DQN", ours, beside, least_ratio)


def training(config: Config, seeds: Sequence[int], stack: ExitStack) -> Callable[[], float]:
    """Return a function that trains for an episode of each seed: decisions per second."""
    ours = build_training(stack.enter_context(closing(Rounds(config, seeds))))

    def train() -> float:
        begun = time.perf_counter()
        decisions = sum(ours.run_episode().decisions for _ in seeds)
        return decisions / (time.perf_counter() - begun)

    return train


class Rounds(HighwayEnv):
    """An environment that resets to the given traffic seeds in turn, whatever seed is requested."""

    def __init__(self, config: Config, seeds: Sequence[int]) -> None:
        super().__init__(config=config)
        self._seeds = cycle(seeds)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Reset to the next of the seeds."""
        return super().reset(seed=next(self._seeds), options=options)


def stable_baselines3(env: HighwayEnv) -> Any:
    """Return stable-baselines3's DQN with our settings; it has one buffer, no double Q target."""
    from stable_baselines3 import DQN

    config = env.config.learning
    return DQN(
        "MlpPolicy",
        env,
        learning_rate=config.learning_rate,
        buffer_size=config.safe_capacity + config.collision_capacity,
        learning_starts=config.batch_size,
        batch_size=config.batch_size,
        gamma=config.discount,
        train_freq=1,
        gradient_steps=1,
        target_update_interval=200 * config.target_update_episodes,
        exploration_initial_eps=config.epsilon_start,
        exploration_final_eps=config.epsilon_end,
        policy_kwargs={"net_arch": [100, 100], "activation_fn": torch.nn.LeakyReLU},
        seed=0,
        device="cpu",
    )


def learn(model: Any, seeds: Sequence[int]) -> float:
    """Let stable-baselines3 learn, and return its decisions per second."""
    decisions = 200 * len(seeds)
    model._last_obs = None  # another environment has had SUMO meanwhile: reset
    begun = time.perf_counter()
    model.learn(decisions, reset_num_timesteps=False, log_interval=None)
    return decisions / (time.perf_counter() - begun)
