"""The learned driver: it follows the greedy policy of trained Q-networks, in numpy only."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, LearningConfig, MobilConfig
from drl_av.drivers.driver import Driver
from drl_av.drivers.network import Float32Array, QNetwork, forward
from drl_av.drivers.policy_file import load_run
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
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
CHANGES_SPEED = np.array([action.longitudinal is not Longitudinal.MAINTAIN for action in ACTIONS])
"""For each action number, whether the action accelerates or brakes; bool, shape (12,)."""


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


MARGINS = ("lane_change_margin", "abort_margin", "acceleration_margin")
"""The settings of ``[learning]`` that are margins, in the order of ``Margins``."""


class Margins(NamedTuple):
    """The advantages in Q-value that an action needs in order to be chosen (ours)."""

    lane_change: float = 0.0
    """For starting a lane change, instead of keeping the lane."""
    abort: float = 0.0
    """For aborting a lane change, instead of going on with it."""
    acceleration: float = 0.0
    """For accelerating or braking, instead of keeping the speed."""

    @classmethod
    def of(cls, learning: LearningConfig) -> "Margins":
        """Return the margins of the settings ``learning``."""
        return cls(*(getattr(learning, name) for name in MARGINS))

    def action_penalties(self, changing: bool) -> Float32Array:
        """Return the margin that is subtracted from the Q-value of each action, shape (12,).

        ``changing`` says whether a lane change is in progress. If it is, the actions to the left
        and to the right lose the margin for aborts, because *keep* continues the lane change.
        """
        lateral = self.abort if changing else self.lane_change
        return (lateral * CHANGES_LANE + self.acceleration * CHANGES_SPEED).astype(np.float32)


NO_MARGINS = Margins()
"""The margins of the paper: none."""


class LearnedDriver(Driver):
    """Chooses the action whose Q-value minus its margin is greatest (ours).

    Without margins, small errors of the networks have two effects. Between equally good lanes the
    ego may start a lane change and abort it at the next decision. At the right speed it may
    accelerate and brake in turn. The margins prevent both.

    Args:
        values: The function from an observation to the Q-values.
        margins: The margins, differences of Q-values.
        permission: If given, the driver chooses only among the actions that it may propose.
    """

    def __init__(
        self,
        values: Values,
        margins: Margins = NO_MARGINS,
        permission: Permission | None = None,
    ) -> None:
        self.values = values
        self.margins, self._permission = margins, permission
        self._penalties = (
            margins.action_penalties(changing=False),
            margins.action_penalties(changing=True),
        )

    def with_margins(self, margins: Margins) -> "LearnedDriver":
        """Return a driver with the same Q-values and permission, and other margins."""
        return LearnedDriver(self.values, margins, self._permission)

    def limited_to(self, permission: Permission) -> "LearnedDriver":
        """Return a driver that chooses only among the actions which ``permission`` admits."""
        return LearnedDriver(self.values, self.margins, permission)

    def greedy(self, s_t: Float32Array) -> int:
        """Return the number of the greedy action, argmax_a Q(s_t, a), without margins.

        The training chooses it with probability 1 - epsilon (Algorithm 1 of the paper, line 5).
        """
        return int(self.values(s_t).argmax())

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the action whose Q(s, a) minus its margin is greatest.

        With a permission, the maximum is over the actions that it admits, or over all actions if
        it admits none.
        """
        values = self.values(observation)
        values -= self._penalties[scene.lane_change is not None]
        best = ACTIONS[values.argmax()]
        if self._permission is None:
            return best
        ranked = (ACTIONS[number] for number in np.argsort(-values, kind="stable"))
        return next((one for one in ranked if self._permission(scene, one)), best)


def learned_driver(networks: Sequence[QNetwork], config: Config) -> LearnedDriver:
    """Build the driver that follows these networks, with the mirror and margins of ``config``.

    Several networks form an ensemble. The driver always uses their current weights, also while
    they are trained.
    """
    members = [network_values(network) for network in networks]
    if config.learning.mirrored:
        mirror = mirror_of(observed_indicators(config.observation))
        members = [mirrored_values(values, mirror) for values in members]
    return LearnedDriver(mean_values(members), Margins.of(config.learning))


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
