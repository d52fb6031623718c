"""How fast the environment and the training are, beside the bare minimum in the same run.

    python tools/benchmark.py env      decisions a second against bare libsumo stepping
    python tools/benchmark.py train    the same with a gradient step each, against bare steps

Every figure is the median over rounds taken in turn, on one core; the ratio is the median of the
ratios round by round. ``--json`` prints one JSON object instead of the table.
"""

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable

import libsumo
import numpy as np
import torch

from drl_av.config import Config
from drl_av.env import HighwayEnv
from drl_av.learning.qnetwork import QNetwork
from drl_av.learning.training import Training
from drl_av.presets import preset
from drl_av.studies.drivers import PRETRAINED, learned_driver

SEEDS = 1_000
"""First traffic seed of the episodes that are timed."""


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("env", "train"))
    parser.add_argument("--vehicles", type=int, default=30, help="beside the ego (default: 30)")
    parser.add_argument("--rounds", type=int, default=5, help="(default: 5)")
    parser.add_argument("--episodes", type=int, default=5, help="a round (default: 5)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    measure = {"env": measure_env, "train": measure_train}[options.what]
    result = measure(options.vehicles, options.rounds, options.episodes)
    if options.json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        print(
            f"{name:<46} {value:10.2f}" if isinstance(value, float) else f"{name:<46} {value:>10}"
        )


def measure_env(vehicles: int, rounds: int, episodes: int) -> dict[str, float | int]:
    """Decisions a second of the environment and of bare stepping, resets included in both."""
    env = HighwayEnv(config=Config())
    ours, bare = in_turn(
        rounds,
        lambda number: drive(env, vehicles, episodes, number),
        lambda number: step_bare(env, vehicles, episodes, number),
    )
    env.close()
    return {
        "vehicles": vehicles,
        "rounds": rounds,
        "environment, decisions a second": statistics.median(ours),
        "bare libsumo, decisions a second": statistics.median(bare),
        "environment / bare": ratio(ours, bare),
    }


def measure_train(vehicles: int, rounds: int, episodes: int) -> dict[str, float | int]:
    """Decisions a second of Algorithm 1, and of bare stepping plus PyTorch's own gradient step."""
    config = preset("paper").updated("traffic", vehicles_min=vehicles, vehicles_max=vehicles)
    config = config.updated("learning", epsilon_start=0.2, epsilon_end=0.2)
    env = HighwayEnv(config=config)
    training = Training(env)
    for _ in range(3):
        training.run_episode()
    gradient_steps = bare_gradient(config)

    def bare(number: int) -> float:
        stepping = 1 / step_bare(env, vehicles, episodes, number)
        return 1 / (stepping + 1 / gradient_steps())

    ours, floor = in_turn(rounds, lambda number: learn(training, episodes), bare)
    env.close()
    return {
        "vehicles": vehicles,
        "rounds": rounds,
        "training, decisions a second": statistics.median(ours),
        "bare libsumo + bare gradient, decisions a second": statistics.median(floor),
        "training / bare": ratio(ours, floor),
    }


def drive(env: HighwayEnv, vehicles: int, episodes: int, number: int) -> float:
    """Decisions a second of the shipped driver, which ends no episode early."""
    learned, _ = learned_driver(PRETRAINED)
    begun, decisions = time.perf_counter(), 0
    for episode in range(episodes):
        seed = SEEDS + number * episodes + episode
        observation, _ = env.reset(seed=seed, options={"vehicles": vehicles})
        over = False
        while not over:
            action = learned.act(env.scene, observation)
            observation, _, terminated, truncated, _ = env.step(action.number)
            over = terminated or truncated
            decisions += 1
    return decisions / (time.perf_counter() - begun)


def step_bare(env: HighwayEnv, vehicles: int, episodes: int, number: int) -> float:
    """The same traffic loaded and stepped by libsumo alone, the ego driven by SUMO."""
    config = env.config.simulation
    begun, decisions = time.perf_counter(), config.decisions_per_episode
    for episode in range(episodes):
        env.simulation.reset(SEEDS + number * episodes + episode, vehicles)
        libsumo.vehicle.setSpeedMode("ego", 31)
        for _ in range(decisions * config.steps_per_decision):
            libsumo.simulationStep()
    return episodes * decisions / (time.perf_counter() - begun)


def learn(training: Training, episodes: int) -> float:
    """Decisions a second of Algorithm 1."""
    begun = time.perf_counter()
    decisions = sum(training.run_episode().decisions for _ in range(episodes))
    return decisions / (time.perf_counter() - begun)


def bare_gradient(config: Config) -> Callable[[], float]:
    """Gradient steps a second of plain PyTorch, autograd and fused Adam, on one batch."""
    torch.set_num_threads(1)
    rng, rows = np.random.default_rng(0), config.learning.batch_size
    online, target = QNetwork(rng), QNetwork(rng)
    adam = torch.optim.Adam(online.parameters(), lr=config.learning.learning_rate, fused=True)
    s_t, s_tp1 = (torch.from_numpy(rng.normal(size=(rows, 27)).astype("f4")) for _ in range(2))
    a_t = torch.from_numpy(rng.integers(12, size=(rows, 1)))
    r_tp1, discount = torch.full((rows,), -0.1), torch.full((rows,), config.learning.discount)

    def measure(steps: int = 2_000) -> float:
        begun = time.perf_counter()
        for _ in range(steps):
            with torch.no_grad():
                a_next = online(s_tp1).argmax(1, keepdim=True)
                y = r_tp1 + discount * target(s_tp1).gather(1, a_next)[:, 0]
            loss = ((y - online(s_t).gather(1, a_t)[:, 0]) ** 2).mean()
            adam.zero_grad()
            loss.backward()
            adam.step()
        return steps / (time.perf_counter() - begun)

    return measure


def in_turn(
    rounds: int, first: Callable[[int], float], second: Callable[[int], float]
) -> tuple[list[float], list[float]]:
    """Both measurements, one after the other, ``rounds`` times after a warm-up."""
    first(0)
    second(0)
    pairs = [(first(number), second(number)) for number in range(1, rounds + 1)]
    return [a for a, _ in pairs], [b for _, b in pairs]


def ratio(a: list[float], b: list[float]) -> float:
    """Median of the ratios, round by round."""
    return statistics.median(x / y for x, y in zip(a, b, strict=True))


if __name__ == "__main__":
    main()
