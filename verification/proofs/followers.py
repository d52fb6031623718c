"""Lemmas on the vehicle behind the ego in the lane that the ego's lane change enters."""

from collections.abc import Iterator
from fractions import Fraction
from math import ceil

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
    """Yield one claim for each start position and action with which the ego enters the new lane.

    It does so within one decision. The claim is that the follower in the new lane stays behind it.
    """
    for y_m in places(a):
        path = going(y_m, 1, a.steps, a)
        over = next((step for step, at_m in enumerate(path, 1) if is_over(at_m, a)), None)
        if over is None:
            continue
        for rate in a.rates_m_s2 if a.by_number else (-a.hard_m_s2,):
            yield handed_over(a, rate, over, seconds_to_line(y_m, a) + a.response_s)


def seconds_to_line(y_m: Fraction, a: Argument) -> Fraction:
    """Return the time until the ego's body is over the lane marking, s, as the check computes it.

    It is 0 if that is not within this decision.
    """
    steps = ceil(((a.lane_m - a.width_m) / 2 + LINE - y_m) / (a.stride_m / a.steps))
    return (steps if 0 < steps <= a.steps else 0) * a.step_s


def pair(p: Problem, a: Argument) -> tuple[Term, Term, Term]:
    """Add an ego and a vehicle behind it to a problem; return both speeds and the gap."""
    gap_m = p.unknown("gap", 0)
    p.assume(gap_m > 0)
    ego = p.unknown("ego_speed", 0, a.most_m_s)
    return ego, p.unknown("follower_speed", 0, a.others_most_m_s), gap_m


def handed_over(a: Argument, rate: Fraction, over: int, delay_s: Fraction) -> Claim:
    """Claim that the vehicle behind does not touch the ego, and can stop behind it at the end.

    The ego's body is over the lane marking after ``over`` steps of a decision with acceleration
    ``rate``. The check expects the vehicle to brake ``delay_s`` after the decision begins.
    """
    p = Problem()
    speed, follower, gap_m = pair(p, a)
    p.unknown("rate", rate, rate)
    reach_m = reach(p.largest, speed, rate, a.steps, a)
    p.assume(reach_m > must_reach(p.largest, gap_m, follower, delay_s, a))
    planned, ego, apart = speeds(p.largest, speed, rate, a.steps, a), speed, []
    for step in range(1, a.steps + 1):
        covered_m = sum(a.step_s * each for each in planned[1 : step + 1])
        p.assume(gap_m + covered_m > accelerated(follower, step * a.step_s, a))
    responds = over + a.response_steps
    for step in range(1, max(responds, a.steps) + 1):
        certain = step <= a.steps and a.by_number
        ego = planned[step] if certain else any_speed(p, ego, step, a)
        follower = behind(p, follower, step, responds, a)
        apart += [gap_m > 0] if step >= over else []
        gap_m = gap_m + a.step_s * (ego - follower)
    rest_m = gap_m + ego_stops(p.largest, ego, a)
    return p.follows(*apart, gap_m > 0, rest_m > follower_stops(p.largest, follower, a))


def any_speed(p: Problem, before: Term, step: int, a: Argument) -> Term:
    """Add and return a speed of the ego after a step in which it does anything it can."""
    speed = p.unknown(f"ego_speed_{step}", 0, a.most_m_s)
    p.assume(speed >= before - a.hard_m_s2 * a.step_s)
    return speed


def behind(p: Problem, before: Term, step: int, responds: int, a: Argument) -> Term:
    """Return the speed after a step of the vehicle behind.

    It accelerates within its bound up to the step ``responds``, and brakes afterwards.
    """
    if step > responds:
        return p.largest([before - a.follower_m_s2 * a.step_s, 0 * before])
    speed = p.unknown(f"follower_speed_{step}", 0, a.others_most_m_s)
    p.assume(speed <= before + a.acceleration_m_s2 * a.step_s)
    return speed


def follower_claims(a: Argument) -> Iterator[Claim]:
    """Yield the claim that a vehicle behind that brakes stays behind, whatever the ego does."""
    p = Problem()
    ego, follower, gap_m = pair(p, a)
    p.assume(gap_m + ego_stops(p.largest, ego, a) > follower_stops(p.largest, follower, a))
    after, slower = any_speed(p, ego, 1, a), behind(p, follower, 1, 0, a)
    gap_m = gap_m + a.step_s * (after - slower)
    rest_m = gap_m + ego_stops(p.largest, after, a)
    yield p.follows(gap_m > 0, rest_m > follower_stops(p.largest, slower, a))


LEMMAS = (
    Lemma(
        "response",
        "A vehicle behind in the lane that a permitted lane change enters does not touch the ego "
        "before it brakes for it, and may stop behind it then.",
        response_claims,
    ),
    Lemma(
        "hand-over",
        "From then on, braking as it is counted on to keeps it behind the ego, whatever that does.",
        follower_claims,
    ),
)
