"""Lemmas on the vehicle ahead: the ego follows it, it cuts in, or it is the end of a lane.

All lemmas use the lemma ``following`` on a single SUMO step. This lemma assumes a distance within
which the ego can complete the step and then brake hard to standstill. The lemma ``decision`` shows
that at each step of a decision the rest of the ego's ``reach`` is such a distance. The proof
therefore holds for any number of steps and decisions.
"""

from collections.abc import Iterator

import z3

from drl_av.driving.actions import Longitudinal
from verification.proofs.argument import Argument
from verification.proofs.lemma import Claim, Lemma, Problem, Term
from verification.proofs.motion import (
    cut_in_gap,
    ego_stops,
    lead_stops,
    lines,
    reach,
    speeds,
    stopping,
)


def stopping_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that ``stopping_distance`` computes the stopping distance.

    ``stopping_distance`` selects one of the linear pieces of ``motion.lines`` by rounding down. A
    claim says that this piece is the largest at the given speed, and that it equals the distance
    of one braking step plus the stopping distance after this step. There is one claim for each
    braking rate.
    """
    brakes = [(a.hard_m_s2, a.most_m_s), (a.braking_m_s2, a.others_most_m_s)]
    for braking, most in [*brakes, (a.follower_m_s2, a.others_most_m_s)]:
        p, pace = Problem(), braking * a.step_s
        speed, picked_m = p.unknown("speed", 0, most), p.unknown("picked")
        pieces = [
            z3.And(k * pace <= speed, speed < (k + 1) * pace, picked_m == line(speed))
            for k, line in enumerate(lines(braking, most, a.step_s))
        ]
        p.assume(z3.Or(pieces))
        after = p.largest([speed - pace, 0])
        rolled_m = a.step_s * after + stopping(p.largest, after, braking, most, a.step_s)
        whole_m = stopping(p.largest, speed, braking, most, a.step_s)
        yield p.follows(picked_m == whole_m, picked_m == rolled_m)


def following(p: Problem, a: Argument, stands: bool = False) -> tuple[Term, ...]:
    """Add an ego and a vehicle ahead of it to the problem ``p``, as unknowns of one SUMO step.

    If ``stands`` is true, the vehicle ahead stands still before and after the step.

    Returns:
        The ego's speed in the step, m/s; the gap before the step, m; and the speeds of the vehicle
        ahead before and after the step, m/s.
    """
    ego, gap_m = p.unknown("ego_speed", 0, a.most_m_s), p.unknown("gap", 0)
    most = 0 if stands else a.others_most_m_s
    other, after = p.unknown("other_speed", 0, most), p.unknown("other_speed_after", 0, most)
    p.assume(gap_m > 0, after >= other - a.lead_braking_m_s2 * a.step_s)
    return ego, gap_m, other, after


def step_claims(a: Argument, stands: bool = False) -> Iterator[Claim]:
    """Yield the claims that an ego which can stop behind the vehicle ahead keeps this ability.

    The claims are about one SUMO step. They assume that the ego can complete the step at its speed
    and then brake hard to standstill behind the vehicle ahead. They state that the ego does not
    touch this vehicle within the step, and that it can still stop behind this vehicle afterwards.
    If ``stands`` is true, the vehicle ahead stands still.
    """
    p = Problem()
    ego, gap_m, other, after = following(p, a, stands)
    distance_m, clearance_m = p.unknown("distance"), p.unknown("clearance")
    p.assume(clearance_m >= min(a.clearance_m, 0), clearance_m <= a.clearance_m)
    p.assume(a.step_s * ego + ego_stops(p.largest, ego, a) <= distance_m)
    p.assume(distance_m < gap_m + lead_stops(p.largest, other, a) - clearance_m)
    gap_after_m = gap_m + a.step_s * (after - ego)
    left_m = distance_m - a.step_s * ego
    rest_m = gap_after_m + lead_stops(p.largest, after, a)
    yield p.follows(gap_after_m > 0, left_m < rest_m - clearance_m)
    yield between()


def between() -> Claim:
    """Claim that a gap that is positive before and after a step is positive within it.

    The gap changes at a constant rate within the step.
    """
    p = Problem()
    before_m, after_m = p.unknown("before"), p.unknown("after")
    part = p.unknown("part", 0, 1)
    p.assume(before_m > 0, after_m > 0)
    return p.follows(before_m + part * (after_m - before_m) > 0)


def decision_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that the ego can stop within its reach at each step of a decision.

    There is one claim for each longitudinal action and SUMO step. In the step the ego drives at
    most at the planned speed, and then it brakes hard to standstill. The claim says that the
    distance which it covers is at most the rest of the reach before the step.
    """
    for rate in a.rates_m_s2:
        for step in range(a.steps):
            p = Problem()
            planned = speeds(p.largest, p.unknown("speed", 0, a.most_m_s), rate, a.steps, a)
            ends_m = ego_stops(p.largest, planned[-1], a)
            left_m = sum(a.step_s * each for each in planned[step + 1 :]) + ends_m
            rolled = p.unknown("speed_after", 0, a.most_m_s)
            p.assume(rolled <= planned[step + 1])
            yield p.follows(a.step_s * rolled + ego_stops(p.largest, rolled, a) <= left_m)


