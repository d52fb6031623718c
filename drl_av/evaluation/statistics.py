"""Computes means over episodes with 95 % confidence intervals, by driver and vehicle number."""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drl_av.env.metrics import EpisodeResult
from drl_av.files import write_whole


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


class Summary(NamedTuple):
    """The statistics of one driver at one number of vehicles around the ego."""

    driver: str
    safety_check: str
    vehicles: int
    episodes: int
    speed_m_s: Mean
    reward: Mean
    collisions: int
    ego_hits: int
    triggers: Mean
    lane_changes: Mean


def summarize(rows: Iterable[EpisodeResult]) -> list[Summary]:
    """Summarize episodes for each driver, check and number of vehicles, in order of first rows."""
    groups: dict[tuple[int, str, str], list[EpisodeResult]] = {}
    for row in rows:
        groups.setdefault((row.vehicles, row.driver, row.safety_check), []).append(row)
    return [
        Summary(
            driver=driver,
            safety_check=check,
            vehicles=vehicles,
            episodes=len(group),
            speed_m_s=mean_with_interval(row.mean_speed_m_s for row in group),
            reward=mean_with_interval(row.mean_reward for row in group),
            collisions=sum(row.collided for row in group),
            ego_hits=sum(row.ego_hit for row in group),
            triggers=mean_with_interval(row.safety_triggers for row in group),
            lane_changes=mean_with_interval(row.lane_changes for row in group),
        )
        for (vehicles, driver, check), group in groups.items()
    ]


def write_summaries(path: Path, summaries: Iterable[Summary]) -> None:
    """Write the summaries as a JSON list of objects; raises DrlAvError if the write fails."""
    objects = [
        {name: _plain(value) for name, value in summary._asdict().items()} for summary in summaries
    ]
    write_whole(path, json.dumps(objects, indent=2).encode() + b"\n")


def _plain(value: object) -> object:
    """Convert a value for JSON: a Mean becomes an object, an infinite half-width becomes null."""
    if not isinstance(value, Mean):
        return value
    known = math.isfinite(value.half_width)
    return {"mean": value.value, "ci95_half_width": value.half_width if known else None}
