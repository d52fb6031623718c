"""Learning from the road as a mirror shows it, and deciding by it: left and right swapped."""

from drl_av.config import Config
from drl_av.driving.mirror import Mirror
from drl_av.errors import ConfigError
from drl_av.learning.buffers import Batch, Float32Array
from drl_av.learning.qnetwork import GreedyPolicy, QNetwork
from drl_av.traffic.road import Road


def require_symmetry(config: Config, road: Road) -> None:
    """Raise ConfigError where the reward is another in the mirror: y_des fixed, off the middle."""
    middle_m = road.center_m(len(road.open_lanes) - 1) / 2
    fixed = config.learning.mirrored and config.reward.desired == "fixed"
    if fixed and config.reward.desired_lateral_m != middle_m:
        raise ConfigError(
            f"reward.desired_lateral_m = {config.reward.desired_lateral_m:g} is not the middle of "
            f"the road, {middle_m:g} m: learn there with learning.mirrored = false."
        )


def mirrored_observations(s: Float32Array, mirror: Mirror) -> Float32Array:
    """s[..., permutation] * sign, for scaled observations (rows, n) or (n,)."""
    reflected: Float32Array = s.take(mirror.observation_permutation, axis=-1)
    reflected *= mirror.observation_sign
    return reflected


def mirror_half(batch: Batch, mirror: Mirror) -> Batch:
    """Reflect every second row of a batch in place, and return it.

    Rows of the safe and of the collision buffer lie together in a batch, so this reflects half
    of each. Rewards stay: the road is as good in the mirror.
    """
    for s in (batch.s_t, batch.s_tp1):
        s[::2] = mirrored_observations(s[::2], mirror)
    batch.a_t[::2] = mirror.action_permutation[batch.a_t[::2]]
    return batch


class MirroredPolicy(GreedyPolicy):
    """argmax_a of Q(s, a) + Q(m(s), m(a)), with m the mirror: decides alike on both sides (ours).

    Where the road is as good in the mirror, both estimate the same value, and their sum has less
    of the network's error.
    """

    def __init__(self, network: QNetwork, mirror: Mirror) -> None:
        super().__init__(network)
        self._mirror = mirror

    def values(self, s_t: Float32Array) -> Float32Array:
        """The mean of both estimates: (observation_size,) -> (action_size,)."""
        values = super().values(s_t)
        reflected = super().values(mirrored_observations(s_t, self._mirror))
        values += reflected[self._mirror.action_permutation]
        values *= 0.5
        return values
