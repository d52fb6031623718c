"""Epsilon-greedy exploration, line 5 of Algorithm 1 of the paper, and its schedule."""

import numpy as np

from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import LearnedDriver
from drl_av.drivers.network import Float32Array
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene


def linear_epsilon(
    episode: int, episodes: int, start: float = 1.0, end: float = 0.2, fraction: float = 0.7
) -> float:
    """Return epsilon, the probability of a random action, in an episode; the first episode is 0.

    Epsilon decreases linearly from ``start`` to ``end`` over the first ``fraction`` of all
    ``episodes``, and is constant afterwards (Sec. IV-C of the paper).
    """
    progress = min(1.0, episode / (fraction * episodes))
    return (1.0 - progress) * start + progress * end


class ExploringDriver(Driver):
    """Adds epsilon-greedy exploration to a driver; set ``epsilon`` before each episode.

    The random numbers come from the training's generator, not from the episode's seed.
    """

    def __init__(self, driver: LearnedDriver, rng: np.random.Generator) -> None:
        self._driver, self._rng = driver, rng
        self.epsilon = 1.0

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return a random action with probability ``epsilon``, else the driver's greedy action."""
        if self._rng.random() < self.epsilon:
            return ACTIONS[self._rng.integers(len(ACTIONS))]
        return ACTIONS[self._driver.greedy(observation)]
