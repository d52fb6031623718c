"""The criterion for "trained": whether a driver passes beside the rule-based drivers (ours)."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from drl_av.drivers.registry import baselines
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation.criticality import CriticalityResult
from drl_av.evaluation.statistics import fastest, gain, grouped, require_distinct

PASS, FAIL, UNDECIDED = "pass", "fail", "undecided"
SHARE_MARGIN = 0.02
"""A share of episodes counts as no larger than another if the 95 % interval of their difference
lies below this (ours): with no hit at all, 190 episodes of each driver are enough."""
Z_95 = 1.959964
"""The quantile of the normal distribution for 95 % intervals."""
Rows = Sequence[EpisodeResult]
Measure = Callable[[EpisodeResult], float]


class Interval(NamedTuple):
    """A difference, ours minus theirs, with its 95 % confidence interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        if math.isinf(self.low):
            return f"{self.value:+z.2f} [one seed]"
        return f"{self.value:+z.2f} [{self.low:z.2f}, {self.high:z.2f}]"


class Criterion(NamedTuple):
    """One condition of the comparison: its result, and the figures of both drivers."""

    name: str
    """``speed``, ``collisions``, ``exit or merge``, ``hard brakes`` or ``comfort``."""
    unit: str
    result: str
    """``pass``, ``fail``, or ``undecided`` where the intervals overlap."""
    ours: float
    theirs: float
    over: str
    """The rule-based driver of the other figure."""
    difference: Interval
    """Ours minus theirs, in the unit; for episodes, in percent of the episodes."""

    def __str__(self) -> str:
        figures = f"{self.ours:.2f} against {self.theirs:.2f} {self.unit}, {self.difference}"
        if self.unit == "episodes":
            value, low, high = self.difference
            figures = (
                f"{self.ours:.0f} against {self.theirs:.0f} episodes of {self.over}, "
                f"{value:+z.1f} [{low:z.1f}, {high:z.1f}] %"
            )
        return f"{self.name}: {self.result}, {figures}"


class CriterionResult(NamedTuple):
    """Whether a driver passes the comparison with the rule-based drivers, with its numbers."""

    driver: str
    over: str
    """The fastest of the rule-based drivers that miss their exit, or fail to merge, least often."""
    criteria: tuple[Criterion, ...]
    failures: tuple[str, ...]
    """The names of the criteria that the driver fails."""
    undecided: tuple[str, ...]
    """The names of the criteria that these episodes do not decide."""
    passed: bool
    """Whether the driver passes each criterion."""

    def criterion(self, name: str) -> Criterion:
        """Return the criterion of this name; raise KeyError if it does not apply."""
        return {criterion.name: criterion for criterion in self.criteria}[name]

    def __str__(self) -> str:
        result = "PASS" if self.passed else "UNDECIDED"
        if self.failures:
            result = f"FAIL ({', '.join(self.failures)})"
        lines = [f"{self.driver}: {result} against {self.over}", *map(str, self.criteria)]
        if self.undecided:
            lines.append("in brackets: 95 % intervals of the differences; more episodes decide")
        return "\n  ".join(lines)


def judge(rows: Iterable[EpisodeResult]) -> list[CriterionResult]:
    """Judge each driver that is not rule-based by ``drl_av.evaluation.PASS_CRITERION``.

    The list is empty without a rule-based driver.

    Raises:
        DrlAvError: a driver and the fastest rule-based driver did not drive the same traffic, or
            one of them drove a seed twice.
    """
    rows = list(rows)
    require_distinct(rows)
    drives = grouped(rows, lambda row: row.driver)
    rules = baselines(drives)
    best = fastest(rows, rules)
    if best is None:
        return []
    safest = min(rules, key=lambda name: _mean(drives[name], lambda row: row.ego_hit))
    return [_judgement(name, best, safest, drives) for name in drives if name not in rules]


