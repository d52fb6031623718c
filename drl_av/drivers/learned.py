"""The learned driver: it follows the greedy policy of a trained Q-network, in numpy only."""

from collections.abc import Callable
from pathlib import Path

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.network import Float32Array, QNetwork, forward
from drl_av.drivers.policy_file import load_run
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.affordances import observed_indicators
from drl_av.driving.mirror import MIRROR, Mirror, mirror_of, mirrored_observations
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError, RunError

Values = Callable[[Float32Array], Float32Array]
"""A function of an observation, shape (27,), that returns Q(s, .), a new array of shape (12,)."""


def network_values(network: QNetwork) -> Values:
    """Return a function that computes Q(s, .) with the current weights of this network.

    The function raises ConfigError for an observation of another length than the network's.
    """
    layers, observed = network.layers, network.sizes[0]

    def values(s: Float32Array) -> Float32Array:
        if s.shape[-1] != observed:
            raise ConfigError(
                f"The observation has {s.shape[-1]} numbers, but this driver observes {observed}: "
                "choose the environment and the observation of its training, such as "
                "observation.way and no --observation (observation=)."
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


def require_same_observation(name: str, own: Config, config: Config) -> None:
    """Raise RunError unless a learned driver observes here what it observed in its training."""
    same_scale = own.ego.max_speed_m_s == config.ego.max_speed_m_s
    if own.observation != config.observation or not same_scale:
        raise RunError(
            f"{name} was trained with other [observation] settings or another "
            "ego.max_speed_m_s than it would drive with here: evaluate it alone, without "
            "settings that change them."
        )
