"""Statistics of episodes with 95 % intervals: means, gains, and summaries of each driver."""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.env.metrics import EpisodeResult
from drl_av.env.transition import EXIT_MISSED, EXIT_TAKEN, MERGED, NOT_MERGED
from drl_av.errors import DrlAvError, pluralize
from drl_av.evaluation.aggregates import (
    Estimate,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
)
from drl_av.files.atomic import write_atomic

OPTIONAL = ("exits_taken", "merged", "trainings")
"""Fields that are None where the ego has no way to take, or the driver is no group."""

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
        return f"{self:.2f}"

    def __format__(self, form: str) -> str:
        """Return both in a form without sign, .2f by default; with an infinite half-width one."""
        form = form or ".2f"
        interval = f" ± {self.half_width:{form}}" if math.isfinite(self.half_width) else ""
        return f"{self.value:z{form}}{interval}"


def mean_with_interval(values: Iterable[float], seeds: Iterable[int] | None = None) -> Mean:
    """Compute a mean with its 95 % confidence interval (Student's t).

    The values are independent; with ``seeds``, only those of different seeds are: the episodes of
    one traffic seed among different numbers of vehicles are alike (Cameron and Miller 2015, "A
    Practitioner's Guide to Cluster-Robust Inference"). The half-width is infinite for a single
    value or seed.
    """
    from scipy.special import stdtrit  # scipy.stats takes half a second to import

    sample = np.array(list(values), dtype=float)
    mean = sample.mean()
    if seeds is None:
        sums = sample - mean
    else:
        _, place = np.unique(list(seeds), return_inverse=True)
        sums = np.bincount(place, sample - mean)
    count = len(sums)
    if count < 2:
        return Mean(float(mean), math.inf)
    error = math.sqrt(count / (count - 1) * float(sums @ sums)) / len(sample)
    return Mean(float(mean), float(stdtrit(count - 1, 0.975)) * error)


def gain(
    ours: Mapping[tuple[Any, ...], float],
    theirs: Mapping[tuple[Any, ...], float],
    drivers: str = "The drivers",
    among: str = "",
) -> Mean:
    """Compute the gain, the mean of ours minus theirs with its 95 % interval, paired by traffic.

    Args:
        ours: A value for each episode; the key names its traffic, and the seed is its last entry.
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
    differences = (ours[traffic] - theirs[traffic] for traffic in ours)
    return mean_with_interval(differences, (seed for *_, seed in ours))


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


def require_distinct(rows: Iterable[EpisodeResult]) -> None:
    """Check that episodes can be compared by the names of their drivers.

    Raises:
        DrlAvError: there are episodes of two worlds, or of one driver under two checks, or a driver
            drove a seed among as many vehicles twice.
    """
    rows = list(rows)
    if len({row.world for row in rows}) > 1:
        raise DrlAvError(
            "Some of the rows were driven in SUMO and some in the twin: compare the drivers in one "
            "world at a time."
        )
    checks = dict[str, str]()
    for row in rows:
        if (first := checks.setdefault(row.driver, row.safety_check)) != row.safety_check:
            raise DrlAvError(
                f"There are rows of {row.driver} under the checks {first} and {row.safety_check}: "
                "compare them apart."
            )
    _require_once(rows)


def _require_once(rows: Iterable[EpisodeResult]) -> None:
    """Raise DrlAvError if a driver drove a seed among as many vehicles twice."""
    driven = Counter((row.driver, row.seed, row.vehicles) for row in rows)
    for (driver, seed, vehicles), times in driven.items():
        if times > 1:
            raise DrlAvError(
                f"{driver} drove seed {seed} among {pluralize(vehicles, 'vehicle')} twice: remove "
                "one of the rows."
            )


def paired(
    episodes: Iterable[EpisodeResult], driver: str, baselines: Sequence[str]
) -> list[PairedGain]:
    """Compute the driver's gain in mean speed over each baseline at each number of vehicles.

    The confidence intervals are Student's t intervals (95 %) of the differences by seed.

    Raises:
        DrlAvError: the drivers did not drive the same seeds, or a driver drove a seed twice.
    """
    episodes = list(episodes)
    require_distinct(episodes)
    speeds: dict[int, dict[str, dict[tuple[int], float]]] = {}
    for row in episodes:
        driven = speeds.setdefault(row.vehicles, {}).setdefault(row.driver, {})
        driven[(row.seed,)] = row.mean_speed_m_s
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

    Only the rule-based drivers that miss their exit or fail to merge least often count. The gain of
    a group is the mean gain of its trainings, with the interval over them.
    """
    first = {row.driver: row for row in rows}
    eligible = fewest_missed(rows, rules)
    found = [g for name in first if name not in rules for g in paired(rows, name, eligible)]
    best, gains = (gain for gain in found if gain.best), []
    groups = grouped(best, lambda each: (each.vehicles, first[each.driver].compared_as))
    for (_, name), own in groups.items():
        gain = own[0]._replace(driver=name, episodes=sum(g.episodes for g in own))
        if first[own[0].driver].is_training:
            mean = mean_with_interval(g.difference_m_s.value for g in own)
            gain = gain._replace(difference_m_s=mean)
        gains.append(gain)
    return sorted(gains, key=lambda each: each.vehicles)


def best_opponent(speeds: Mapping[str, Iterable[float]]) -> str | None:
    """Return the driver with the highest mean of its ``speeds``; None if there is no speed."""
    driven = {name: values for name, own in speeds.items() if (values := list(own))}
    means = {name: sum(values) / len(values) for name, values in driven.items()}
    return max(means, key=means.__getitem__, default=None)


