"""Learning from the road as a mirror shows it: left and right swapped."""

from drl_av.driving.mirror import Mirror
from drl_av.learning.buffers import Batch, Float32Array


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
