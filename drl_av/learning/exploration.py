"""How much to explore, and how: Algorithm 1, line 5."""

from collections.abc import Callable

import numpy as np


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

    Algorithm 1, line 5. ``greedy`` is only called when its answer is taken.
    """
    if rng.random() < epsilon:
        return int(rng.integers(action_size))
    return greedy()
