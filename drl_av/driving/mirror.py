"""The mirror image of an observation and of an action: left and right are exchanged (ours)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.arrays import Float32Array, IntArray
from drl_av.driving.actions import ACTIONS, Action, Lateral
from drl_av.driving.affordances import INDICATORS


class Mirror(NamedTuple):
    """Permutations and signs that exchange left and right in observations and actions."""

    observation_permutation: npt.NDArray[np.intp]
    """For each indicator, the index of its mirror image; shape (27,) by default."""
    observation_sign: Float32Array
    """Of the same shape: -1 for each indicator whose sign changes, 1 for all others."""
    action_permutation: IntArray
    """For each action number, the number of the mirrored action; shape (12,)."""


def mirror_of(names: Sequence[str]) -> Mirror:
    """Return the mirror of an observation that consists of the named indicators.

    The words "right" and "left" in the names are exchanged. Lateral positions, lateral velocities,
    ``lane_change`` and ``way_changes`` get the opposite sign.

    Raises:
        ValueError: an indicator of one side is present without that of the other side.
    """
    swapped = (Lateral.KEEP, Lateral.LEFT, Lateral.RIGHT)
    return Mirror(
        np.array([list(names).index(_other_side(name)) for name in names]),
        np.array([-1 if name.endswith(_LATERAL) else 1 for name in names], dtype=np.float32),
        np.array([Action(swapped[lateral], how).number for lateral, how in ACTIONS]),
    )


_LATERAL = ("d_y", "v_y", "lane_change", "lane_change_rest", "way_changes")
"""The endings of the names of lateral indicators."""


def _other_side(name: str) -> str:
    """Return the name of an indicator with "right" and "left" exchanged."""
    side = {"right": "left", "left": "right"}
    return "_".join(side.get(word, word) for word in name.split("_"))


MIRROR = mirror_of(INDICATORS)


def mirrored_observations(s: Float32Array, mirror: Mirror = MIRROR) -> Float32Array:
    """Return the mirror images of scaled observations of shape (rows, 27) or (27,), as a copy."""
    reflected: Float32Array = s.take(mirror.observation_permutation, axis=-1)
    reflected *= mirror.observation_sign
    return reflected
