"""The learned drivers, in numpy only: those of Algorithm 1, and those that were trained at scale.

A driver of Algorithm 1 follows the greedy policy of its Q-network. One that was trained at scale
takes the most probable permitted action (ours).
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from drl_av.arrays import BoolArray, Float32Array
from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.network import Layers, QNetwork, forward
from drl_av.drivers.policy_file import (
    find_policy,
    load,
    load_layers,
    load_run,
    require_its_settings,
)
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.affordances import observed_indicators
from drl_av.driving.mirror import MIRROR, Mirror, mirror_of, mirrored_observations
from drl_av.driving.scene import Scene
from drl_av.driving.wide_observation import LANES_ASIDE, WIDE_SIZE, observe_wide
from drl_av.errors import ConfigError, RunError, warn
from drl_av.safety import action_mask
from drl_av.safety.check import SafetyCheck
from drl_av.scenarios.folder import find_scenario, load_scenario

Values = Callable[[Float32Array], Float32Array]
"""A function of an observation, shape (27,), that returns Q(s, .), a new array of shape (12,)."""


def network_values(network: QNetwork) -> Values:
    """Return a function that computes Q(s, .) with the current weights of this network.

    The function raises ConfigError for an observation of another length than the network's.
    """
    return partial(_values, network.layers, network.sizes[0])


def _values(layers: Layers, observed: int, s: Float32Array) -> Float32Array:
    if s.shape[-1] != observed:
        raise ConfigError(
            f"The observation has {s.shape[-1]} numbers, but this driver observes {observed}: "
            "choose the environment and the observation of its training, such as "
            "observation.way and no --observation (observation=)."
        )
    return forward(layers, s)[1]


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


class LearnedDriver(Driver):
    """Chooses the action with the greatest Q-value.

    Args:
        values: The function from an observation to the Q-values.
    """

    def __init__(self, values: Values) -> None:
        self.values = values

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the greedy action, argmax_a Q(s, a) (Algorithm 1 of the paper, line 5)."""
        return ACTIONS[self.values(observation).argmax()]


def learned_driver(network: QNetwork, config: Config) -> LearnedDriver:
    """Build the driver that follows a network, with the mirror of ``config``.

    The driver always uses the network's current weights, also while it is trained.
    """
    values = network_values(network)
    if config.learning.mirrored:
        values = mirrored_values(values, mirror_of(observed_indicators(config.observation)))
    return LearnedDriver(values)


def load_learned(path: Path) -> tuple[LearnedDriver, Config]:
    """Read a learned driver and its config from a run's folder or a policy file.

    Raises:
        RunError: there is no policy file.
        CheckpointError: the policy file is damaged, or its config differs from the folder's.
    """
    network, config = load_run(path)
    return learned_driver(network, config), config


def require_same_observation(
    name: str, own: Config, config: Config, own_observation: object = None
) -> None:
    """Raise RunError unless a learned driver observes here what it observed in its training.

    ``own_observation`` is None if the environment's observation is that of its settings.
    """
    if own_observation is not None:
        raise RunError(
            f"{name} observes the indicators alone: drive it without --observation (observation=)."
        )
    same_scale = own.ego.max_speed_m_s == config.ego.max_speed_m_s
    if own.observation != config.observation or not same_scale:
        raise RunError(
            f"{name} was trained with other [observation] settings or another "
            "ego.max_speed_m_s than it would drive with here: evaluate it alone, without "
            "settings that change them."
        )


KIND = "actor"
"""The kind of a policy file of a training at scale, in its metadata."""
INPUTS = WIDE_SIZE + len(ACTIONS)
"""Number of inputs of its network: the wide observation, then the mask."""


