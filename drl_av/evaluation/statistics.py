"""Statistics of episodes with 95 % intervals: means, gains, and summaries of each driver."""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from drl_av.env.episode_start import EXIT_MISSED, EXIT_TAKEN, MERGED, NOT_MERGED
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError, pluralize
from drl_av.evaluation.aggregates import (
    Estimate,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
)
from drl_av.files import Row, write_atomic
from drl_av.road.road import FloatArray

OF_A_WAY = ("exits_taken", "merged")
"""Fields that are None on a road on which the ego neither has an exit nor starts in a lane that
ends."""


Item = TypeVar("Item")
Key = TypeVar("Key")


def grouped(items: Iterable[Item], key: Callable[[Item], Key]) -> dict[Key, list[Item]]:
    """Return the items by their keys; the groups, and the items of a group, keep their order."""
    groups: dict[Key, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


class Mean(NamedTuple):
    """A mean, and the half-width of its 95 % confidence interval in the same unit."""

    value: float
    half_width: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ± {self.half_width:.2f}"


def mean_with_interval(values: Iterable[float]) -> Mean:
    """Compute the mean of independent values with its 95 % confidence interval (Student's t).

    The half-width is infinite for a single value.
    """
    from scipy import stats

    sample = np.array(list(values), dtype=float)
    if len(sample) < 2:
        return Mean(float(sample.mean()), math.inf)
    error = float(sample.std(ddof=1)) / math.sqrt(len(sample))
    quantile = float(stats.t.ppf(0.975, len(sample) - 1))
    return Mean(float(sample.mean()), quantile * error)


def gain(
    ours: Mapping[Any, float],
    theirs: Mapping[Any, float],
    drivers: str = "The drivers",
    among: str = "",
) -> Mean:
    """Compute the gain, the mean of ours minus theirs with its 95 % interval, paired by traffic.

    Args:
        ours: A value for each episode; the key names its traffic.
        theirs: The values of the other driver.
        drivers: The names of the two drivers, for the error message.
        among: The traffic that is compared, for the message, such as " among 10 vehicles".

    Raises:
        DrlAvError: there is no episode, or the two did not drive the same traffic.
    """
    if not ours or ours.keys() != theirs.keys():
        raise DrlAvError(
            f"{drivers} did not drive the same traffic{among}: evaluate them together."
        )
    return mean_with_interval(ours[traffic] - theirs[traffic] for traffic in ours)


def moving_average(episodes: FloatArray, values: FloatArray, over: int) -> FloatArray:
    """Return the moving average of ``values`` over the last ``over`` episodes, shape (rows,).

    ``values`` and ``episodes`` have shape (rows,). The value of a row is the mean over the episodes
    since the previous row; ``episodes`` holds the last episode of each row. A row counts only if
    all of its episodes are within the window.
    """
    counts = np.diff(episodes, prepend=0.0)
    sums = np.concatenate(([0.0], np.cumsum(values * counts)))
    ends = np.concatenate(([0.0], episodes))
    begins = np.searchsorted(ends, episodes - over)
    return np.asarray((sums[1:] - sums[begins]) / (episodes - ends[begins]))


class Speed(NamedTuple):
    """The mean speed of one driver in one episode."""

    driver: str
    vehicles: int
    seed: int
    mean_speed_m_s: float


class PairedGain(NamedTuple):
    """The gain in mean speed of a driver over a baseline at one number of vehicles."""

    vehicles: int
    driver: str
    baseline: str
    best: bool
    """Whether this baseline is the fastest at this number of vehicles."""
    episodes: int
    difference_m_s: Mean
    """The driver's speed minus the baseline's in the same traffic; positive if it is faster."""

    @property
    def lower_m_s(self) -> float:
        """Lower end of the 95 % confidence interval of the gain, m/s."""
        return self.difference_m_s.value - self.difference_m_s.half_width

    def row(self) -> Row:
        """Return the gain as a row of ``paired.csv``: text values by column."""
        mean, half = self.difference_m_s
        return {
            "vehicles": str(self.vehicles),
            "driver": self.driver,
            "baseline": self.baseline,
            "best": str(self.best),
            "episodes": str(self.episodes),
            "difference_m_s": f"{mean:.6g}",
            "ci95_half_width_m_s": f"{half:.6g}",
            "lower_m_s": f"{mean - half:.6g}",
            "upper_m_s": f"{mean + half:.6g}",
        }


def require_distinct(rows: Iterable[Speed | EpisodeResult]) -> None:
    """Raise DrlAvError if a driver drove a seed among as many vehicles twice, or in two worlds."""
    rows = list(rows)
    if len({row.world for row in rows if isinstance(row, EpisodeResult)}) > 1:
        raise DrlAvError(
            "Some of the rows were driven in SUMO and some in the twin: compare the drivers in one "
            "world at a time."
        )
    driven = Counter((row.driver, row.seed, row.vehicles) for row in rows)
    for (driver, seed, vehicles), times in driven.items():
        if times > 1:
            raise DrlAvError(
                f"{driver} drove seed {seed} among {pluralize(vehicles, 'vehicle')} twice: remove "
                "one of the rows."
            )


def paired(
    episodes: Iterable[Speed | EpisodeResult], driver: str, baselines: Sequence[str]
) -> list[PairedGain]:
    """Compute the driver's gain in mean speed over each baseline at each number of vehicles.

    The confidence intervals are Student's t intervals (95 %) of the differences by seed.

    Raises:
        DrlAvError: the drivers did not drive the same seeds, or a driver drove a seed twice.
    """
    episodes = list(episodes)
    require_distinct(episodes)
    speeds: dict[int, dict[str, dict[int, float]]] = {}
    for row in episodes:
        speeds.setdefault(row.vehicles, {}).setdefault(row.driver, {})[row.seed] = (
            row.mean_speed_m_s
        )
    found = []
    for vehicles, own in sorted(speeds.items()):
        among = f" among {pluralize(vehicles, 'vehicle')}"
        best = best_opponent({name: own.get(name, {}).values() for name in baselines})
        for name in baselines:
            ours, theirs = own.get(driver, {}), own.get(name, {})
            difference = gain(ours, theirs, f"{driver} and {name}", among)
            found.append(PairedGain(vehicles, driver, name, name == best, len(ours), difference))
    return found


def gains_over_fastest(rows: Sequence[EpisodeResult], rules: Sequence[str]) -> list[PairedGain]:
    """Compute each other driver's gain over the fastest rule-based driver, at each density.

    Only the rule-based drivers that miss their exit or fail to merge least often count.
    """
    names = list(dict.fromkeys(row.driver for row in rows))
    eligible = fewest_missed(rows, rules)
    found = [paired(rows, name, eligible) for name in names if name not in rules]
    return sorted((g for own in found for g in own if g.best), key=lambda each: each.vehicles)


def best_opponent(speeds: Mapping[str, Iterable[float]]) -> str | None:
    """Return the driver with the highest mean of its ``speeds``; None if there is no speed."""
    driven = {name: values for name, own in speeds.items() if (values := list(own))}
    means = {name: sum(values) / len(values) for name, values in driven.items()}
    return max(means, key=means.__getitem__, default=None)


class Summary(NamedTuple):
    """The statistics of one driver at one number of vehicles around the ego."""

    driver: str
    safety_check: str
    vehicles: int
    world: str
    episodes: int
    speed_m_s: Mean
    reward: Mean
    collisions: int
    ego_hits: int
    triggers: Mean
    lane_changes: Mean
    exits_taken: int | None = None
    """Episodes in which the ego took its exit; None on a road without one."""
    merged: int | None = None
    """Episodes in which the ego left the lane in which it began, if that lane ends; else None."""


def summarize(rows: Iterable[EpisodeResult]) -> list[Summary]:
    """Summarize the episodes of each driver, check, number of vehicles and world.

    The summaries are in the order of their first rows.
    """
    groups = grouped(rows, lambda row: (row.vehicles, row.driver, row.safety_check, row.world))
    return [
        Summary(
            driver=driver,
            safety_check=check,
            vehicles=vehicles,
            world=world,
            episodes=len(group),
            speed_m_s=mean_with_interval(row.mean_speed_m_s for row in group),
            reward=mean_with_interval(row.mean_reward for row in group),
            collisions=sum(row.collided for row in group),
            ego_hits=sum(row.ego_hit for row in group),
            triggers=mean_with_interval(row.safety_triggers for row in group),
            lane_changes=mean_with_interval(row.lane_changes for row in group),
            exits_taken=_count(group, EXIT_TAKEN, EXIT_MISSED),
            merged=_count(group, MERGED, NOT_MERGED),
        )
        for (vehicles, driver, check, world), group in groups.items()
    ]


def _count(rows: Sequence[EpisodeResult], done: str, failed: str) -> int | None:
    """Return the number of rows with the outcome ``done``; None if no row has either outcome."""
    ways = [row.way for row in rows]
    return ways.count(done) if {done, failed} & {*ways} else None


class Overall(NamedTuple):
    """The statistics of one driver over all numbers of vehicles around the ego."""

    driver: str
    episodes: int
    speed_m_s: Estimate
    """Interquartile mean of the episodes' mean speeds."""
    improvement: Estimate | None
    """Probability of a higher mean speed than the fastest baseline; None if ``over`` is None."""
    over: str | None
    """The fastest baseline; None without a baseline, or if this driver is the fastest baseline."""
    share_faster_than_m_s: dict[int, float]
    """Performance profile: the share of episodes with a higher mean speed, by speed in whole m/s.

    The profile ends at the first speed that no episode exceeds."""


def overall(rows: Sequence[EpisodeResult], baselines: Iterable[str]) -> list[Overall]:
    """Summarize the speeds of each driver over all numbers of vehicles.

    The drivers are in the order of their first rows.

    Raises:
        DrlAvError: a driver and a baseline did not drive among the same numbers of vehicles.
    """
    strata = {}
    for driver, own in grouped(rows, lambda row: row.driver).items():
        cells = grouped(own, lambda row: row.vehicles)
        strata[driver] = [np.array([r.mean_speed_m_s for r in cells[n]]) for n in sorted(cells)]
    best = fastest(rows, baselines)
    return [
        Overall(
            driver=driver,
            episodes=sum(map(len, scores)),
            speed_m_s=interquartile_mean(scores),
            improvement=None
            if best in (None, driver)
            else probability_of_improvement(scores, strata[best]),
            over=None if best == driver else best,
            share_faster_than_m_s=_profile(scores),
        )
        for driver, scores in strata.items()
    ]


def fastest(rows: Iterable[EpisodeResult], drivers: Iterable[str]) -> str | None:
    """Return which of ``drivers`` has the highest mean speed; None if none of them has rows.

    On a road with an exit or a merge, only those of the drivers count that miss their exit, or fail
    to merge, in the fewest episodes.
    """
    rows = list(rows)
    driven = grouped(rows, lambda row: row.driver)
    eligible = fewest_missed(rows, drivers)
    return best_opponent({name: [row.mean_speed_m_s for row in driven[name]] for name in eligible})


def fewest_missed(rows: Iterable[EpisodeResult], drivers: Iterable[str]) -> list[str]:
    """Return those of ``drivers`` that miss their exit, or fail to merge, in the fewest episodes.

    On a road without an exit or a merge these are all of ``drivers`` that have rows.
    """
    names = set(drivers)
    driven = grouped((row for row in rows if row.driver in names), lambda row: row.driver)
    missed = {driver: sum(row.missed for row in own) for driver, own in driven.items()}
    return [driver for driver, number in missed.items() if number == min(missed.values())]


def _profile(strata: Sequence[FloatArray]) -> dict[int, float]:
    thresholds = range(math.ceil(max(scores.max() for scores in strata)) + 1)
    return dict(zip(thresholds, performance_profile(strata, thresholds).tolist(), strict=True))


def write_summaries(path: Path, parts: Mapping[str, Iterable[Any]]) -> None:
    """Write named lists of NamedTuples as a JSON object; raises DrlAvError if the write fails.

    A summary of a road without an exit or an on-ramp has no fields about the ego's way.
    """
    objects = {
        part: [
            {
                name: _plain(value)
                for name, value in each._asdict().items()
                if value is not None or name not in OF_A_WAY
            }
            for each in found
        ]
        for part, found in parts.items()
    }
    write_atomic(path, json.dumps(objects, indent=2).encode() + b"\n")


def _plain(value: object) -> object:
    """Convert a value for JSON: a NamedTuple becomes an object, and infinity becomes null."""
    if isinstance(value, tuple) and not isinstance(value, Mean | Estimate):
        if hasattr(value, "_asdict"):
            return {name: _plain(part) for name, part in value._asdict().items()}
        return [_plain(part) for part in value]
    if isinstance(value, Mean):
        known = math.isfinite(value.half_width)
        return {"mean": value.value, "ci95_half_width": value.half_width if known else None}
    if isinstance(value, Estimate):
        return {"value": value.value, "ci95": [_plain(value.low), _plain(value.high)]}
    return None if value in (math.inf, -math.inf) else value
