"""Lines of straight pieces, along which sumo-gui draws the edges of a road."""

import math
from collections.abc import Iterable, Sequence

from drl_av.traffic.kind import Point

ROUNDING_M = 0.001
"""Difference of lengths that is ignored, so that a line of the wanted length is left as it is."""


def straight_on(shape: Sequence[Point], length_m: float) -> tuple[Point, Point]:
    """Return begin and end of a straight line of ``length_m`` metres that continues a shape."""
    last = shape[-1]
    before = next((point for point in reversed(shape) if point != last), (last[0] - 1.0, last[1]))
    scale = length_m / math.dist(before, last)
    further = tuple(end + scale * (end - begin) for begin, end in zip(before, last, strict=True))
    return last, (further[0], further[1])


def along(points: Iterable[Point], length_m: float) -> tuple[Point, ...]:
    """Return a line of ``length_m`` metres along the points; it goes straight on after the last."""
    first, *others = points
    line, left_m = [first], length_m
    for point in others:
        piece_m = math.dist(line[-1], point)
        if abs(piece_m - left_m) < ROUNDING_M:
            return (*line, point)
        if piece_m > left_m:
            share = left_m / piece_m
            x_m, y_m = (a + share * (b - a) for a, b in zip(line[-1], point, strict=True))
            return (*line, (x_m, y_m))
        if piece_m > 0.0:
            line.append(point)
            left_m -= piece_m
    return (*line, straight_on(line, left_m)[1])