class MaskedPolicyDriver(Driver):
    """Observes more than the environment's observation: the wide observation, and the mask.

    Args:
        layers: The (weight, bias) of each layer of the actor, whose outputs are logits.
        check: The safety check under which it drives; it proposes only what the check permits.
        config: The settings of the environment.
    """

    def __init__(self, layers: Layers, check: SafetyCheck, config: Config) -> None:
        self._layers, self._check = layers, check
        self.range_m = float(config.observation.range_m)
        self.max_speed_m_s = float(config.ego.max_speed_m_s)

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the permitted action with the largest logit; of all actions if none is permitted.

        ``observation`` is not used.
        """
        return ACTIONS[self.logits(scene).argmax()]

    def probabilities(self, scene: Scene) -> Float32Array:
        """Return the probability of each action in training, shape (12,); 0 if not permitted."""
        logits = self.logits(scene)
        weights: Float32Array = np.exp(logits - logits.max())
        weights /= weights.sum()
        return weights

    def logits(self, scene: Scene) -> Float32Array:
        """Return the logits of the 12 actions, -inf for those that the check does not permit."""
        permitted = action_mask(self._check, scene)
        wide = observe_wide(
            scene.snapshot, scene.road, self.range_m, self.max_speed_m_s, scene.lanes
        )
        return self.logits_of(wide, permitted == 1)

    def logits_of(self, wide: Float32Array, permitted: BoolArray) -> Float32Array:
        """Return ``logits`` of one scene or more, shape (..., 12), by what is seen and permitted.

        ``wide`` holds the wide observations, shape (..., WIDE_SIZE).
        """
        seen = np.concatenate((wide, permitted), axis=-1, dtype=np.float32)
        logits = forward(self._layers, seen)[1]
        logits[~permitted & permitted.any(axis=-1, keepdims=True)] = -np.inf
        return logits


def actor_driver(
    name: str, actor: tuple[Layers, Config], config: Config, check: SafetyCheck
) -> MaskedPolicyDriver:
    """Return the driver of a training at scale for an environment with this config and check.

    A driver that was trained under ``strict`` warns of another check, and one that was trained
    without ``observation.way`` of a road whose lanes end or leave.

    Raises:
        RunError: it was trained with another range of observation or ``ego.max_speed_m_s``.
    """
    layers, own = actor
    seen = [(each.observation.range_m, each.ego.max_speed_m_s) for each in (own, config)]
    if seen[0] != seen[1]:
        raise RunError(
            f"{name} was trained with another observation.range_m or ego.max_speed_m_s than it "
            "would drive with here: leave these settings as they are."
        )
    if own.safety.check == "strict" != config.safety.check:
        warn(
            f"{name} was trained under strict and relies on it: under {config.safety.check} it "
            "proposes what strict would refuse, and hits vehicles; name --safety-check strict "
            "(safety_check=)."
        )
    road = load_scenario(find_scenario(config.simulation.scenario)).road
    if road.partial_lanes and not own.observation.way:
        warn(
            f"{name} was trained on a loop and does not see where a lane ends or leaves, as on "
            f"{config.simulation.scenario}: it may stand at the end of its lane; gap-mobil and "
            "pretrained-ramp_to_ramp see it."
        )
    return MaskedPolicyDriver(layers, check, config)


def load_actor(path: Path) -> tuple[Layers, Config]:
    """Read the layers and the config of a training at scale, from its folder or policy file.

    Raises the errors of ``load_run``.
    """

    def sizes_of(config: Config) -> Sequence[int]:
        ppo, groups = config.ppo, len(LANES_ASIDE) + 1
        lanes = [groups * ppo.lane_units] if ppo.lane_units else []
        return INPUTS, *lanes, ppo.hidden_1, ppo.hidden_2, len(ACTIONS)

    layers, config = load_layers(find_policy(path), KIND, sizes_of)
    require_its_settings(path, config)
    return layers, config


def is_actor(path: Path) -> bool:
    """Whether a policy file is one of a training at scale.

    Raises:
        CheckpointError: the file is missing or damaged.
    """
    return bool(load(path)[1].get("kind") == KIND)
