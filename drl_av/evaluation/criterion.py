"""The criterion for "trained": whether a driver passes beside the rule-based drivers (ours)."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from drl_av.drivers.registry import baselines
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation.criticality import styles
from drl_av.evaluation.paired import require_distinct
from drl_av.evaluation.statistics import Mean, fastest, grouped, mean_difference


class CriterionResult(NamedTuple):
    """Whether a driver passes the comparison with the rule-based drivers, with its numbers."""

    driver: str
    over: str
    """The fastest of the rule-based drivers that miss their exit, or fail to merge, least often."""
    gain_m_s: Mean
    """Gain in mean speed over the driver ``over``, paired by traffic."""
    ego_hits: int
    """Number of episodes in which the ego hit something."""
    fewest_ego_hits: int
    """Smallest ``ego_hits`` of the rule-based drivers."""
    hard_brakes_per_km: float
    their_hard_brakes_per_km: float
    """Number of hard brakes per kilometre of the driver ``over``."""
    comfortable_percent: float | None
    """Share of decisions within nuPlan's bounds of comfort; None without ``--criticality``."""
    their_comfortable_percent: float | None
    """Share of the decisions of the driver ``over`` within nuPlan's bounds of comfort, or None."""
    failures: tuple[str, ...]
    """The conditions that the driver does not meet: ``speed``, ``collisions``, ``way``,
    ``comfort``."""
    passed: bool
    """Whether the driver meets all conditions."""
    missed: int | None = None
    """Number of episodes in which the ego missed its exit or did not merge; None on a road without
    an exit or a merge."""
    fewest_missed: int | None = None
    """Smallest ``missed`` of the rule-based drivers; None if ``missed`` is None."""

    def __str__(self) -> str:
        gain = f"{self.gain_m_s} m/s"
        if math.isinf(self.gain_m_s.half_width):
            gain = f"{self.gain_m_s.value:.2f} m/s; a single episode has no interval"
        result = "PASS" if self.passed else f"FAIL ({', '.join(self.failures)})"
        comfort = ""
        if self.comfortable_percent is not None:
            comfort = (
                f"\n  comfortable decisions {self.comfortable_percent:.1f} % "
                f"({self.their_comfortable_percent:.1f} %)"
            )
        route = ""
        if self.missed is not None:
            route = (
                "\n  episodes in which the ego missed its exit or did not merge "
                f"{self.missed} (rule-based: {self.fewest_missed})"
            )
        return (
            f"{self.driver}: {result} against {self.over}\n"
            f"  gain in speed {gain}\n"
            f"  episodes in which the ego hit something {self.ego_hits} (rule-based: "
            f"{self.fewest_ego_hits}){route}\n"
            f"  hard brakes in a kilometre {self.hard_brakes_per_km:.2f} "
            f"({self.their_hard_brakes_per_km:.2f})"
            f"{comfort}"
        )


class _Fewest(NamedTuple):
    """The smallest numbers of episodes of any rule-based driver."""

    ego_hits: int
    missed: int


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
    fewest = _Fewest(min(_hits(drives[name]) for name in rules), _missed(drives[best]))
    return [
        _judgement(name, own, best, drives[best], fewest)
        for name, own in drives.items()
        if name not in rules
    ]


def _judgement(
    name: str,
    ours: Sequence[EpisodeResult],
    best: str,
    theirs: Sequence[EpisodeResult],
    fewest: _Fewest,
) -> CriterionResult:
    gain = _gain(name, ours, best, theirs)
    brakes, their_brakes = _hard_brakes_per_km(ours), _hard_brakes_per_km(theirs)
    comfort, their_comfort = _comfortable_percent(ours), _comfortable_percent(theirs)
    missed, has_route = _missed(ours), any(row.way for row in ours)
    conditions = {
        "speed": gain.value - gain.half_width > 0,
        "collisions": _hits(ours) <= fewest.ego_hits,
        "way": missed <= fewest.missed,
        "comfort": brakes <= their_brakes and (comfort or 0.0) >= (their_comfort or 0.0),
    }
    failures = tuple(condition for condition, holds in conditions.items() if not holds)
    return CriterionResult(
        driver=name,
        over=best,
        gain_m_s=gain,
        ego_hits=_hits(ours),
        fewest_ego_hits=fewest.ego_hits,
        hard_brakes_per_km=brakes,
        their_hard_brakes_per_km=their_brakes,
        comfortable_percent=comfort,
        their_comfortable_percent=their_comfort,
        failures=failures,
        passed=not failures,
        missed=missed if has_route else None,
        fewest_missed=fewest.missed if has_route else None,
    )


def _gain(
    name: str, ours: Sequence[EpisodeResult], best: str, theirs: Sequence[EpisodeResult]
) -> Mean:
    """Return the mean difference of speeds in the same traffic, over all numbers of vehicles."""
    mine, other = (
        {(row.vehicles, row.seed): row.mean_speed_m_s for row in rows} for rows in (ours, theirs)
    )
    return mean_difference(mine, other, f"{name} and {best}")


def _hits(rows: Iterable[EpisodeResult]) -> int:
    return sum(row.ego_hit for row in rows)


def _missed(rows: Iterable[EpisodeResult]) -> int:
    return sum(row.missed for row in rows)


def _hard_brakes_per_km(rows: Sequence[EpisodeResult]) -> float:
    driven_m = sum(row.mean_speed_m_s * row.decisions for row in rows)  # a decision takes 1 s
    return 1000 * sum(row.hard_brakes for row in rows) / max(driven_m, 1.0)


def _comfortable_percent(rows: Sequence[EpisodeResult]) -> float | None:
    measured = styles(rows)
    return measured[0].comfortable_percent if measured else None
