"""The speed at which the curves of a route can be driven; pure geometry (ours)."""

import math
from collections.abc import Sequence

import numpy as np

from drl_av.road.road import SpeedLimit
from drl_av.scenarios.layout import Point

Line = Sequence[tuple[float, Point]]
"""Points along the middle of a lane, with their positions along the route, metres."""
Span = tuple[float, float]
"""A begin and an end, positions along the route, metres."""
SPACING_M = 4.0
"""Distance of the places at which the curvature of a route is computed."""
CHORDS_M = (36.0, 72.0)
"""Lengths of the two chords whose directions are compared at a place. So long chords even out how a
map draws a curve by corners, and how SUMO draws a lane that moves sideways in a junction."""
STRAIGHT_RAD = math.radians(20.0)
"""Changes of direction up to this angle between two chords do not count: maps have such corners."""
ALIKE = 1.15
"""A curve extends to where its speed is this factor above that of its sharpest place."""


def curve_limits(
    line: Line, sideways_m_s2: float, fastest_m_s: float, span: Span
) -> list[SpeedLimit]:
    """Return the curves of a route that are too sharp for ``fastest_m_s``, each with its speed.

    In a curve of radius R the speed is at most sqrt(a R), where a is ``sideways_m_s2``. R is the
    length of two chords, one behind a place and one ahead of it, divided by the angle between them.
    The chords lie within ``span``; each end keeps the limit of the last place with two such chords.
    """
    sharp: dict[int, float] = {}
    for chord_m in CHORDS_M:
        for place, radius_m in _radii_m(line, chord_m, span).items():
            limit_m_s = math.sqrt(sideways_m_s2 * radius_m)
            if limit_m_s < min(fastest_m_s, sharp.get(place, math.inf)):
                sharp[place] = limit_m_s
    found = []
    while sharp:
        sharpest = min(sharp, key=lambda place: (sharp[place], place))
        limit_m_s, ends = sharp[sharpest], []
        for side in (-1, 1):
            place = sharpest
            while sharp.get(place + side, math.inf) <= ALIKE * limit_m_s:
                place += side
            ends.append(place)
            while sharp.get(place, math.inf) <= sharp.get(place + side, -math.inf):
                place += side
                del sharp[place]
        for place in range(ends[0], ends[1] + 1):
            del sharp[place]
        begin_m = max(SPACING_M * (ends[0] - 0.5), 0.0)
        found.append(SpeedLimit(begin_m, SPACING_M * (ends[1] + 0.5), limit_m_s))
    return _adjoining(sorted(found))


def _adjoining(curves: Sequence[SpeedLimit]) -> list[SpeedLimit]:
    """Extend, of two curves that nearly meet, the gentler one to the other."""
    found = [*curves[:1]]
    for curve in curves[1:]:
        before, begin_m = found[-1], curve.begin_m
        if begin_m - before.end_m < CHORDS_M[0]:
            if before.limit_m_s > curve.limit_m_s:
                found[-1] = before._replace(end_m=begin_m)
            else:
                begin_m = before.end_m
        found.append(curve._replace(begin_m=begin_m))
    return found


def _radii_m(line: Line, chord_m: float, span: Span) -> dict[int, float]:
    """Return the radius at each place of a line in ``span`` that is not nearly straight, metres.

    The key is the position along the route divided by ``SPACING_M``.
    """
    positions_m, points = zip(*line, strict=True)
    first_m, last_m = max(positions_m[0], span[0]), min(positions_m[-1], span[1])
    first = math.ceil((first_m + chord_m) / SPACING_M)
    last = math.floor((last_m - chord_m) / SPACING_M)
    if first > last:
        return {}
    places = np.arange(first_m // SPACING_M, positions_m[-1] // SPACING_M + 2, dtype=int)
    behind, here, ahead = (
        np.interp(
            np.clip(places, first, last) * SPACING_M + way_m,
            positions_m,
            [complex(*point) for point in points],
        )
        for way_m in (-chord_m, 0.0, chord_m)
    )
    turned = np.abs(np.angle((ahead - here) * np.conj(here - behind)))
    sharp = turned > STRAIGHT_RAD
    return dict(zip(places[sharp].tolist(), (chord_m / turned[sharp]).tolist(), strict=True))
