"""The rows of ``benchmark.py``: what each measures, and the rival that it measures beside it.

A function ``..._rows`` prepares the episodes of some traffic seeds and returns rows; ``stack``
closes the environments in the end.
"""

import math
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from functools import partial
from itertools import cycle
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from benchmark_drives import drive, recorded_actions, recorded_calls, step_bare

from drl_av.config import Config
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import PRETRAINED
from drl_av.drivers.registry import load_learned
from drl_av.drivers.rules import IdmDriver
from drl_av.env.highway import HighwayEnv, Observation
from drl_av.learning.assembly import make_buffer, make_training
from drl_av.learning.learner import Learner
from drl_av.traffic.scenario import PlacedVehicle, ScenarioDescription, write_scenario
from drl_av.traffic.straight import StraightDescription

VEHICLES = 30
ON_STRAIGHT = 500
NUMBERS = (5, 10, 30, 60, 120, 240)
STEPS = 500
"""Number of gradient steps in a round."""
Rate = Callable[[], float]


class Row(NamedTuple):
    """Two functions that measure a rate per second, and the least values that we want."""

    name: str
    ours: Rate
    beside: Rate
    """The rival's measurement."""
    least_ratio: float | None = None
    least_ours: float = 0.0


def exploring(config: Config) -> Config:
    """Return the settings with a constant epsilon of 0.2."""
    return config.updated("learning", epsilon_start=0.2, epsilon_end=0.2)


def crowded(vehicles: int = VEHICLES) -> Config:
    """Return the paper's settings with this number of vehicles and a constant epsilon of 0.2."""
    return exploring(Config().updated("traffic", vehicles_min=vehicles, vehicles_max=vehicles))


def env_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of the environment's decisions per second beside bare libsumo's."""
    env = stack.enter_context(closing(HighwayEnv(config=crowded())))
    actions = recorded_actions(env, load_learned(PRETRAINED)[0], seeds)
    ours, bare = partial(drive, env, actions), partial(step_bare, env, recorded_calls(env, actions))
    return [Row("environment | bare libsumo", ours, bare, 0.75, 2_000)]


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
    """Return a function that makes a gradient step of double DQN on one batch in plain PyTorch."""
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

    With 30 vehicles most of the time is SUMO's.
    """
    few, most = Config().traffic.vehicles_min, Config().traffic.vehicles_max
    return [
        train_row(f"{few} to {most} vehicles", exploring(Config()), seeds, stack, 2.5),
        train_row(f"{VEHICLES} vehicles", crowded(), seeds, stack),
    ]


def train_row(
    name: str,
    config: Config,
    seeds: Sequence[int],
    stack: ExitStack,
    least_ratio: float | None = None,
) -> Row:
    """Return a row of our training beside stable-baselines3's, on the same few traffic seeds."""
    ours, theirs = (stack.enter_context(closing(Rounds(config, seeds))) for _ in range(2))
    training, rival = make_training(ours), stable_baselines3(theirs)

    def train() -> float:
        begun = time.perf_counter()
        decisions = sum(training.run_episode().decisions for _ in seeds)
        return decisions / (time.perf_counter() - begun)

    beside = partial(learn, rival, seeds)
    return Row(f"training, {name} | stable-baselines3's DQN", train, beside, least_ratio)


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


def highway_env_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of the environment's decisions per second beside HighwayEnv's."""
    import highway_env  # noqa: F401 (registers its ids)

    [ours] = env_rows(seeds, stack)
    scene = {"lanes_count": 3, "vehicles_count": VEHICLES, "policy_frequency": 1, "duration": 200}
    env = stack.enter_context(closing(gymnasium.make("highway-v0", config=scene)))
    keep = env.unwrapped.action_type.actions_indexes["IDLE"]  # type: ignore[attr-defined]
    rival = partial(drive_on, env, keep, seeds[:1])
    return [Row("environment | HighwayEnv", ours.ours, rival)]


def drive_on(env: gymnasium.Env[Any, Any], action: int, seeds: Sequence[int]) -> float:
    """Drive an environment with one constant action, and return its decisions per second."""
    begun, decisions = time.perf_counter(), 0
    for seed in seeds:
        env.reset(seed=seed)
        over = False
        while not over:
            _, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
            decisions += 1
    return decisions / (time.perf_counter() - begun)


def processes_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of decisions per second of two processes together beside one process.

    There is no row if the machine has one core.
    """
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [-1, -1]
    if len(cores) < 2:
        print("one core: no row for two processes", file=sys.stderr)
        return []
    context = multiprocessing.get_context("spawn")
    pipes = []
    for core in cores[:2]:
        pipe, far = context.Pipe()
        context.Process(target=work, args=(far, core, list(seeds)), daemon=True).start()
        stack.callback(pipe.send, False)
        pipes.append(pipe)
    for pipe in pipes:
        pipe.recv()

    def together(pipes: Sequence[Any]) -> float:
        for _ in range(2):  # a core that was idle is slow at first: the second drive counts
            begun = time.perf_counter()
            for pipe in pipes:
                pipe.send(True)
            decisions = sum(pipe.recv() for pipe in pipes)
            rate = decisions / (time.perf_counter() - begun)
        return float(rate)

    return [Row("two processes | one", partial(together, pipes), partial(together, pipes[:1]), 1.8)]


