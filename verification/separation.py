"""Computes the smallest separation from the ego on straight paths, for many scenes.

The method differs from that of ``road/sweep.py``, so a test can compare the two.
"""

from collections.abc import Sequence

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.road.road import Barrier

Places = tuple[FloatArray, FloatArray]
"""The pair (x, y): the centres along and across the road, m. The last axis is the vehicle, the ego
first."""


def swept_separation(starts: Places, ends: Places, length_m: float, width_m: float) -> FloatArray:
    """Return the smallest separation of each vehicle from the ego, m, shape (scenes, others).

    All vehicles move on straight paths from ``starts`` to ``ends``. The separation is the larger of
    the gaps along and across the road; it is negative if the bodies overlap. As a function of time
    it is the maximum of four linear functions. Its minimum is therefore at the start, at the end,
    or where two of these functions intersect.
    """
    ahead_m, left_m = (at[:, 1:] - at[:, :1] for at in starts)
    forward_m, aside_m = (
        at[:, 1:] - at[:, :1] - start_m for at, start_m in zip(ends, (ahead_m, left_m), strict=True)
    )

    def at(time: FloatArray | float) -> FloatArray:
        lengthwise_m = np.abs(ahead_m + forward_m * time) - length_m
        sideways_m = np.abs(left_m + aside_m * time) - width_m
        return np.maximum(lengthwise_m, sideways_m)

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


def barrier_separation(
    barriers: Sequence[Barrier], places: Places, length_m: float, width_m: float
) -> FloatArray:
    """Return the separation of each barrier from the ego at these places, (scenes, barriers), m."""
    (s_m, right_m, left_m), (x_m, y_m) = np.array(barriers).reshape(-1, 3).T, places
    lengthwise_m = np.abs(s_m - x_m[:, :1]) - length_m / 2
    sideways_m = np.maximum(right_m - y_m[:, :1], y_m[:, :1] - left_m) - width_m / 2
    result: FloatArray = np.maximum(lengthwise_m, sideways_m)
    return result
