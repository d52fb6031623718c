from typing import Any

import numpy as np
import pytest

from drl_av.config import LearningConfig
from drl_av.driving.actions import ACTIONS
from drl_av.learning.algorithm_1 import ExploringDriver, linear_epsilon

UNSEEN: Any = None  # the scene, which exploration does not read


def test_schedule_ends_on_its_last_value_exactly():
    ends = {"epsilon_start": 0.9, "epsilon_end": 0.05, "epsilon_fraction": 0.5}
    assert linear_epsilon(300, LearningConfig(episodes=300, **ends)) == 0.05


class Chooser:
    """A driver whose greedy action is always the same; without one it must not be asked."""

    def __init__(self, number: int | None = None) -> None:
        self.number = number

    def start(self, seed: int) -> None:
        pass

    def act(self, scene: Any, observation: Any) -> Any:
        assert self.number is not None, "the greedy action was asked for"
        return ACTIONS[self.number]


def taken(epsilon: float, driver: Chooser, decisions: int) -> list[int]:
    explorer = ExploringDriver(driver, np.random.default_rng(0))
    explorer.epsilon = epsilon
    s_t: Any = np.zeros(27, np.float32)
    return [explorer.act(UNSEEN, s_t).number for _ in range(decisions)]


def test_epsilon_one_takes_every_action_equally_and_never_asks_the_network():
    counts = np.bincount(taken(1.0, Chooser(), 12_000), minlength=12)
    assert len(counts) == 12
    assert counts.min() > 850
    assert counts.max() < 1150


def test_epsilon_a_fifth_explores_a_fifth_of_the_time():
    explored = np.mean(np.array(taken(0.2, Chooser(5), 10_000)) != 5)
    assert explored == pytest.approx(0.2 * 11 / 12, abs=0.02)  # 1 of 12 random actions is action 5
