"""Learning from the road as a mirror shows it: left and right swapped (ours)."""

from drl_av.config import Config
from drl_av.driving.mirror import Mirror, mirrored_observations
from drl_av.errors import ConfigError
from drl_av.learning.buffers import Batch
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


def mirror_half(batch: Batch, mirror: Mirror) -> Batch:
    """Reflect every second row of a batch in place, and return it.

    Rows of the safe and of the collision buffer lie together in a batch, so this reflects half
    of each. Rewards stay: the road is as good in the mirror.
    """
    for s in (batch.s_t, batch.s_tp1):
        s[::2] = mirrored_observations(s[::2], mirror)
    batch.a_t[::2] = mirror.action_permutation[batch.a_t[::2]]
    return batch
