"""Searches hyperparameters of stable-baselines3's DQN, for ``examples/rl_zoo3.yml``.

    python tools/tune_rl_zoo3.py
    python tools/tune_rl_zoo3.py --again 2 4 0  # no search: train these trials again

A trial draws each hyperparameter of ``RANGES`` at random, trains once and is rated in 12 episodes.
The best trials, the values that were chosen by hand and the defaults of stable-baselines3 are then
trained again with other training seeds and rated in other episodes, 30 for each training. The
shipped driver drives these episodes too.
"""

import argparse
import time
from collections.abc import Mapping
from contextlib import closing
from statistics import fmean
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DQN

import drl_av
from drl_av.cli.options import int_at_least
from drl_av.drivers.checked import PolicyDriver
from verification.program import made_by

BY_HAND: dict[str, Any] = {
    "learning_rate": 1e-3,
    "batch_size": 128,
    "buffer_size": 100_000,
    "learning_starts": 1000,
    "gamma": 0.93,
    "target_update_interval": 500,
    "train_freq": 4,
    "gradient_steps": 2,
    "exploration_fraction": 0.3,
    "exploration_final_eps": 0.05,
    "policy_kwargs": {"net_arch": [100, 100]},
}
"""The values of ``examples/rl_zoo3.yml`` before the search."""
RANGES: dict[str, tuple[float, ...]] = {
    "learning_rate": (3e-4, 5e-4, 1e-3, 2e-3),
    "gamma": (0.9, 0.93, 0.96),
    "batch_size": (64, 128, 256),
    "target_update_interval": (250, 500, 1000),
    "gradient_steps": (1, 2, 4),
    "exploration_fraction": (0.1, 0.2, 0.3),
}
"""The values among which a trial draws; it takes everything else from ``BY_HAND``."""
CALM = {"traffic": {"kind": "calm"}}
SEARCH_SEED = 0
VEHICLES = (5, 15, 25)
TRIAL_TRAFFIC, FINAL_TRAFFIC = 800_000, 801_000
"""First traffic seeds of the episodes that rate a training."""


class Rating(NamedTuple):
    """The results of an agent without exploration; the first two are means over its episodes."""

    reward: float
    """Reward per decision."""
    speed_m_s: float
    hits: int
    """Episodes in which the ego hit something."""


def draw(number: int) -> list[dict[str, Any]]:
    """Return the drawn values of the first ``number`` trials; trial k is the same in each call."""
    rng = np.random.default_rng(SEARCH_SEED)
    return [
        {name: values[rng.integers(len(values))] for name, values in RANGES.items()}
        for _ in range(number)
    ]


def train(settings: Mapping[str, Any], seed: int, decisions: int) -> DQN:
    """Train an agent in traffic that is drawn with ``seed`` and that no evaluation uses."""
    with closing(gymnasium.make("drl_av/Highway-v0", action_mask=False, config=CALM)) as env:
        agent = DQN("MlpPolicy", env, seed=seed, device="cpu", **settings)
        return agent.learn(decisions)


def rate(traffic: int, episodes: int, agent: DQN | None = None) -> Rating:
    """Drive ``episodes`` episodes at each number of vehicles, from the seed ``traffic`` on.

    The paper's own driver drives if there is no agent. Both drive under the check ``paper``.
    """
    own = {}
    if agent is not None:
        own["agent"] = PolicyDriver(lambda seen: agent.predict(seen, deterministic=True)[0])
    drivers = () if own else "pretrained-paper"
    rows = drl_av.evaluate(
        drivers,
        own=own,
        vehicles=VEHICLES,
        episodes=episodes,
        seed=traffic,
        safety_check="paper",
        config=CALM if own else None,
    )
    return Rating(
        fmean(row.mean_reward for row in rows),
        fmean(row.mean_speed_m_s for row in rows),
        sum(row.ego_hit for row in rows),
    )


def search(trials: int, decisions: int) -> list[int]:
    """Train, rate and print each trial; return the trial numbers, the highest reward first."""
    print(f"{trials} trials, one training of {decisions:,} decisions each, 12 episodes")
    print("trial  reward  m/s    hit  " + "  ".join(RANGES))
    rewards = []
    for number, drawn in enumerate(draw(trials)):
        rating = rate(TRIAL_TRAFFIC, 4, train(BY_HAND | drawn, 0, decisions))
        values = "  ".join(f"{value:<{len(name)}g}" for name, value in drawn.items())
        line = f"{number:>5}  {rating.reward:.4f} {rating.speed_m_s:.2f} {rating.hits:>4}  {values}"
        print(line.rstrip(), flush=True)
        rewards.append(rating.reward)
    return sorted(range(trials), key=lambda number: -rewards[number])


def print_row(name: str, seed: object, rating: Rating) -> None:
    """Print the rating of one training, or the mean of several trainings."""
    numbers = f"{rating.reward:.4f} {rating.speed_m_s:.2f} {rating.hits:>4}"
    print(f"{name:<11} {seed!s:>4}  {numbers}", flush=True)


def main() -> None:
    """Search, train the best again beside the values by hand and the defaults, print tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    text = "of the search (default: 16)"
    parser.add_argument("--trials", type=int_at_least(1), default=16, help=text)
    parser.add_argument("--best", type=int, default=3, help="trained again (default: 3)")
    parser.add_argument("--again", type=int, nargs="+", help="train these trials, search none")
    parser.add_argument("--trainings", type=int, default=2, help="of each (default: 2)")
    parser.add_argument("--decisions", type=int, default=20_000, help="(default: 20000)")
    options = parser.parse_args()
    begun_s = time.monotonic()
    torch.set_num_threads(1)
    again = options.again or search(options.trials, options.decisions)[: options.best]
    drawn = draw(max(again) + 1)
    rivals: dict[str, dict[str, Any]] = {"defaults": {}, "by hand": BY_HAND}
    rivals |= {f"trial {number}": BY_HAND | drawn[number] for number in again}
    print("\ntrained again, 30 episodes each\nsettings    seed  reward  m/s    hit")
    print_row("pretrained-paper", "", rate(FINAL_TRAFFIC, 10))
    ratings: dict[str, list[Rating]] = {name: [] for name in rivals}
    for seed in range(1, options.trainings + 1):
        for name, settings in rivals.items():
            rating = rate(FINAL_TRAFFIC, 10, train(settings, seed, options.decisions))
            ratings[name].append(rating)
            print_row(name, seed, rating)
    for name, made in ratings.items():
        rewards, speeds_m_s, hits = zip(*made, strict=True)
        print_row(name, "mean", Rating(fmean(rewards), fmean(speeds_m_s), sum(hits)))
    print(made_by(time.monotonic() - begun_s))


if __name__ == "__main__":
    main()
