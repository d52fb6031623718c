"""The mirror image of a scene: left and right exchanged in indicators and actions (ours)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.driving.actions import ACTIONS, Action, Lateral
from drl_av.driving.affordances import INDICATORS


class Mirror(NamedTuple):
    """The permutations and signs that exchange left and right."""

    observation_permutation: npt.NDArray[np.intp]
    """Shape (27,), or the size of the observation; exchanges indicators of right and left."""
    observation_sign: npt.NDArray[np.float32]
    """The same shape; -1 for every lateral indicator, which changes its sign, else 1."""
    action_permutation: npt.NDArray[np.int64]
    """Shape (12,); exchanges the actions to the right and left."""


def mirror_of(names: Sequence[str]) -> Mirror:
    """The mirror of an observation of the named indicators.

    Names with "right" and "left" change places. Lateral positions and velocities and the direction
    of a lane change change their signs.

    Raises:
        ValueError: an indicator of one side has none of the other side beside it.
    """
    swapped = (Lateral.KEEP, Lateral.LEFT, Lateral.RIGHT)
    return Mirror(
        np.array([list(names).index(_other_side(name)) for name in names]),
        np.array([-1 if name.endswith(_LATERAL) else 1 for name in names], dtype=np.float32),
        np.array([Action(swapped[lateral], how).number for lateral, how in ACTIONS]),
    )


_LATERAL = ("d_y", "v_y", "lane_change")
"""How the names of lateral indicators end."""


def _other_side(name: str) -> str:
    side = {"right": "left", "left": "right"}
    return "_".join(side.get(word, word) for word in name.split("_"))


MIRROR = mirror_of(INDICATORS)


def mirrored_observations(
    s: npt.NDArray[np.float32], mirror: Mirror = MIRROR
) -> npt.NDArray[np.float32]:
    """Mirror scaled observations, shape (rows, 27) or (27,): s[permutation] * sign."""
    reflected: npt.NDArray[np.float32] = s.take(mirror.observation_permutation, axis=-1)
    reflected *= mirror.observation_sign
    return reflected
