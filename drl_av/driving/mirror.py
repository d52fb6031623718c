"""The mirror image of a scene: left and right exchanged in indicators and actions (ours)."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import ACTIONS, Action, Lateral


class Mirror(NamedTuple):
    """The permutations and signs that exchange left and right."""

    observation_permutation: npt.NDArray[np.intp]
    """Shape (27,); exchanges the indicators of the right and left lane."""
    observation_sign: npt.NDArray[np.float32]
    """Shape (27,); -1 for every lateral indicator, which changes its sign, else 1."""
    action_permutation: npt.NDArray[np.int64]
    """Shape (12,); exchanges the actions to the right and left."""


def _mirror() -> Mirror:
    order = [0, 1, 4, 5, 2, 3]
    swapped = (Lateral.KEEP, Lateral.LEFT, Lateral.RIGHT)
    return Mirror(
        np.array([4 * slot + state for slot in order for state in range(4)] + [24, 25, 26]),
        np.array([1, 1, -1, -1] * 6 + [1, -1, -1], dtype=np.float32),
        np.array([Action(swapped[lateral], how).number for lateral, how in ACTIONS]),
    )


MIRROR = _mirror()


def mirrored_observations(
    s: npt.NDArray[np.float32], mirror: Mirror = MIRROR
) -> npt.NDArray[np.float32]:
    """Mirror scaled observations, shape (rows, 27) or (27,): s[permutation] * sign."""
    reflected: npt.NDArray[np.float32] = s.take(mirror.observation_permutation, axis=-1)
    reflected *= mirror.observation_sign
    return reflected