def _judgement(name: str, best: str, safest: str, drives: Mapping[str, Rows]) -> CriterionResult:
    ours, theirs = drives[name], drives[best]

    def compared(
        criterion: str,
        unit: str,
        measure: Callable[[Rows], Measure],
        decided: Callable[[Interval], str],
    ) -> Criterion:
        mine, other = measure(ours), measure(theirs)
        paired = gain(_by_traffic(ours, mine), _by_traffic(theirs, other), f"{name} and {best}")
        half, figures = paired.half_width, (_mean(ours, mine), _mean(theirs, other))
        difference = Interval(paired.value, paired.value - half, paired.value + half)
        return Criterion(criterion, unit, decided(difference), *figures, best, difference)

    criteria = [
        compared(
            "speed",
            "m/s",
            lambda _: lambda row: row.mean_speed_m_s,
            lambda faster: _decided(faster.low > 0, faster.high <= 0),
        ),
        _no_more_episodes("collisions", ours, drives[safest], safest, lambda row: row.ego_hit),
    ]
    if any(row.way for row in ours):
        criteria.append(
            _no_more_episodes("exit or merge", ours, theirs, best, lambda row: row.missed)
        )
    criteria.append(
        compared(
            "hard brakes",
            "per km",
            lambda rows: _pooled(rows, lambda row: row.hard_brakes, _driven_km),
            lambda more: _decided(more.high <= 0, more.low > 0),
        )
    )
    if all(isinstance(row, CriticalityResult) for row in (*ours, *theirs)):
        criteria.append(
            compared(
                "comfort",
                "% of decisions",
                lambda rows: _pooled(rows, _comfortable, lambda row: row.decisions / 100),
                lambda more: _decided(more.low >= 0, more.high < 0),
            )
        )
    results = {criterion.name: criterion.result for criterion in criteria}
    failures, undecided = (
        tuple(each for each, result in results.items() if result == which)
        for which in (FAIL, UNDECIDED)
    )
    passed = not (failures or undecided)
    return CriterionResult(name, best, tuple(criteria), failures, undecided, passed)


def _decided(passes: bool, fails: bool) -> str:
    return PASS if passes else FAIL if fails else UNDECIDED


def _no_more_episodes(
    name: str, ours: Rows, theirs: Rows, over: str, happens: Callable[[EpisodeResult], bool]
) -> Criterion:
    """Return the criterion that something happens in no larger share of our episodes."""
    counts = [(sum(map(happens, rows)), len(rows)) for rows in (ours, theirs)]
    difference = share_difference(*counts)
    passes = difference.value <= 0 and difference.high < SHARE_MARGIN
    percent = Interval(*(100 * part for part in difference))
    result = _decided(passes, difference.low > 0)
    return Criterion(name, "episodes", result, counts[0][0], counts[1][0], over, percent)


def share_difference(ours: tuple[int, int], theirs: tuple[int, int]) -> Interval:
    """Return the difference of two shares with its 95 % interval (Newcombe 1998, method 10).

    Each argument is a number of episodes with an event and the number of all episodes.
    """
    (p, low, high), (q, their_low, their_high) = (wilson(*count) for count in (ours, theirs))
    below = math.hypot(p - low, their_high - q)
    above = math.hypot(high - p, q - their_low)
    return Interval(p - q, p - q - below, p - q + above)


def wilson(events: int, number: int) -> tuple[float, float, float]:
    """Return a share and the ends of its 95 % interval (Wilson 1927)."""
    p, z2 = events / number, Z_95**2
    center = (p + z2 / (2 * number)) / (1 + z2 / number)
    half = Z_95 / (1 + z2 / number) * math.sqrt(p * (1 - p) / number + z2 / (4 * number**2))
    return p, center - half, center + half


def _by_traffic(rows: Rows, measure: Measure) -> dict[tuple[int, int], float]:
    return {(row.vehicles, row.seed): measure(row) for row in rows}


def _mean(rows: Rows, measure: Measure) -> float:
    return sum(map(measure, rows)) / len(rows)


def _pooled(rows: Rows, count: Measure, size: Measure) -> Measure:
    """Return a measure of an episode whose mean is the sum of ``count`` over that of ``size``.

    So the interval of its mean is that of the ratio by the delta method (Cochran 1977, ch. 6).
    """
    mean_size = _mean(rows, size)
    ratio = _mean(rows, count) / mean_size
    return lambda row: ratio + (count(row) - ratio * size(row)) / mean_size


def _driven_km(row: EpisodeResult) -> float:
    return max(row.mean_speed_m_s * row.decisions, 1.0) / 1000  # a decision takes 1 s


def _comfortable(row: EpisodeResult) -> int:
    assert isinstance(row, CriticalityResult)
    return row.comfortable_decisions
