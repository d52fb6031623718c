"""Prioritized experience replay (Schaul et al. 2015), the proportional variant.

Rows with a large TD error are drawn more often, and importance weights correct for this.
"""

import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.config import LearningConfig
from drl_av.drivers.policy_file import State
from drl_av.learning.replay import Batch, UniformBuffer, batch_of

BLOCK = 64
"""Number of weights under one node of the sum tree."""


def importance_weights(probability: FloatArray, count: int, exponent: float) -> Float32Array:
    """Return the importance weights (N P(i))^-beta, divided by the largest of them, shape (rows,).

    ``probability`` is P, shape (rows,), ``count`` is N, ``exponent`` is beta (Schaul et al. 2015,
    Sec. 3.4).
    """
    weights = (count * probability) ** -exponent
    weights /= weights.max()
    return weights.astype(np.float32)


class SumTree:
    """Holds one weight for each slot (row index) of a ring; finds slots by cumulative weight.

    The tree has two levels, because a numpy call costs more than the sum of a block. The sums
    depend on the current weights alone, not on the order in which they were set.
    """

    def __init__(self, capacity: int) -> None:
        blocks = -(-capacity // BLOCK)
        self._leaves = np.zeros((blocks, BLOCK))
        self._sums = np.zeros(blocks)
        self.weights: FloatArray = self._leaves.reshape(-1)[:capacity]
        """The weight of each slot, shape (capacity,), 0 if not set. Read only: use ``set``."""

    def set(self, slots: IntArray, weights: FloatArray | float) -> None:
        """Set the weights of some slots; if a slot occurs twice, its last weight counts."""
        self.weights[slots] = weights
        blocks = slots // BLOCK
        self._sums[blocks] = self._leaves.take(blocks, axis=0).cumsum(axis=1)[:, -1]

    def fill(self, weights: FloatArray) -> None:
        """Set the weights of the first ``len(weights)`` slots of an empty tree."""
        self.weights[: len(weights)] = weights
        self._sums[:] = self._leaves.cumsum(axis=1)[:, -1]

    def find(self, fractions: FloatArray) -> tuple[IntArray, FloatArray]:
        """Find the slot at which the cumulative weight exceeds each fraction of the total weight.

        ``fractions`` has shape (rows,) and values in [0, 1). Returns the slots and their
        probabilities (weight / total), both (rows,). A slot of weight 0 is never found.
        """
        edges = np.concatenate(([0.0], self._sums.cumsum()))
        values = _below(fractions * edges[-1], edges[-1])
        blocks = edges.searchsorted(values, side="right") - 1
        values = _below(values - edges[blocks], self._sums[blocks])
        ends = self._leaves.take(blocks, axis=0).cumsum(axis=1)
        within = (ends > values[:, None]).argmax(axis=1)
        slots = blocks * BLOCK + within
        return slots, self.weights[slots] / edges[-1]


def _below(values: FloatArray, end: FloatArray) -> FloatArray:
    """Limit values to the largest float below ``end``, which they may have reached by rounding."""
    return np.minimum(values, np.nextafter(end, 0.0))


class PrioritizedBuffer(UniformBuffer):
    """A single ring for all transitions, which are drawn by the priority of their TD errors.

    P(i) = p_i^alpha / sum p^alpha with p_i = |TD error| + ``priority_floor``. A new transition has
    the largest priority so far (Sec. 3.3 and Algorithm 1 of Schaul et al. 2015).
    """

    def __init__(self, observation_size: int, config: LearningConfig) -> None:
        super().__init__(observation_size, config)
        self.priority_exponent = config.priority_exponent
        self.importance_exponent_start = config.importance_exponent_start
        self.importance_exponent = config.importance_exponent_start
        self.priority_floor = config.priority_floor
        self.tree = SumTree(len(self.ring.rows))
        self._greatest = 1.0

    def stored(self, slot: int) -> None:
        """Give a new transition the largest priority so far."""
        self.tree.set(np.array([slot]), self._greatest)

    def sample(self, batch_size: int, rng: np.random.Generator) -> Batch:
        """Draw a minibatch, one row from each of ``batch_size`` equal parts of the priority sum.

        Sec. 3.3 and app. B.2.1 of Schaul et al. 2015. Raises ValueError if the buffer is empty.
        """
        if not self.ring:
            raise ValueError("There are no rows to sample.")
        fractions = (np.arange(batch_size) + rng.random(batch_size)) / batch_size
        slots, probability = self.tree.find(fractions)
        numbers = self.ring.numbers.take(slots, axis=0)
        weights = importance_weights(probability, len(self.ring), self.importance_exponent)
        return batch_of(numbers, self.ring.observation_size)._replace(weights=weights, slots=slots)

    def anneal(self, progress: float) -> None:
        """Raise the exponent beta linearly to 1 (Sec. 3.4 of Schaul et al. 2015)."""
        start = self.importance_exponent_start
        self.importance_exponent = start + (1.0 - start) * progress

    def update_priorities(self, batch: Batch, td_errors: Float32Array) -> None:
        assert batch.slots is not None
        p = np.abs(td_errors, dtype=np.float64) + self.priority_floor
        weights = p**self.priority_exponent
        self.tree.set(batch.slots, weights)
        self._greatest = max(self._greatest, float(weights.max()))

    def state(self) -> State:
        """Return the state of the ring, p^alpha of each row, and the largest p^alpha so far."""
        priorities = self.tree.weights[: len(self.ring)].copy()
        return self.ring.state() | {"priorities": priorities, "greatest": np.array(self._greatest)}

    def restore(self, state: State) -> None:
        rows, priorities, greatest = state["rows"], state["priorities"], float(state["greatest"])
        in_range = (priorities > 0) & (priorities <= greatest)
        finite = greatest * len(rows) < np.inf
        if priorities.shape != rows.shape[:1] or not in_range.all() or not finite:
            raise ValueError("the priorities do not fit the rows")
        self.ring.restore(state)
        self.tree = SumTree(len(self.ring.rows))
        self.tree.fill(priorities)
        self._greatest = greatest
