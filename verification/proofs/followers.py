"""Lemmas on the vehicle behind the ego in the lane that the ego's lane change enters."""

from collections.abc import Iterator
from fractions import Fraction
from math import ceil

import z3

from verification.proofs.argument import Argument
from verification.proofs.lane_changes import going, is_over, places
from verification.proofs.lateral import LINE
from verification.proofs.lemma import Claim, Lemma, Problem, Term
from verification.proofs.motion import (
    accelerated,
    ego_stops,
    follower_stops,
    must_reach,
    reach,
    speeds,
)


def response_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that the follower in the lane which the ego enters stays behind the ego.

    There are two claims for each start position and action with which the ego crosses the line
    within one decision, and two claims for each number of steps until the follower brakes. Together
    with the lemma ``hand-over`` they form an induction over the steps, so each claim has few cases.
    """
    longest = 0
    for y_m in places(a):
        path = going(y_m, 1, a.steps, a)
        over = next((step for step, at_m in enumerate(path, 1) if is_over(at_m, a)), None)
        if over is None:
            continue
        responds, crosses_s = over + a.response_steps, seconds_to_line(y_m, a)
        longest = max(longest, responds)
        for rate in a.rates_m_s2 if a.by_number else (-a.hard_m_s2,):
            yield crossing(a, rate, over, crosses_s)
            yield permitted(a, rate, responds, crosses_s + a.response_s)
    for left in range(1, longest + 1):
        yield rolling(a, left)
        yield farther(a, left)


def seconds_to_line(y_m: Fraction, a: Argument) -> Fraction:
    """Return the time until the ego's body is over the lane marking, s, as the check computes it.

    The time is 0 if the body does not reach the marking within this decision.
    """
    steps = ceil(((a.lane_m - a.width_m) / 2 + LINE - y_m) / (a.stride_m / a.steps))
    return (steps if 0 < steps <= a.steps else 0) * a.step_s


def pair(p: Problem, a: Argument) -> tuple[Term, Term, Term]:
    """Add an ego and a vehicle behind it to a problem; return both speeds and the gap."""
    gap_m = p.unknown("gap", 0)
    p.assume(gap_m > 0)
    ego = p.unknown("ego_speed", 0, a.most_m_s)
    return ego, p.unknown("follower_speed", 0, a.others_most_m_s), gap_m


def until_standstill(p: Problem, follower: Term, left: int, a: Argument) -> Term:
    """Return the longest distance that a vehicle behind can cover until it stands, m.

    The vehicle accelerates for ``left`` more SUMO steps, and then brakes as the check expects.
    """
    time_s = left * a.step_s
    faster = follower + a.acceleration_m_s2 * time_s
    return accelerated(follower, time_s, a) + follower_stops(p.largest, faster, a)


def permitted(a: Argument, rate: Fraction, responds: int, delay_s: Fraction) -> Claim:
    """Claim that the vehicle behind can stop behind the ego if the check permits the action.

    The vehicle brakes after ``responds`` steps; the check expects it to brake after ``delay_s``.
    The ego drives with the acceleration ``rate`` for the decision, and then brakes hard.
    """
    p = Problem()
    speed, follower, gap_m = pair(p, a)
    p.unknown("rate", rate, rate)
    reach_m = reach(p.largest, speed, rate, a.steps, a)
    p.assume(reach_m > must_reach(p.largest, gap_m, follower, delay_s, a))
    return p.follows(gap_m + reach_m > until_standstill(p, follower, responds, a))


def crossing(a: Argument, rate: Fraction, over: int, crosses_s: Fraction) -> Claim:
    """Claim that the vehicle behind does not touch the ego in the decision that crosses the line.

    The ego's body is over the line after ``over`` steps of the acceleration ``rate``. If the time
    ``crosses_s`` that the check computes for this is not 0, the check compares the distances at all
    steps.
    """
    p = Problem()
    speed, follower, gap_m = pair(p, a)
    p.unknown("rate", rate, rate)
    planned, ego, apart = speeds(p.largest, speed, rate, a.steps, a), speed, []
    for step in range(1, a.steps + 1):
        covered_m = sum(a.step_s * each for each in planned[1 : step + 1])
        p.assume(*[gap_m + covered_m > accelerated(follower, step * a.step_s, a)] * (crosses_s > 0))
    for step in range(1, a.steps + 1):
        ego = planned[step] if a.by_number else any_speed(p, ego, step, a)
        follower = any_faster(p, follower, step, a)
        apart += [gap_m > 0] if step >= over else []
        gap_m = gap_m + a.step_s * (ego - follower)
    return p.follows(*apart, gap_m > 0)


def rolling(a: Argument, left: int) -> Claim:
    """Claim that a vehicle which can stop within a distance still can after a step.

    After the step, the distance is shorter by what the vehicle drove in the step. The vehicle may
    accelerate for ``left`` more steps, including this one, and then brakes.
    """
    p = Problem()
    follower, distance_m = p.unknown("follower_speed", 0, a.others_most_m_s), p.unknown("distance")
    p.assume(distance_m > until_standstill(p, follower, left, a))
    after = any_faster(p, follower, 1, a) if left else braked(p, follower, a)
    return p.follows(
        distance_m - a.step_s * after > until_standstill(p, after, max(left - 1, 0), a)
    )


def farther(a: Argument, left: int) -> Claim:
    """Claim that a vehicle behind, if at least as fast as the ego, needs no less distance to stop.

    The vehicle accelerates for ``left`` more steps and then brakes; the ego brakes hard.
    """
    p = Problem()
    ego, follower, _ = pair(p, a)
    p.assume(follower >= ego)
    return p.follows(until_standstill(p, follower, left, a) >= ego_stops(p.largest, ego, a))


def slowing(a: Argument) -> Claim:
    """Claim that the ego's distance to standstill is shortest if it brakes hard.

    If the ego does anything else in one step and then brakes hard, the distance is no shorter.
    """
    p = Problem()
    ego = p.unknown("ego_speed", 0, a.most_m_s)
    after = any_speed(p, ego, 1, a)
    rolled_m = a.step_s * after + ego_stops(p.largest, after, a)
    return p.follows(rolled_m >= ego_stops(p.largest, ego, a))


def waiting(a: Argument) -> Claim:
    """Claim that the gap stays positive in a step, whether the vehicle behind brakes or not.

    About the distances to standstill of the two vehicles, the claim assumes only what the claims
    ``rolling``, ``farther`` and ``slowing`` state. It therefore holds at each step.
    """
    p = Problem()
    names = ("ego_stopping", "ego_stopping_then", "follower_stopping", "follower_stopping_then")
    ego_m, ego_then_m, follower_m, then_m = (p.unknown(name, 0) for name in names)
    ego, follower, gap_m = (p.unknown(name, 0) for name in ("ego_speed", "follower_speed", "gap"))
    p.assume(gap_m > 0, gap_m + ego_m > follower_m)
    p.assume(follower_m >= a.step_s * follower + then_m, ego_m <= a.step_s * ego + ego_then_m)
    p.assume(z3.Implies(follower >= ego, then_m >= ego_then_m))
    gap_m = gap_m + a.step_s * (ego - follower)
    return p.follows(gap_m > 0, gap_m + ego_then_m > then_m)


def any_speed(p: Problem, before: Term, step: int, a: Argument) -> Term:
    """Add and return the ego's speed after a step: any that needs at most hard braking."""
    speed = p.unknown(f"ego_speed_{step}", 0, a.most_m_s)
    p.assume(speed >= before - a.hard_m_s2 * a.step_s)
    return speed


def any_faster(p: Problem, before: Term, step: int, a: Argument) -> Term:
    """Add and return the speed, after a step, of a vehicle behind that does not respond to the ego.

    Any speed is possible that the vehicle reaches with at most its highest acceleration.
    """
    speed = p.unknown(f"follower_speed_{step}", 0, a.others_most_m_s)
    p.assume(speed <= before + a.acceleration_m_s2 * a.step_s)
    return speed


def braked(p: Problem, before: Term, a: Argument) -> Term:
    """Return the speed of a vehicle behind after a step of braking by bound 4 of ``strict``."""
    return p.largest([before - a.follower_m_s2 * a.step_s, 0 * before])


def follower_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claims that a follower which brakes stays behind, whatever the ego does."""
    yield rolling(a, 0)
    yield farther(a, 0)
    yield slowing(a)
    yield waiting(a)


LEMMAS = (
    Lemma(
        "response",
        "A vehicle behind the ego, in the lane that a permitted lane change enters, does not touch "
        "the ego before it brakes for it, and can then stop behind it.",
        response_claims,
    ),
    Lemma(
        "hand-over",
        "From then on, this vehicle stays behind the ego if it brakes by bound 4, whatever the "
        "ego does.",
        follower_claims,
    ),
)