def fallback_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claim that the reach of the action hard brake is the ego's stopping distance."""
    p = Problem()
    speed = p.unknown("ego_speed", 0, a.most_m_s)
    hard = a.rates_m_s2[Longitudinal.HARD_BRAKE]
    yield p.follows(reach(p.largest, speed, hard, a.steps, a) == ego_stops(p.largest, speed, a))


def cut_in_claims(a: Argument) -> Iterator[Claim]:
    """Yield one claim for each action and each step at which a vehicle begins to cut in.

    The claim says that the rest of the ego's reach ends behind the vehicle that cuts in. With a
    car-following model, the acceleration before the cut-in may be any up to that of the action.
    """
    for planned in a.rates_m_s2:
        for steps in range(a.steps + 1 if a.by_number else a.steps):
            p = Problem()
            ego, gap_m = p.unknown("ego_speed", 0, a.most_m_s), p.unknown("gap")
            other_m = p.unknown("other_stopping", 0)
            rate = p.unknown("rate", planned if a.by_number else -a.hard_m_s2, planned)
            p.assume(gap_m > cut_in_gap(p.largest, ego, rate, other_m, a))
            rolled_m = reach(p.largest, ego, planned, steps, a)
            yield p.follows(gap_m > 0, rolled_m < gap_m + other_m - a.clearance_m)


def between_two_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claim on a vehicle A that cuts in ahead of a vehicle B, which the ego follows.

    If B can stop behind A, the ego can also stop behind A.
    """
    p = Problem()
    gap_m, beyond_m, length_m = p.unknown("gap", 0), p.unknown("beyond"), p.unknown("length", 0)
    other_m, entering_m = p.unknown("other_stopping", 0), p.unknown("entering_stopping", 0)
    distance_m = p.unknown("distance")
    p.assume(gap_m > 0, distance_m < gap_m + other_m - a.clearance_m)
    p.assume(beyond_m > p.largest([other_m - entering_m, 0 * other_m]) + a.clearance_m)
    whole_m = gap_m + length_m + beyond_m
    yield p.follows(whole_m > 0, distance_m < whole_m + entering_m - a.clearance_m)


def lane_end_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that the ego stops before the end of its lane.

    The end counts as a vehicle that stands there. The claims are those of ``step_claims`` for a
    standing vehicle, and the claim that an ego at rest keeps its clearance.
    """
    yield from step_claims(a, stands=True)
    p = Problem()
    _, gap_m, _, _ = following(p, a, stands=True)
    p.assume(ego_stops(p.largest, p.unknown("standing", 0, 0), a) < gap_m - a.clearance_m)
    yield p.follows(gap_m > a.clearance_m)


LEMMAS = (
    Lemma(
        "stopping",
        "stopping_distance is the largest of its linear pieces, and equals the distance that a "
        "vehicle covers if it brakes step by step until standstill.",
        stopping_claims,
    ),
    Lemma(
        "following",
        "If the ego can stop behind the vehicle ahead before a step, it does not touch that "
        "vehicle in the step and can stop behind it afterwards, however the vehicle drives.",
        step_claims,
    ),
    Lemma(
        "decision",
        "At each step of a decision, the ego can complete the step and then brake hard within the "
        "rest of its reach.",
        decision_claims,
    ),
    Lemma(
        "fallback", "If the fallback maneuver is free, hard braking is permitted.", fallback_claims
    ),
    Lemma(
        "cut-in",
        "If a vehicle leaves more than cut_in_gap when it begins to cut in, at any step of a "
        "decision, the ego can stop behind it within the rest of its reach.",
        cut_in_claims,
    ),
    Lemma(
        "cut-in-beyond",
        "If the vehicle that the ego follows can stop behind a vehicle that cuts in, the ego can "
        "too.",
        between_two_claims,
    ),
    Lemma(
        "lane-end",
        "The ego stops before the end of its lane, which counts as a vehicle that stands there.",
        lane_end_claims,
    ),
)
