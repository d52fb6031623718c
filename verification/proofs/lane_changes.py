"""Lemmas on the ego's lateral motion: its corridor, and the abort of a lane change."""

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import product
from math import ceil
from typing import NamedTuple

import z3

from verification.proofs.argument import Argument
from verification.proofs.lateral import (
    LINE,
    ON_LINE,
    corridor,
    extent,
    lanes_under,
    lies_in,
    next_position,
)
from verification.proofs.lemma import Claim, Lemma, Problem, Term

SIDES = (-1, 1)


class Way(NamedTuple):
    """A case of the lemmas: an ego anywhere between lane 0 and a neighbouring lane."""

    p: Problem
    y_m: Term
    side: int
    """Side of lane 0 on which the neighbouring lane is: left +1, right -1."""
    end: int
    """The lane in which the lane change ends."""
    sign: int
    """Direction of the lane change: left +1, right -1."""
    back: int
    """The lane in which a fallback maneuver that begins at the next decision ends."""
    after_m: Term
    """The ego's lateral position at the next decision."""


def ways(a: Argument) -> Iterator[Way]:
    """Yield all cases: each side, each end of the lane change, and each end of the fallback."""
    for side in SIDES:
        for end in (0, side):
            for back in (0, side):
                p, sign = Problem(), side if end else -side
                y_m = p.unknown("y", min(0, side) * a.lane_m, max(0, side) * a.lane_m)
                after_m = next_position(p, y_m, end, sign, a)
                p.assume(lies_in(after_m, back, a))
                yield Way(p, y_m, side, end, sign, back, after_m)


def between(start_m: Term, y_m: Term, end_m: Term) -> Term:
    """Return the fact that ``y_m`` lies between two other positions, or on one of them."""
    return z3.Or(z3.And(start_m <= y_m, y_m <= end_m), z3.And(end_m <= y_m, y_m <= start_m))


def corridor_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that the ego stays in its corridor, and touches no vehicle outside it.

    The claims cover the decision and the fallback maneuver after it.
    """
    for other_width_m, toward in product(a.widths_m, (-1, 0, 1)):
        other, apart_m = replace(a, width_m=other_width_m), (a.width_m + other_width_m) / 2
        for p, y_m, _, end, sign, back, after_m in ways(a):
            later_m, other_m, at_m = (p.unknown(n) for n in ("y_later", "other_y", "other_y_later"))
            on_fallback = between(after_m, later_m, back * a.lane_m)
            p.assume(z3.Or(between(y_m, later_m, after_m), on_fallback))
            way, theirs = corridor(p, y_m, end, sign, a), extent(p, other_m, toward, other)
            p.assume(z3.Not(z3.And(theirs.left_m > way.right_m, theirs.right_m < way.left_m)))
            p.assume(at_m - other_width_m / 2 >= theirs.right_m)
            p.assume(at_m + other_width_m / 2 <= theirs.left_m)
            yield p.follows(
                later_m - a.width_m / 2 >= way.right_m,
                later_m + a.width_m / 2 <= way.left_m,
                z3.Or(at_m - later_m >= apart_m, later_m - at_m >= apart_m),
            )


def fallback_corridor_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that the fallback's corridor at the next decision is within this corridor.

    At the next decision the lane change is still in progress, or completed.
    """
    for p, y_m, side, end, sign, back, after_m in ways(a):
        way = corridor(p, y_m, end, sign, a)
        then = corridor(p, after_m, back, side if back else -side, a)
        yield p.follows(then.right_m >= way.right_m, then.left_m <= way.left_m)
        if back == end:
            p.assume(after_m == end * a.lane_m)
            then = extent(p, after_m, 0, a)
            yield p.follows(then.right_m >= way.right_m, then.left_m <= way.left_m)


