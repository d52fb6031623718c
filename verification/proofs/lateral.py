"""Models lanes and lateral positions as ``drl_av/safety/reachability.py`` does, for Z3.

Lateral positions are in metres, left positive, from the centre of lane 0. The functions add facts
about rounded numbers to the problem ``p``.
"""

from typing import NamedTuple

import z3

from drl_av.road.road import ARRIVED_M
from drl_av.safety.reachability import LINE_M, ON_LINE_M
from verification.proofs.argument import Argument, exact
from verification.proofs.lemma import Problem, Term

LINE, ON_LINE, CENTERED = exact(LINE_M), exact(ON_LINE_M), exact(ARRIVED_M)


class Span(NamedTuple):
    """A range of lateral positions."""

    right_m: Term
    left_m: Term


def lanes_under(p: Problem, y_m: Term, a: Argument) -> tuple[Term, Term]:
    """Return the rightmost and the leftmost lane that a body centred at ``y_m`` overlaps."""
    right_m, left_m = y_m - a.width_m / 2 + LINE, y_m + a.width_m / 2 - LINE
    half = z3.Q(1, 2)
    return p.floor(right_m / a.lane_m + half), p.ceil(left_m / a.lane_m - half)


def lanes_about(p: Problem, y_m: Term, a: Argument) -> tuple[Term, Term]:
    """Return the rightmost and the leftmost lane that contain a position.

    The lanes differ only if the position is on the marking between two lanes.
    """
    half = z3.Q(1, 2)
    right, left = (y_m - ON_LINE) / a.lane_m, (y_m + ON_LINE) / a.lane_m
    return p.floor(right + half), p.floor(left + half)


def lies_in(y_m: Term, lane: int, a: Argument) -> Term:
    """Return the fact that a position lies in a lane or on one of its markings."""
    aside_m = y_m - lane * a.lane_m
    return z3.And(aside_m <= a.lane_m / 2 + ON_LINE, aside_m >= -a.lane_m / 2 - ON_LINE)


def next_position(p: Problem, y_m: Term, end: int, sign: int, a: Argument) -> Term:
    """Return the ego's lateral position one decision later in a lane change.

    ``sign`` is the direction of the lane change, left +1, right -1; ``end`` is the lane in which it
    ends.
    """
    return y_m + sign * p.smallest([sign * (end * a.lane_m - y_m), a.stride_m + 0 * y_m])


def corridor(p: Problem, y_m: Term, end: int, sign: int, a: Argument) -> Span:
    """Return the lateral range that the ego's body may use in a lane change.

    ``drl_av.safety.reachability.corridor`` computes the same range. The ego is at ``y_m`` and moves
    in the direction ``sign``, left +1, right -1, to the centre of the lane ``end``.
    """
    after_m = next_position(p, y_m, end, sign, a)
    lanes = [*lanes_under(p, y_m, a), *lanes_about(p, after_m, a)]
    places = [y_m, end * a.lane_m + 0 * y_m, *(a.lane_m * lane for lane in lanes)]
    return Span(p.smallest(places) - a.width_m / 2, p.largest(places) + a.width_m / 2)


def extent(p: Problem, y_m: Term, toward: int, a: Argument) -> Span:
    """Return the lateral range that another vehicle's body may occupy.

    ``drl_av.safety.reachability.lateral_extent`` computes the same range. ``toward`` is the sign of
    the vehicle's lateral speed: left +1, right -1, none 0.
    """
    lowest, highest = lanes_under(p, y_m, a)
    below, above = p.floor(y_m / a.lane_m), p.ceil(y_m / a.lane_m)
    off_m = p.smallest([y_m - below * a.lane_m, above * a.lane_m - y_m])
    if toward < 0:
        lowest = z3.If(off_m > CENTERED, p.smallest([lowest, below]), lowest)
    if toward > 0:
        highest = z3.If(off_m > CENTERED, p.largest([highest, above]), highest)
    right_m, left_m = p.smallest([lowest * a.lane_m, y_m]), p.largest([highest * a.lane_m, y_m])
    return Span(right_m - a.width_m / 2, left_m + a.width_m / 2)
