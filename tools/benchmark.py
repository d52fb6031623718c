"""How fast everything is, each row measured beside its rival in this run.

    python tools/benchmark.py                       every row
    python tools/benchmark.py env train --json      some of them, for machines

    env          the environment at 30 vehicles, resets included, beside bare libsumo stepping of
                 the same traffic
    step         a training step (sampled batch, double Q target, gradient, Adam) beside a bare
                 gradient step of PyTorch on one batch: autograd and fused Adam
    train        Algorithm 1 from end to end beside stable-baselines3's DQN on the same
                 environment with the same network, batch and buffer; torch on one thread in both
    highway-env  the environment beside HighwayEnv's highway-v0 at 3 lanes, 30 vehicles and one
                 decision a second, simulated at its own default of 15 Hz
    processes    two processes that drive at once beside one
    scaling      the environment beside bare stepping at 5 to 240 vehicles, from 30 on at one
                 density, and how much the cost of a decision grows

Figures are medians over rounds in which all rows take turns, after a round of warm-up; a ratio is
the median of the ratios round by round. All but ``processes`` runs on one core.
"""

import argparse
import json
import math
import multiprocessing
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import libsumo
import numpy as np
import torch

from drl_av.config import Config
from drl_av.driving.drivers.rules import IdmDriver
from drl_av.env import HighwayEnv
from drl_av.learning.buffers import make_buffer
from drl_av.learning.learner import Learner
from drl_av.learning.qnetwork import QNetwork
from drl_av.learning.training import Training
from drl_av.studies.drivers import PRETRAINED, learned_driver
from drl_av.traffic.scenario import PlacedVehicle, ScenarioDescription, write_scenario

SEEDS = 1_000
"""First traffic seed of the episodes that are timed."""
VEHICLES = 30
NUMBERS = (5, 10, 30, 60, 120, 240)
STEPS = 500
"""Gradient steps a round."""
Rate = Callable[[], float]


class Row(NamedTuple):
    """Two measurements, in so many a second, and what is wanted of them."""

    name: str
    ours: Rate
    beside: Rate
    least_ratio: float | None = None
    least_ours: float = 0.0


class Result(NamedTuple):
    """What a row came to."""

    name: str
    ours: float
    beside: float
    ratio: float
    wanted: str
    met: bool | None


def main() -> int:
    """Parse, measure, print; exit status 1 where a row is not what is wanted of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"of: {', '.join(ROWS)} (all)")
    parser.add_argument("--rounds", type=int, default=5, help="(default: 5)")
    parser.add_argument("--episodes", type=int, default=5, help="a round (default: 5)")
    parser.add_argument("--json", action="store_true", help="print a JSON list")
    options = parser.parse_args()
    if unknown := set(options.rows) - set(ROWS):
        parser.error(f"there is no row {unknown.pop()!r}; the rows are: {', '.join(ROWS)}")
    torch.set_num_threads(1)
    seeds = range(SEEDS, SEEDS + options.episodes)
    with ExitStack() as stack:
        rows = [row for name in options.rows or ROWS for row in ROWS[name](seeds, stack)]
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        results = [*in_turn(rows, options.rounds)]
    print(json.dumps([r._asdict() for r in results]) if options.json else table(results))
    return int(any(result.met is False for result in results))


def in_turn(rows: Sequence[Row], rounds: int) -> Iterator[Result]:
    """Measure all rows in each round, and their rivals right after them."""
    pairs: dict[str, list[tuple[float, float]]] = {row.name: [] for row in rows}
    for number in range(rounds + 1):
        for row in rows:
            pair = row.ours(), row.beside()
            if number:
                pairs[row.name].append(pair)
        print(f"round {number} of {rounds}", file=sys.stderr)
    for row in rows:
        yield result(row, pairs[row.name])
    first, last = (f"{number} vehicles" for number in (NUMBERS[0], NUMBERS[-1]))
    if first in pairs:
        growths = [
            (few[0] / many[0], few[1] / many[1])
            for few, many in zip(pairs[first], pairs[last], strict=True)
        ]
        ours, bare = (statistics.median(side) for side in zip(*growths, strict=True))
        ratio = statistics.median(a / b for a, b in growths)
        name = f"cost of a decision, {last} / {first}"
        yield Result(name, ours, bare, ratio, "at most 1", ratio <= 1)


def result(row: Row, pairs: Sequence[tuple[float, float]]) -> Result:
    """Medians over the rounds."""
    ours, beside = (statistics.median(side) for side in zip(*pairs, strict=True))
    ratio = statistics.median(a / b for a, b in pairs)
    if row.least_ratio is None:
        return Result(row.name, ours, beside, ratio, "", None)
    wanted = f"at least {row.least_ratio:g}"
    if row.least_ours:
        wanted += f" and {row.least_ours:,.0f} a second"
    return Result(
        row.name,
        ours,
        beside,
        ratio,
        wanted,
        ratio >= row.least_ratio and ours >= row.least_ours,
    )


def table(results: Sequence[Result]) -> str:
    """A line a row: ours and the rival's in so many a second, and their ratio."""
    lines = [f"{'':<56}{'ours':>10}{'beside':>10}{'ratio':>8}  wanted"]
    for name, ours, beside, ratio, wanted, met in results:
        places = 1 if max(ours, beside) < 100 else 0
        told = {None: "", True: f"{wanted}: met", False: f"{wanted}: MISSED"}[met]
        numbers = f"{ours:>10,.{places}f}{beside:>10,.{places}f}{ratio:>8.2f}"
        lines.append(f"{name:<56}{numbers}  {told}".rstrip())
    return "\n".join(lines)


