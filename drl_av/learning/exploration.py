"""Algorithm 1, line 5: how much the driver explores, and how."""

from collections.abc import Callable
from functools import partial
from typing import Protocol

import numpy as np

from drl_av.drivers.driver import Driver
from drl_av.drivers.network import Float32Array
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene


def linear_epsilon(
    episode: int, episodes: int, start: float = 1.0, end: float = 0.2, fraction: float = 0.7
) -> float:
    """The share of random actions in an episode counted from 0.

    Sec. IV-C: falls linearly from ``start`` to ``end`` over ``fraction`` of the episodes, and
    stays there.
    """
    progress = min(1.0, episode / (fraction * episodes))
    return (1.0 - progress) * start + progress * end


def epsilon_greedy(
    epsilon: float, action_size: int, greedy: Callable[[], int], rng: np.random.Generator
) -> int:
    """A random action with probability ``epsilon``, else the greedy one.

    Algorithm 1, line 5. ``greedy`` is called only if its action is taken.
    """
    if rng.random() < epsilon:
        return int(rng.integers(action_size))
    return greedy()


class GreedyDriver(Driver, Protocol):
    """A driver whose greedy action Algorithm 1 asks for."""

    def greedy(self, s_t: Float32Array) -> int:
        """argmax_a Q(s_t, a) of a scaled observation, shape (27,)."""


class ExploringDriver:
    """Epsilon-greedy around another driver; ``epsilon`` may be set before each episode."""

    def __init__(self, driver: GreedyDriver, rng: np.random.Generator) -> None:
        self._driver, self._rng = driver, rng
        self.epsilon = 1.0

    def start(self, seed: int) -> None:
        """Draws go on from the generator of the training, whatever the seed of the traffic."""

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """A random action with probability ``epsilon``, else the greedy one."""
        greedy = partial(self._driver.greedy, observation)
        return ACTIONS[epsilon_greedy(self.epsilon, len(ACTIONS), greedy, self._rng)]