def own_lane_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that the ego's body overlaps the lane that contains its centre.

    If the centre is on the marking between two lanes, both lanes contain it.
    """
    for lane in (-1, 0, 1):
        p = Problem()
        y_m = p.unknown("y", -a.lane_m, a.lane_m)
        p.assume(lies_in(y_m, lane, a))
        lowest, highest = lanes_under(p, y_m, a)
        yield p.follows(lowest <= lane, lane <= highest)


def places(a: Argument) -> list[Fraction]:
    """Return the ego's lateral positions at decisions of a lane change from lane 0 to lane 1.

    They are those at which the ego's body is still within lane 0. The ego reaches each of them in a
    whole number of decisions from the centre of lane 0 or, after an abort, of lane 1.
    """
    seconds = range(ceil(a.lane_m / a.stride_m))
    found = {k * a.stride_m for k in seconds} | {a.lane_m - k * a.stride_m for k in seconds}
    return sorted(y_m for y_m in found if y_m >= 0 and not is_over(y_m, a))


def is_over(y_m: Fraction, a: Argument) -> bool:
    """Return whether the ego's body is over the lane marking between lanes 0 and 1."""
    return y_m + a.width_m / 2 - LINE > a.lane_m / 2


def going(y_m: Fraction, lane: int, steps: int | None, a: Argument) -> list[Fraction]:
    """Return the lateral positions after each SUMO step on the way from ``y_m`` to a lane's centre.

    The result ends after ``steps`` steps; if ``steps`` is None, it ends at the centre.
    """
    found, end_m, stride_m = [y_m], lane * a.lane_m, a.stride_m / a.steps
    while found[-1] != end_m and (steps is None or len(found) <= steps):
        left_m = end_m - found[-1]
        found.append(found[-1] + max(min(left_m, stride_m), -stride_m))
    return found[1:]


def entering_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims on a vehicle that enters the ego's target lane, lane 1, from lane 2.

    There is one claim for each position of the ego at which bound 3 of ``strict`` still permits the
    vehicle to enter. The vehicle moves at most to the centre of lane 1.
    """
    for start_m in places(a):
        seen = going(start_m, 1, a.abort_decisions * a.steps, a)
        for back in (0, 1):
            if abs(seen[-1] - back * a.lane_m) <= a.lane_m / 2 + ON_LINE:
                path = [*seen, *going(seen[-1], back, None, a)]
                yield from (entered(a, start_m, path, width_m) for width_m in a.widths_m)


def entered(a: Argument, start_m: Fraction, path: list[Fraction], width_m: Fraction) -> Claim:
    """Claim that the ego does not touch a vehicle of width ``width_m`` that enters lane 1.

    The ego moves along ``path``, its lateral positions after each step, to the end of the path. The
    vehicle begins to move at the start of the decision, when the ego is at ``start_m``.
    """
    p = Problem()
    y_m, other_m = p.unknown("y", start_m, start_m), p.unknown("other_y", a.lane_m)
    theirs, way = extent(p, other_m, 0, replace(a, width_m=width_m)), corridor(p, y_m, 1, 1, a)
    p.assume(theirs.right_m >= way.left_m + a.lateral_m_s * a.decision_s)
    apart, apart_m = [], (a.width_m + width_m) / 2
    for step, ego_m in enumerate(path, 1):
        before_m, other_m = other_m, p.unknown(f"other_y_{step}", a.lane_m)
        p.assume(other_m >= before_m - a.lateral_m_s * a.step_s)
        apart.append(other_m - ego_m >= apart_m)
    last_m = p.unknown("other_y_at_last", a.lane_m if a.lateral_m_s else other_m)
    return p.follows(*apart, last_m - path[-1] >= apart_m)


LEMMAS = (
    Lemma(
        "corridor",
        "The ego's body stays in its corridor, in the decision and on the fallback after it, and "
        "touches no vehicle that stays outside the corridor.",
        corridor_claims,
    ),
    Lemma(
        "next-corridor",
        "The corridor of the fallback at the next decision is within the corridor at this one.",
        fallback_corridor_claims,
    ),
    Lemma(
        "own-lane", "The ego's body overlaps the lane in which the fallback ends.", own_lane_claims
    ),
    Lemma(
        "abort",
        "The ego does not touch a vehicle that enters its target lane from the other side, at any "
        "second of the lane change, if it begins the fallback at the next decision.",
        entering_claims,
    ),
)