def crowded(vehicles: int = VEHICLES) -> Config:
    """The paper's settings with as many vehicles in every episode, and exploration held."""
    config = Config().updated("traffic", vehicles_min=vehicles, vehicles_max=vehicles)
    return config.updated("learning", epsilon_start=0.2, epsilon_end=0.2)


def env_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Decisions a second."""
    env = stack.enter_context(closing(HighwayEnv(config=crowded())))
    actions = recorded(env, learned_driver(PRETRAINED)[0], seeds)
    ours, bare = partial(drive, env, actions), partial(step_bare, env, seeds)
    return [Row("environment | bare libsumo", ours, bare, 0.75, 2_000)]


def recorded(env: HighwayEnv, driver: Any, seeds: Sequence[int]) -> dict[int, list[int]]:
    """What the driver does by the episode's seed, so that the driver itself is not timed."""
    actions: dict[int, list[int]] = {}
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        actions[seed], over = [], False
        while not over:
            actions[seed].append(driver.act(env.scene, observation).number)
            observation, _, terminated, truncated, _ = env.step(actions[seed][-1])
            over = terminated or truncated
    return actions


def drive(env: HighwayEnv, actions: dict[int, list[int]]) -> float:
    """Decisions a second of the environment."""
    begun = time.perf_counter()
    for seed, row in actions.items():
        env.reset(seed=seed)
        for action in row:
            env.step(action)
    return sum(map(len, actions.values())) / (time.perf_counter() - begun)


def step_bare(env: HighwayEnv, seeds: Sequence[int]) -> float:
    """The same traffic loaded and stepped by libsumo alone, the ego driven by SUMO."""
    config, vehicles = env.config.simulation, env.config.traffic.vehicles_min
    begun, decisions = time.perf_counter(), config.decisions_per_episode
    for seed in seeds:
        env.simulation.reset(seed, vehicles)
        libsumo.vehicle.setSpeedMode("ego", 31)
        for _ in range(decisions * config.steps_per_decision):
            libsumo.simulationStep()
    return len(seeds) * decisions / (time.perf_counter() - begun)


