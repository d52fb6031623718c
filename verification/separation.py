"""Smallest separation from the ego on straight paths, and the kind of collision, for many scenes.

The method differs from that of ``traffic/collisions.py``, so that each can check the other.
"""

import numpy as np

from drl_av.traffic.collisions import first_contact
from drl_av.traffic.road import FloatArray, Road
from drl_av.traffic.snapshot import Collision

Places = tuple[FloatArray, FloatArray]
"""Centres along and across the road; the last axis is of the ego and the others."""
STRAIGHT = Road(1e9, 1.0, (True,))
"""A road that is practically endless for a scene."""


def swept_separation(starts: Places, ends: Places, length_m: float, width_m: float) -> FloatArray:
    """The smallest separation from the ego on straight paths; shape (scenes, others).

    Separation is the larger of the gaps along and across the road, negative if bodies overlap. Over
    time it is the maximum of four linear functions, so that its minimum is at an intersection of
    two of them, or at the start or the end.
    """
    ahead_m, left_m = (at[:, 1:] - at[:, :1] for at in starts)
    forward_m, aside_m = (
        at[:, 1:] - at[:, :1] - start_m for at, start_m in zip(ends, (ahead_m, left_m), strict=True)
    )

    def at(time: FloatArray | float) -> FloatArray:
        lengthwise_m = np.abs(ahead_m + forward_m * time) - length_m
        sideways_m = np.abs(left_m + aside_m * time) - width_m
        result: FloatArray = np.maximum(lengthwise_m, sideways_m)
        return result

    least_m = np.minimum(at(0.0), at(1.0))
    lines = [(ahead_m, forward_m, 0.0), (left_m, aside_m, 0.0)]
    lines += [
        (ahead_m + sign * left_m, forward_m + sign * aside_m, offset_m)
        for sign in (1, -1)
        for offset_m in (length_m - width_m, width_m - length_m)
    ]
    for start_m, moved_m, end_m in lines:
        moves = moved_m != 0
        time = np.where(moves, end_m - start_m, 0.0) / np.where(moves, moved_m, 1.0)
        least_m = np.minimum(least_m, at(np.clip(time, 0.0, 1.0)))
    return least_m


def first_collision(starts: Places, ends: Places, length_m: float, width_m: float) -> Collision:
    """The ego's first collision in one scene in which it has one; arrays of shape (1 + others,)."""
    (x_m, y_m), (to_x_m, to_y_m) = starts, ends
    columns = (values.tolist() for values in (x_m, y_m, to_x_m - x_m, to_y_m - y_m))
    ego, *others = zip(*columns, strict=True)
    contacts = [
        (contact.time, row, contact.kind)
        for row, other in enumerate(others, 1)
        if (contact := first_contact(ego, other, length_m, width_m, STRAIGHT))
    ]
    _, row, kind = min(contacts, key=lambda found: found[:2])
    return Collision(kind, f"vehicle{row}")
