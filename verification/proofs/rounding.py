"""Bounds the effect of rounding on the distances of the check ``strict``, by interval arithmetic.

The functions of ``drl_av/safety`` run on ``Rounded`` numbers instead of floats. A Rounded number is
a range of exact numbers, with a bound on the error of the float that stands for them. An operation
of IEEE 754 has an error of at most ``UNIT`` times its result. All bounds are exact fractions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from math import floor
from typing import Any

from drl_av.config import Config
from drl_av.driving.actions import Longitudinal
from drl_av.safety.reachability import reach, required_travel, stopping_limit
from verification.proofs.argument import Argument

UNIT = Fraction(1, 2**53)
SETTING = 4 * UNIT
"""Largest relative error of a setting, or of a product of a few settings."""
POSITION_M = Fraction(1, 10**9)
"""Largest error of a gap between positions of up to 50 km before the check reads it."""
FLOOR = Fraction(1, 10**9)
"""Largest error of a number that is rounded down."""
PICKS = 3
"""Largest number of possible results of rounding down: the exact one and its two neighbours."""


@dataclass(frozen=True)
class Rounded:
    """A float that stands for an exact number in [low, high], with a bound on its error."""

    low: Fraction
    high: Fraction
    error: Fraction = Fraction(0)
    """Largest difference between the float and the exact number."""
    pick: int = 0
    """Index of the possible result that rounding down returns."""

    @property
    def ends(self) -> tuple[Fraction, Fraction]:
        return self.low, self.high

    @property
    def most(self) -> Fraction:
        """The largest magnitude of the exact number."""
        return max(abs(self.low), abs(self.high))

    def __add__(self, other: Any) -> Rounded:
        b = rounded(other)
        return _computed([self.low + b.low, self.high + b.high], self.error + b.error, self, b)

    def __mul__(self, other: Any) -> Rounded:
        b = rounded(other)
        ends = [x * y for x in self.ends for y in b.ends]
        error = self.most * b.error + b.most * self.error + self.error * b.error
        return _computed(ends, error, self, b)

    def __truediv__(self, other: Any) -> Rounded:
        b = rounded(other)
        ends = [x / y for x in self.ends for y in b.ends]
        error = (self.error + max(map(abs, ends)) * b.error) / (min(map(abs, b.ends)) - b.error)
        return _computed(ends, error, self, b)

    def __sub__(self, other: Any) -> Rounded:
        b = rounded(other)
        return self + replace(b, low=-b.high, high=-b.low)

    def __gt__(self, other: Any) -> bool:
        return bool(self.low - self.error > other)

    def __le__(self, other: Any) -> bool:
        return not self > other

    __radd__, __rmul__ = __add__, __mul__

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **_: Any) -> Rounded:
        return UFUNCS[ufunc.__name__](*(rounded(each) for each in inputs))


def rounded(number: Any) -> Rounded:
    """Convert a setting or a whole number to a Rounded; return a Rounded as it is."""
    if isinstance(number, Rounded):
        return number
    exact = Fraction(number)
    off = Fraction(0) if isinstance(number, int) or exact.denominator == 1 else SETTING
    return Rounded(exact, exact, abs(exact) * off)


def _computed(ends: list[Fraction], error: Fraction, a: Rounded, b: Rounded) -> Rounded:
    """Return the result of an operation with its rounding error added.

    ``ends`` holds the extreme exact results; ``error`` is the error that a and b contribute.
    """
    low, high = min(ends), max(ends)
    error += UNIT * (max(abs(low), abs(high)) + error)
    return Rounded(low, high, error, max(a.pick, b.pick))


def _floor(a: Rounded) -> Rounded:
    assert a.error <= FLOOR
    possible = range(floor(a.low - a.error), floor(a.high + a.error) + 1)
    assert len(possible) <= PICKS
    whole = Fraction(possible[min(a.pick, len(possible) - 1)])
    return Rounded(whole, whole, Fraction(0), a.pick)


def _extreme(extreme: Callable[..., Fraction]) -> Callable[[Rounded, Rounded], Rounded]:
    def of_two(a: Rounded, b: Rounded) -> Rounded:
        pick, error = max(a.pick, b.pick), max(a.error, b.error)
        return Rounded(extreme(a.low, b.low), extreme(a.high, b.high), error, pick)

    return of_two


UFUNCS: dict[str, Callable[..., Rounded]] = {
    "floor": _floor,
    "maximum": _extreme(max),
    "minimum": _extreme(min),
}


def slices(most: Fraction, pace: Fraction, gained: Fraction) -> Iterator[Any]:
    """Yield ranges of speeds that together cover [0, most]; each range occurs PICKS times.

    Within a range, (speed + gained) / pace rounds down to the same number, except for rounding
    errors.
    """
    steps = range(floor((most + abs(gained)) / pace) + 2)
    ends = {k * pace - gained for k in steps} | {Fraction(0), most, most - gained, -gained}
    inside = sorted(end for end in ends if 0 <= end <= most)
    for low, high in pairwise(inside):
        for pick in range(PICKS):
            yield Rounded(low, high, Fraction(0), pick)


def rounding_m(config: Config, a: Argument) -> Fraction:
    """Return the largest effect of rounding errors on a comparison that the check makes, m.

    The check compares the ego's reach with the distance that the ego may or must cover. The effect
    is the sum of the errors of these two distances. An error in rounding down selects a
    neighbouring linear piece of the stopping distance, which has almost the same value there.
    """
    strict, ego, step_s = config.strict, config.ego, config.simulation.step_length_s
    gap_m: Any = Rounded(Fraction(1, 1000), Fraction(50_000), POSITION_M)
    reaches = [
        reach(speed, how.acceleration_m_s2(ego), ego, config.simulation)
        for how, rate in zip(Longitudinal, a.rates_m_s2, strict=True)
        for speed in slices(a.most_m_s, a.hard_m_s2 * a.step_s, rate * a.decision_s)
    ]
    is_ahead: Any = True
    ahead = [
        stopping_limit(gap_m, is_ahead, speed, strict, step_s)
        for speed in slices(a.others_most_m_s, a.braking_m_s2 * a.step_s, Fraction(0))
    ]
    behind = []
    for step in range(a.steps + 1):
        delay_s = a.response_s + step * a.step_s
        gained = a.acceleration_m_s2 * delay_s
        for speed in slices(a.others_most_m_s, a.follower_m_s2 * a.step_s, gained):
            behind.append(
                required_travel(gap_m, not is_ahead, speed, float(delay_s), strict, step_s)
            )
    hardest = max(a.hard_m_s2, a.braking_m_s2, a.follower_m_s2)
    return (
        largest_error(reaches)
        + largest_error([*ahead, *behind])
        + (2 * FLOOR * hardest * a.step_s**2)
    )


def largest_error(numbers: list[Any]) -> Fraction:
    """Return the largest error of some Rounded numbers; 0 if there are none."""
    return max((number.error for number in numbers), default=Fraction(0))
