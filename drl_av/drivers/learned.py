"""The learned driver: the greedy policy of trained Q-networks, in numpy only."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from drl_av.config import LearningConfig
from drl_av.drivers.network import Float32Array, QNetwork, forward
from drl_av.driving.actions import ACTIONS, Action, Lateral
from drl_av.driving.mirror import MIRROR, Mirror, mirrored_observations
from drl_av.driving.scene import Scene

Values = Callable[[Float32Array], Float32Array]
"""A function from an observation, shape (27,), to Q(s, .), a new array of shape (12,)."""

CHANGES_LANE = np.array([action.lateral is not Lateral.KEEP for action in ACTIONS])


def network_values(network: QNetwork) -> Values:
    """The Q-values of one network; changes of its parameters take effect at once."""
    layers = network.layers
    return lambda s: forward(layers, s)[1]


def mirrored_values(values: Values, mirror: Mirror = MIRROR) -> Values:
    """The mean of the Q-values of a scene and of its mirror image (ours).

    (Q(s, a) + Q(m(s), m(a))) / 2, where m exchanges left and right. The result is symmetric. On a
    symmetric road both terms estimate the same value, so that their mean has a smaller error.
    """

    def mean(s: Float32Array) -> Float32Array:
        q = values(s)
        q += values(mirrored_observations(s, mirror))[mirror.action_permutation]
        q *= 0.5
        return q

    return mean


def mean_values(members: Sequence[Values]) -> Values:
    """The mean of the Q-values of several networks, an ensemble (ours).

    As in Ensemble-DQN (Anschel et al. 2017), the networks learn separately and decide together.
    Each network learns from its own batches, as in MeanQ (Liang et al. 2022), and has its own
    target network, as the heads of bootstrapped DQN (Osband et al. 2016). The mean reduces random
    errors, because the networks seldom make the same error.
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
    """Chooses the action of the greatest value, with a margin against useless lane changes (ours).

    If two lanes are equally good, errors of the networks could start a lane change and abort it at
    the next decision. The driver therefore starts a lane change only if its value exceeds that of
    the best action without a lane change by more than the margin.
    """

    def __init__(self, values: Values, lane_change_margin: float = 0.0) -> None:
        self.values = values
        self._margin = lane_change_margin

    def with_margin(self, lane_change_margin: float) -> "LearnedDriver":
        """A driver with the same values and another margin."""
        return LearnedDriver(self.values, lane_change_margin)

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def greedy(self, s_t: Float32Array) -> int:
        """The greedy action argmax_a Q(s, a) of Algorithm 1, line 5; ignores the margin."""
        return int(self.values(s_t).argmax())

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """argmax_a Q(s, a), after subtracting the margin from actions that start a lane change."""
        values = self.values(observation)
        if scene.lane_change is None:
            values[CHANGES_LANE] -= np.float32(self._margin)
        return ACTIONS[values.argmax()]


def learned_driver(networks: Sequence[QNetwork], config: LearningConfig) -> LearnedDriver:
    """The driver of networks that were trained with these settings.

    Changes of the networks' parameters take effect at once.
    """
    members = [network_values(network) for network in networks]
    if config.mirrored:
        members = [mirrored_values(values) for values in members]
    return LearnedDriver(mean_values(members), config.lane_change_margin)
