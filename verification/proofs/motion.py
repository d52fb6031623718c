"""Models the distances that vehicles cover, such as stopping distances, by linear pieces.

The distances are those that ``drl_av/safety/reachability.py`` computes.

The functions work on terms of Z3, on fractions and on arrays; their argument ``largest`` is the
function that returns the largest of several such numbers. Distances are in m, speeds in m/s.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from math import floor
from typing import Any, NamedTuple

from verification.proofs.argument import Argument

Number = Any
"""A term of Z3, a fraction, or an array."""
Largest = Callable[[Sequence[Number]], Number]


class Line(NamedTuple):
    """One piece of a stopping distance: ``slope_s * speed - offset_m``."""

    slope_s: Fraction
    offset_m: Fraction

    def __call__(self, speed: Number) -> Number:
        return self.slope_s * speed - self.offset_m


def lines(braking: Fraction, most: Fraction, step_s: Fraction) -> list[Line]:
    """Return the linear pieces of the stopping distance for speeds up to ``most``.

    Piece k holds for a vehicle that still moves after k steps of braking; ``stopping_distance``
    uses the piece k = floor(speed / (braking * step)).
    """
    return [
        Line(step_s * k, step_s * k * braking * step_s * (k + 1) / 2)
        for k in range(floor(most / (braking * step_s)) + 1)
    ]


def stopping(
    largest: Largest, speed: Number, braking: Fraction, most: Fraction, step_s: Fraction
) -> Number:
    """Return the distance in which a vehicle comes to rest if it brakes from now on, m.

    ``braking`` is positive, m/s^2. The vehicle's ``speed`` is at most ``most``, m/s.
    """
    return largest([line(speed) for line in lines(braking, most, step_s)])


def bounded(largest: Largest, speed: Number, most: Fraction) -> Number:
    """Return the speed limited to [0, most]."""
    return -largest([-largest([speed, 0 * speed]), -most + 0 * speed])


def speeds(
    largest: Largest, speed: Number, rate: Number, steps: int, argument: Argument
) -> list[Number]:
    """Return the ego's speed now and after each of ``steps`` steps with acceleration ``rate``."""
    return [speed] + [
        bounded(largest, speed + rate * (step * argument.step_s), argument.most_m_s)
        for step in range(1, steps + 1)
    ]


def reach(largest: Largest, speed: Number, rate: Number, steps: int, argument: Argument) -> Number:
    """Return the distance that the ego covers until it stands, m.

    The ego drives ``steps`` SUMO steps with the acceleration ``rate``, and then brakes hard.
    """
    after = speeds(largest, speed, rate, steps, argument)
    return sum(argument.step_s * each for each in after[1:]) + ego_stops(
        largest, after[-1], argument
    )


def ego_stops(largest: Largest, speed: Number, argument: Argument) -> Number:
    """Return the distance in which the ego comes to rest if it brakes hard from now on, m."""
    return stopping(largest, speed, argument.hard_m_s2, argument.most_m_s, argument.step_s)


def lead_stops(largest: Largest, speed: Number, argument: Argument) -> Number:
    """Return the shortest stopping distance of a vehicle ahead by bound 1 of ``strict``, m."""
    return stopping(
        largest, speed, argument.braking_m_s2, argument.others_most_m_s, argument.step_s
    )


def follower_stops(largest: Largest, speed: Number, argument: Argument) -> Number:
    """Return the distance in which a vehicle behind stops by bound 4 of ``strict``, m."""
    most = argument.others_most_m_s + 20 * argument.acceleration_m_s2
    return stopping(largest, speed, argument.follower_m_s2, most, argument.step_s)


def must_reach(
    largest: Largest, gap_m: Number, speed: Number, delay_s: Fraction, argument: Argument
) -> Number:
    """Return the distance that the ego must exceed so that a vehicle behind can stop behind it, m.

    The vehicle behind accelerates as hard as possible for ``delay_s``, and then brakes.
    """
    faster = speed + argument.acceleration_m_s2 * delay_s
    stops_m = follower_stops(largest, faster, argument)
    return accelerated(speed, delay_s, argument) + stops_m - gap_m + argument.clearance_m


def accelerated(speed: Number, time_s: Fraction, argument: Argument) -> Number:
    """Return the distance that a vehicle covers in ``time_s`` at its highest acceleration, m."""
    gained = argument.acceleration_m_s2 * time_s
    return speed * time_s + gained * (time_s + argument.step_s) / 2


def cut_in_gap(
    largest: Largest, speed: Number, rate: Number, other_m: Number, argument: Argument
) -> Number:
    """Return the gap above which a vehicle may begin to cut in ahead of the ego, m.

    ``other_m`` is the shortest distance in which this vehicle can come to rest.
    """
    rate = rate if argument.by_number else max(argument.rates_m_s2)
    rolled_m = reach(largest, speed, rate, argument.cut_in_steps, argument)
    spare_m = rolled_m - other_m
    return largest([spare_m, 0 * spare_m]) + argument.clearance_m