def step_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Gradient steps a second."""
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
    """Steps a second."""
    begun = time.perf_counter()
    for _ in range(STEPS):
        step()
    return STEPS / (time.perf_counter() - begun)


def bare_step(rows: int) -> Callable[[], None]:
    """Double DQN on one batch in plain PyTorch."""
    rng = np.random.default_rng(0)
    online, target = QNetwork(rng), QNetwork(rng)
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


def train_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Decisions a second, with a gradient step each."""
    training = Training(stack.enter_context(closing(HighwayEnv(config=crowded()))))

    def ours() -> float:
        begun = time.perf_counter()
        decisions = sum(training.run_episode().decisions for _ in seeds)
        return decisions / (time.perf_counter() - begun)

    rival = stable_baselines3(stack.enter_context(closing(HighwayEnv(config=crowded()))))
    return [Row("training | stable-baselines3's DQN", ours, partial(learn, rival, seeds), 2.5)]


def stable_baselines3(env: HighwayEnv) -> Any:
    """Its DQN with our settings; it has one buffer and no double Q target."""
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
    """Decisions a second of stable-baselines3."""
    decisions = 200 * len(seeds)
    model._last_obs = None  # another environment has had SUMO meanwhile: reset
    begun = time.perf_counter()
    model.learn(decisions, reset_num_timesteps=False, log_interval=None)
    return decisions / (time.perf_counter() - begun)


def highway_env_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Decisions a second."""
    import highway_env  # noqa: F401 (registers its ids)

    [ours] = env_rows(seeds, stack)
    scene = {"lanes_count": 3, "vehicles_count": VEHICLES, "policy_frequency": 1, "duration": 200}
    env = stack.enter_context(closing(gymnasium.make("highway-v0", config=scene)))
    keep = env.unwrapped.action_type.actions_indexes["IDLE"]  # type: ignore[attr-defined]
    rival = partial(drive_on, env, keep, seeds[:1])
    return [Row("environment | HighwayEnv", ours.ours, rival)]


def drive_on(env: gymnasium.Env[Any, Any], action: int, seeds: Sequence[int]) -> float:
    """Decisions a second of an environment that is given one action."""
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
    """Decisions a second of all processes together; no row on a machine of one core."""
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
        begun = time.perf_counter()
        for pipe in pipes:
            pipe.send(True)
        decisions = sum(pipe.recv() for pipe in pipes)
        return decisions / (time.perf_counter() - begun)

    return [Row("two processes | one", partial(together, pipes), partial(together, pipes[:1]), 1.8)]


def work(pipe: "Connection[Any, Any]", core: int, seeds: Sequence[int]) -> None:
    """A process that drives whenever it is told to, and tells how many decisions it made."""
    if core >= 0:
        os.sched_setaffinity(0, {core})
    with closing(HighwayEnv(config=crowded())) as env:
        actions = recorded(env, IdmDriver(env.config.safety), seeds)
        pipe.send(True)
        while pipe.recv():
            drive(env, actions)
            pipe.send(sum(map(len, actions.values())))


def scaling_rows(seeds: Sequence[int], stack: ExitStack) -> list[Row]:
    """Decisions a second with ever more vehicles, placed evenly; 60 a kilometre from 30 on."""
    home, rows = Path(stack.enter_context(tempfile.TemporaryDirectory())), []
    for number in NUMBERS:
        folder = home / str(number)
        write_scenario(folder, even_traffic(number))
        config = crowded(number).updated("simulation", scenario=str(folder))
        env = stack.enter_context(closing(HighwayEnv(config=config)))
        actions = recorded(env, IdmDriver(config.safety), seeds[:2])
        ours, bare = partial(drive, env, actions), partial(step_bare, env, seeds[:2])
        rows.append(Row(f"{number} vehicles", ours, bare))
    return rows


def even_traffic(number: int) -> ScenarioDescription:
    """That many vehicles and the ego, evenly over three lanes; 500 m of road for each 30."""
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


ROWS: dict[str, Callable[[Sequence[int], ExitStack], list[Row]]] = {
    "env": env_rows,
    "step": step_rows,
    "train": train_rows,
    "highway-env": highway_env_rows,
    "processes": processes_rows,
    "scaling": scaling_rows,
}

if __name__ == "__main__":
    sys.exit(main())
