"""What is stored of a decision, and what is learned from it: Algorithm 1, lines 6 and 8 to 12."""

from drl_av.config import Config
from drl_av.driving.mirror import Mirror, mirrored_observations
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError
from drl_av.learning.replay import Batch, Buffer
from drl_av.road.road import Road


def store(decision: Transition, buffer: Buffer, r_col: float) -> None:
    """Store a decision as experience: Algorithm 1 of the paper, lines 6 and 8 to 12.

    Buf_C receives each proposal that the check replaced and each executed action that led to a
    collision, both as terminal transitions with reward ``r_col``. Buf_S receives all other executed
    actions. A missed exit counts as a collision (ours).
    """
    s_t, executed = decision.observation, decision.executed.number
    if decision.triggered:
        buffer.add_collision(s_t, decision.proposed.number, r_col)  # line 6
    if decision.failed:
        buffer.add_collision(s_t, executed, r_col)  # line 9
    else:
        buffer.add_safe(s_t, executed, decision.reward, decision.next_observation)  # line 11


def require_symmetry(config: Config, road: Road) -> None:
    """Raise ConfigError if ``learning.mirrored`` is set, but the reward is not symmetric.

    The reward is symmetric if exchanging left and right does not change it. It is not symmetric if
    y_des is fixed at another position than the middle of the road.
    """
    middle_m = road.center_m(len(road.open_lanes) - 1) / 2
    fixed = config.learning.mirrored and config.reward.desired == "fixed"
    if fixed and config.reward.desired_lateral_m != middle_m:
        raise ConfigError(
            f"reward.desired_lateral_m = {config.reward.desired_lateral_m:g} is not the middle of "
            f"the road, {middle_m:g} m: learn there with learning.mirrored = false."
        )


def mirror_half(batch: Batch, mirror: Mirror) -> Batch:
    """Exchange left and right in every second transition of a minibatch, in place; return it.

    The rows of the safe buffer precede those of the collision buffer, so half of each is mirrored.
    The rewards stay as they are, because the reward is symmetric.
    """
    for s in (batch.s_t, batch.s_tp1):
        s[::2] = mirrored_observations(s[::2], mirror)
    batch.a_t[::2] = mirror.action_permutation[batch.a_t[::2]]
    return batch
