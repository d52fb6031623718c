"""The learned driver: it follows the greedy policy of trained Q-networks, in numpy only."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, MobilConfig
from drl_av.drivers.driver import Driver
from drl_av.drivers.network import Float32Array, QNetwork, forward
from drl_av.drivers.policy_file import load_run
from drl_av.driving.actions import ACTIONS, Action, Lateral
from drl_av.driving.affordances import Affordances, observed_indicators
from drl_av.driving.car_following import acceleration_behind_ego
from drl_av.driving.mirror import MIRROR, Mirror, mirror_of, mirrored_observations
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError, RunError
from drl_av.safety.check import SafetyCheck, permits

Permission = Callable[[Scene, Action], bool]
"""A function that says whether a driver may propose an action in a scene."""
Values = Callable[[Float32Array], Float32Array]
"""A function of an observation, shape (27,), that returns Q(s, .), a new array of shape (12,)."""

URGENT_M = 250.0
"""If less than this distance, metres, is left for each mandatory lane change, a driver may change
lanes even if the vehicle behind must brake hard for it (ours)."""
CHANGES_LANE = np.array([action.lateral is not Lateral.KEEP for action in ACTIONS])
"""For each action number, whether the action is a lane change; bool, shape (12,)."""


def network_values(network: QNetwork) -> Values:
    """Return a function that computes Q(s, .) with the current weights of this network.

    The function raises ConfigError for an observation of another length than the network's.
    """
    layers, observed = network.layers, network.sizes[0]

    def values(s: Float32Array) -> Float32Array:
        if s.shape[-1] != observed:
            raise ConfigError(
                f"The observation has {s.shape[-1]} numbers, but this driver observes {observed}: "
                "choose the environment of its training, or set observation.way as there."
            )
        return forward(layers, s)[1]

    return values


def mirrored_values(values: Values, mirror: Mirror = MIRROR) -> Values:
    """Return a function that averages ``values`` over a scene and its mirror image (ours).

    It computes (Q(s, a) + Q(m(s), m(a))) / 2, where m exchanges left and right. On a symmetric road
    both terms estimate the same number, so that their mean has a smaller error.
    """

    def mean(s: Float32Array) -> Float32Array:
        q = values(s)
        q += values(mirrored_observations(s, mirror))[mirror.action_permutation]
        q *= 0.5
        return q

    return mean


def mean_values(members: Sequence[Values]) -> Values:
    """Return a function that averages the Q-values of several networks, an ensemble (ours).

    As in Ensemble-DQN (Anschel et al. 2017), the networks learn separately and decide together.
    Each network learns from its own batches, as in MeanQ (Liang et al. 2022), and has its own
    target network, as in bootstrapped DQN (Osband et al. 2016). The mean has smaller random errors
    than each network, because the networks seldom make the same error.
    """
    first, *others = members

    def mean(s: Float32Array) -> Float32Array:
        q = first(s)
        for values in others:
            q += values(s)
        q /= np.float32(len(members))
        return q

    return mean if others else first


def respects_mobil(check: SafetyCheck, mobil: MobilConfig) -> Permission:
    """Return the permission of a driver that must reach an exit or merge (ours).

    It admits the actions that ``check`` permits, except those that begin

    - a lane change in the direction opposite to a mandatory lane change;
    - a lane change after which the vehicle behind the ego, by IDM, would brake harder than
      ``mobil.comfortable_braking_m_s2``. This is the safety criterion of MOBIL (Kesting, Treiber
      and Helbing 2007). It does not apply if less than ``URGENT_M`` is left for each mandatory
      lane change.
    """

    def may_propose(scene: Scene, action: Action) -> bool:
        begins = scene.lane_change is None and action.lateral is not Lateral.KEEP
        if begins and not _may_begin(scene.affordances, action.lateral.sign, mobil):
            return False
        return permits(check, scene, action)

    return may_propose


def _may_begin(affordances: Affordances, sign: int, mobil: MobilConfig) -> bool:
    lanes, within_m = affordances.mandatory
    if sign * lanes < 0 or not affordances.has_lane(sign):
        return False
    if within_m < abs(lanes) * URGENT_M:
        return True
    rear = affordances.rear(sign)
    limit = -mobil.comfortable_braking_m_s2
    return rear is None or acceleration_behind_ego(affordances, rear, mobil) >= limit


def margin_penalties(lane_change_margin: float) -> Float32Array:
    """Return what each action's Q-value loses while no lane change is in progress, shape (12,)."""
    return (lane_change_margin * CHANGES_LANE).astype(np.float32)


class LearnedDriver(Driver):
    """Chooses the action with the greatest Q-value, and starts a lane change by a margin (ours).

    Without a margin, small errors of the networks may start a lane change between equally good
    lanes, and abort it at the next decision.

    Args:
        values: The function from an observation to the Q-values.
        lane_change_margin: What a lane change must be worth more than keeping the lane in order to
            start, a difference of Q-values; 0 in the paper.
        permission: If given, the driver chooses only among the actions that it may propose.
    """

    def __init__(
        self, values: Values, lane_change_margin: float = 0.0, permission: Permission | None = None
    ) -> None:
        self.values, self.lane_change_margin = values, lane_change_margin
        self._permission = permission
        self._penalties = margin_penalties(lane_change_margin)

    def limited_to(self, permission: Permission) -> "LearnedDriver":
        """Return a driver that chooses only among the actions which ``permission`` admits."""
        return LearnedDriver(self.values, self.lane_change_margin, permission)

    def greedy(self, s_t: Float32Array) -> int:
        """Return the number of the greedy action, argmax_a Q(s_t, a), without the margin.

        The training chooses it with probability 1 - epsilon (Algorithm 1 of the paper, line 5).
        """
        return int(self.values(s_t).argmax())

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the action whose Q(s, a), less the margin, is greatest.

        With a permission, the maximum is over the actions that it admits, or over all actions if
        it admits none.
        """
        values = self.values(observation)
        if scene.lane_change is None:
            values -= self._penalties
        best = ACTIONS[values.argmax()]
        if self._permission is None:
            return best
        ranked = (ACTIONS[number] for number in np.argsort(-values, kind="stable"))
        return next((one for one in ranked if self._permission(scene, one)), best)


def learned_driver(networks: Sequence[QNetwork], config: Config) -> LearnedDriver:
    """Build the driver that follows these networks, with the mirror and margin of ``config``.

    Several networks form an ensemble. The driver always uses their current weights, also while
    they are trained.
    """
    members = [network_values(network) for network in networks]
    if config.learning.mirrored:
        mirror = mirror_of(observed_indicators(config.observation))
        members = [mirrored_values(values, mirror) for values in members]
    return LearnedDriver(mean_values(members), config.learning.lane_change_margin)


def load_learned(path: Path) -> tuple[LearnedDriver, Config]:
    """Read a learned driver and its config from a run's folder or a policy file.

    Unlike that of ``make_drivers``, this driver may propose any action, also with the setting
    ``learning.permitted_only``.

    Raises:
        RunError: there is no policy file.
        CheckpointError: the policy file is damaged, or its config differs from the folder's.
    """
    networks, config = load_run(path)
    return learned_driver(networks, config), config


def require_same_observation(name: str, own: Config, config: Config) -> None:
    """Raise RunError unless a learned driver observes here what it observed in its training."""
    same_scale = own.ego.max_speed_m_s == config.ego.max_speed_m_s
    if own.observation != config.observation or not same_scale:
        raise RunError(
            f"{name} was trained with other [observation] settings or another "
            "ego.max_speed_m_s than it would drive with here: evaluate it alone, without "
            "settings that change them."
        )