def work(pipe: "Connection[Any, Any]", core: int, seeds: Sequence[int]) -> None:
    """Run in a worker process: for each True on the pipe, drive and send the decisions made."""
    if core >= 0:
        os.sched_setaffinity(0, {core})
    with closing(HighwayEnv(config=crowded())) as env:
        actions = recorded_actions(env, IdmDriver(env.config.safety), seeds)
        pipe.send(True)
        while pipe.recv():
            drive(env, actions)
            pipe.send(sum(map(len, actions.values())))


def scaling_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return rows of decisions per second with 5 to 240 vehicles, placed evenly.

    From 30 vehicles on there are 60 on each kilometre.
    """
    home, rows = Path(stack.enter_context(tempfile.TemporaryDirectory())), []
    for number in NUMBERS:
        folder = home / str(number)
        write_scenario(folder, even_traffic(number))
        config = crowded(number).updated("simulation", scenario=str(folder))
        env = stack.enter_context(closing(HighwayEnv(config=config)))
        actions = recorded_actions(env, IdmDriver(config.safety), seeds[:2])
        ours, bare = (
            partial(drive, env, actions),
            partial(step_bare, env, recorded_calls(env, actions)),
        )
        rows.append(Row(f"{number} vehicles", ours, bare))
    return rows


def even_traffic(number: int) -> ScenarioDescription:
    """Return a scenario with this number of vehicles and the ego, evenly over three lanes.

    The loop is 500 m long for each 30 vehicles, at least 500 m.
    """
    circumference_m = 500.0 * max(1.0, number / VEHICLES)
    pitch_m = circumference_m / math.ceil((number + 1) / 3)
    vehicles = (
        PlacedVehicle(
            f"vehicle{i}" if i else "ego",
            i % 3,
            (i // 3 + i % 3 / 3) * pitch_m,
            15.0,
            20.0 + i % 13,
        )
        for i in range(number + 1)
    )
    return ScenarioDescription(circumference_m, vehicles=tuple(vehicles))


def straight_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Return the row of decisions per second on a straight road, which vehicles enter and leave."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()), "straight")
    write_scenario(folder, long_road())
    config = crowded(ON_STRAIGHT).updated("simulation", scenario=str(folder))
    env = stack.enter_context(closing(HighwayEnv(config=config)))
    actions = recorded_actions(env, IdmDriver(config.safety), seeds[:1])
    ours, bare = partial(drive, env, actions), partial(step_bare, env, recorded_calls(env, actions))
    return [Row(f"straight road, {ON_STRAIGHT} vehicles | bare libsumo", ours, bare)]


def long_road() -> StraightDescription:
    """Return a straight road whose flow corresponds to ``ON_STRAIGHT`` vehicles.

    1,000 vehicles/h in each of three lanes at 20 m/s are 500 on 12 km. Vehicles are on the road
    from 300 m behind the ego's start to 250 m beyond the end of its way.
    """
    return StraightDescription(flow_per_h=1000.0, length_m=12_000.0 - 300.0 - 250.0)


ROWS: dict[str, Callable[[Sequence[int], ExitStack], list[Row]]] = {
    "env": env_rows,
    "step": step_rows,
    "train": train_rows,
    "highway-env": highway_env_rows,
    "processes": processes_rows,
    "scaling": scaling_rows,
    "straight": straight_rows,
}
