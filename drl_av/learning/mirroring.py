"""The road seen in a mirror: left and right swapped in observations and lateral actions."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drl_av.learning.buffers import Batch, FloatArray


class Mirror(Protocol):
    """Which indicator and which action each becomes in the mirror; ``driving`` holds the numbers.

    ``observation_permutation`` (n,) intp, ``observation_sign`` and ``observation_offset`` (n,)
    float32, ``action_permutation`` (actions,) int64.
    """

    @property
    def observation_permutation(self) -> NDArray[np.intp]: ...
    @property
    def observation_sign(self) -> FloatArray: ...
    @property
    def observation_offset(self) -> FloatArray: ...
    @property
    def action_permutation(self) -> NDArray[np.int64]: ...


def mirrored_observations(s: FloatArray, mirror: Mirror) -> FloatArray:
    """s[..., permutation] * sign + offset, for observations (rows, n) or (n,)."""
    reflected: FloatArray = s.take(mirror.observation_permutation, axis=-1)
    reflected *= mirror.observation_sign
    reflected += mirror.observation_offset
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
