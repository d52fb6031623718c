"""The learned driver: what trained networks decide, in numpy alone."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from drl_av.config import LearningConfig
from drl_av.drivers.network import Float32Array, QNetwork, forward
from drl_av.driving.actions import ACTIONS, Action, Lateral
from drl_av.driving.mirror import MIRROR, Mirror, mirrored_observations
from drl_av.driving.scene import Scene

Values = Callable[[Float32Array], Float32Array]
"""Q(s, .) of one observation: (observation_size,) -> (action_size,), an array of the caller's."""

CHANGES_LANE = np.array([action.lateral is not Lateral.KEEP for action in ACTIONS])


def network_values(network: QNetwork) -> Values:
    """The estimates of one network; they follow every change of its parameters in place."""
    layers = network.layers
    return lambda s: forward(layers, s)[1]


def mirrored_values(values: Values, mirror: Mirror = MIRROR) -> Values:
    """(Q(s, a) + Q(m(s), m(a))) / 2, with m the mirror: alike on both sides of the road (ours).

    Where the road is as good in the mirror, both estimate the same value, and their mean has less
    of the network's error.
    """

    def mean(s: Float32Array) -> Float32Array:
        q = values(s)
        q += values(mirrored_observations(s, mirror))[mirror.action_permutation]
        q *= 0.5
        return q

    return mean


def mean_values(members: Sequence[Values]) -> Values:
    """The mean of several estimates (ours).

    Networks that learn apart decide together, as in Ensemble-DQN (Anschel et al. 2017). Each
    learns from batches of its own, as in MeanQ (Liang et al. 2022), and has a target network of
    its own, as the heads of bootstrapped DQN (Osband et al. 2016). An error that one network makes
    by chance is seldom made by all of them.
    """
    first, *others = members

    def mean(s: Float32Array) -> Float32Array:
        q = first(s)
        for values in others:
            q += values(s)
        q /= np.float32(len(members))
        return q

    return mean if others else first


class LearnedDriver:
    """The action of the greatest value; begins no lane change that gains less than a margin.

    Where two lanes are equally good, the networks' error alone would begin a lane change and abort
    it in the next decision. A lane change therefore begins only if its value exceeds that of the
    best action that keeps the lane by more than the margin (ours).
    """

    def __init__(self, values: Values, lane_change_margin: float = 0.0) -> None:
        self.values = values
        self._margin = lane_change_margin

    def with_margin(self, lane_change_margin: float) -> "LearnedDriver":
        """The same driver with another margin."""
        return LearnedDriver(self.values, lane_change_margin)

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def greedy(self, s_t: Float32Array) -> int:
        """argmax_a Q(s, a), without a margin: what Algorithm 1, line 5, takes."""
        return int(self.values(s_t).argmax())

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """argmax_a Q(s, a), the margin taken off the actions that would begin a lane change."""
        values = self.values(observation)
        if scene.lane_change is None:
            values[CHANGES_LANE] -= np.float32(self._margin)
        return ACTIONS[values.argmax()]


def learned_driver(networks: Sequence[QNetwork], config: LearningConfig) -> LearnedDriver:
    """How networks that were trained with these settings drive; follows their every change."""
    members = [network_values(network) for network in networks]
    if config.mirrored:
        members = [mirrored_values(values) for values in members]
    return LearnedDriver(mean_values(members), config.lane_change_margin)