class Summary(NamedTuple):
    """The statistics of one driver, or one group of trainings, at one number of vehicles.

    The intervals are over the episodes, or over the means of the trainings.
    """

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
    trainings: int | None = None
    """Number of trainings of the group; None for a single driver."""


def summarize(rows: Iterable[EpisodeResult]) -> list[Summary]:
    """Summarize the episodes of each driver or group, check, number of vehicles and world.

    The summaries are in the order of their first rows.

    Raises:
        DrlAvError: a driver drove a seed twice in one of them.
    """
    rows = list(rows)
    for own in grouped(rows, lambda row: (row.safety_check, row.world)).values():
        _require_once(own)
    groups = grouped(rows, lambda row: (row.vehicles, row.compared_as, row.safety_check, row.world))
    return [
        Summary(
            driver=driver,
            safety_check=check,
            vehicles=vehicles,
            world=world,
            episodes=len(group),
            speed_m_s=mean_with_interval(scores(group, "mean_speed_m_s")),
            reward=mean_with_interval(scores(group, "mean_reward")),
            collisions=sum(row.collided for row in group),
            ego_hits=sum(row.ego_hit for row in group),
            triggers=mean_with_interval(scores(group, "safety_triggers")),
            lane_changes=mean_with_interval(scores(group, "lane_changes")),
            exits_taken=_count(group, EXIT_TAKEN, EXIT_MISSED),
            merged=_count(group, MERGED, NOT_MERGED),
            trainings=_trainings(group),
        )
        for (vehicles, driver, check, world), group in groups.items()
    ]


def scores(rows: Sequence[EpisodeResult], column: str, by_training: bool = False) -> FloatArray:
    """Return a column of the rows of one driver, shape (episodes,).

    For a group, or with ``by_training``, return the mean of each training, shape (trainings,).
    """
    if not by_training and not rows[0].is_training:
        return np.array([getattr(row, column) for row in rows], dtype=float)
    trainings = grouped(rows, lambda row: row.driver).values()
    return np.array([np.mean([getattr(row, column) for row in own]) for own in trainings])


def _trainings(rows: Sequence[EpisodeResult]) -> int | None:
    return len({row.driver for row in rows}) if rows[0].is_training else None


def _count(rows: Sequence[EpisodeResult], done: str, failed: str) -> int | None:
    """Return the number of rows with the outcome ``done``; None if no row has either outcome."""
    ways = [row.way for row in rows]
    return ways.count(done) if {done, failed} & {*ways} else None


class Overall(NamedTuple):
    """The statistics of one driver or group over all numbers of vehicles around the ego.

    A score is the mean speed of an episode; beside groups, of a training at one number of vehicles.
    """

    driver: str
    episodes: int
    speed_m_s: Estimate
    """Interquartile mean of the scores."""
    improvement: Estimate | None
    """Probability of a higher score than the fastest baseline; None if ``over`` is None."""
    over: str | None
    """The fastest baseline; None without a baseline, or if this driver is the fastest baseline."""
    share_faster_than_m_s: dict[int, float]
    """Performance profile: the share of higher scores, by speed in whole m/s.

    The profile ends at the first speed that no score exceeds."""
    trainings: int | None = None
    """As in ``Summary``."""


def overall(rows: Sequence[EpisodeResult], baselines: Iterable[str]) -> list[Overall]:
    """Summarize the speeds of each driver over all numbers of vehicles.

    The drivers are in the order of their first rows.

    Raises:
        DrlAvError: a driver and a baseline did not drive among the same numbers of vehicles.
    """
    strata, by_training = {}, any(row.is_training for row in rows)
    drives = grouped(rows, lambda row: row.compared_as)
    for driver, own in drives.items():
        cells = grouped(own, lambda row: row.vehicles)
        strata[driver] = [scores(cells[n], "mean_speed_m_s", by_training) for n in sorted(cells)]
    best = fastest(rows, baselines)
    numbers = {frozenset(row.vehicles for row in own) for own in drives.values()}
    if best is not None and len(numbers) > 1:
        raise DrlAvError(
            "The drivers drove among different numbers of vehicles: compare drivers that drove "
            "among the same numbers."
        )
    return [
        Overall(
            driver=driver,
            episodes=len(drives[driver]),
            speed_m_s=interquartile_mean(found),
            improvement=None
            if best in (None, driver)
            else probability_of_improvement(found, strata[best]),
            over=None if best == driver else best,
            share_faster_than_m_s=_profile(found),
            trainings=_trainings(drives[driver]),
        )
        for driver, found in strata.items()
    ]


def fastest(rows: Iterable[EpisodeResult], drivers: Iterable[str]) -> str | None:
    """Return which driver or group of ``drivers`` has the highest mean speed; None without rows.

    On a road with an exit or a merge, only those of the drivers count that miss their exit, or fail
    to merge, in the fewest episodes.
    """
    rows = list(rows)
    driven = grouped(rows, lambda row: row.compared_as)
    eligible = fewest_missed(rows, drivers)
    return best_opponent({name: [row.mean_speed_m_s for row in driven[name]] for name in eligible})


def fewest_missed(rows: Iterable[EpisodeResult], drivers: Iterable[str]) -> list[str]:
    """Return those of ``drivers`` that miss their exit, or fail to merge, in the fewest episodes.

    On a road without an exit or a merge these are all of ``drivers`` that have rows.
    """
    names = set(drivers)
    driven = grouped((row for row in rows if row.compared_as in names), lambda r: r.compared_as)
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
                if value is not None or name not in OPTIONAL
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
