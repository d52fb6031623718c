"""The learned driver: what trained networks decide."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drl_av.config.learning import LearningConfig
from drl_av.driving.actions import ACTIONS, Action, Lateral
from drl_av.driving.mirror import MIRROR
from drl_av.driving.scene import Scene
from drl_av.learning.ensemble import MeanPolicy
from drl_av.learning.mirroring import MirroredPolicy
from drl_av.learning.qnetwork import GreedyPolicy, QNetwork

_CHANGING = np.array([action.lateral is not Lateral.KEEP for action in ACTIONS])


class GreedyDriver:
    """The action of the greatest value; begins no lane change that is worth next to nothing.

    Where two lanes are as good, what the networks are wrong by would begin a lane change and take
    it back in the next decision. One therefore begins only where its value is more than the margin
    above that of the best action that keeps the lane (ours). Algorithm 1 takes the greatest value
    of ``policy`` all the same: it has to meet what it is wrong in.
    """

    def __init__(self, policy: GreedyPolicy, lane_change_margin: float = 0.0) -> None:
        self.policy = policy
        self._margin = lane_change_margin

    def with_margin(self, lane_change_margin: float) -> "GreedyDriver":
        """The same driver with another margin."""
        return GreedyDriver(self.policy, lane_change_margin)

    def start(self, seed: int) -> None:
        """Nothing to do: no memory, no chance."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """argmax_a Q(s, a), the margin taken off what would begin a lane change."""
        values = self.policy.values(observation)
        if scene.lane_change is None:
            values[_CHANGING] -= np.float32(self._margin)
        return ACTIONS[values.argmax()]


def greedy_driver(networks: Sequence[QNetwork], config: LearningConfig) -> GreedyDriver:
    """How networks that were trained with these settings drive; follows their every change."""
    policies = [
        MirroredPolicy(network, MIRROR) if config.mirrored else GreedyPolicy(network)
        for network in networks
    ]
    policy = policies[0] if len(policies) == 1 else MeanPolicy(policies)
    return GreedyDriver(policy, config.lane_change_margin)
