"""Several networks that learn apart and decide together, by the mean of what they estimate (ours).

They decide as Ensemble-DQN does (Anschel et al. 2017), each learns from batches of its own as in
MeanQ (Liang et al. 2022), and each has a target network of its own as the heads of bootstrapped
DQN have (Osband et al. 2016). What is wrong by chance is seldom wrong in all of them.
"""

from collections.abc import Sequence

import numpy as np

from drl_av.learning.buffers import Float32Array
from drl_av.learning.qnetwork import GreedyPolicy


class MeanPolicy(GreedyPolicy):
    """argmax_a of the mean of several policies' values."""

    def __init__(self, policies: Sequence[GreedyPolicy]) -> None:
        self._policies = policies

    def values(self, s_t: Float32Array) -> Float32Array:
        """The mean of the estimates: (observation_size,) -> (action_size,)."""
        values = self._policies[0].values(s_t)
        for policy in self._policies[1:]:
            values += policy.values(s_t)
        values /= np.float32(len(self._policies))
        return values
