"""Drivers compared on the same seeded traffic."""

import csv
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drl_av.driving.drivers import Driver
from drl_av.env import HighwayEnv
from drl_av.episode import EpisodeResult, drive
from drl_av.errors import DrlAvError


def drive_all(
    env: HighwayEnv,
    drivers: dict[str, Driver],
    vehicles: Sequence[int],
    seeds: Sequence[int],
) -> Iterator[EpisodeResult]:
    """Drive every driver through every number of vehicles and every seed, a row an episode."""
    for number in vehicles:
        for seed in seeds:
            for name, driver in drivers.items():
                yield drive(env, driver, name, seed, number)


class Mean(NamedTuple):
    """A mean and the half-width of its 95 % confidence interval."""

    value: float
    half_width: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ± {self.half_width:.2f}"


def mean_with_interval(values: Iterable[float]) -> Mean:
    """Student's t interval over independent episodes; infinite half-width for a single one."""
    from scipy import stats

    sample = np.array(list(values), dtype=float)
    if len(sample) < 2:
        return Mean(float(sample.mean()), float("inf"))
    quantile = float(stats.t.ppf(0.975, len(sample) - 1))
    return Mean(float(sample.mean()), quantile * float(sample.std(ddof=1)) / len(sample) ** 0.5)


class Summary(NamedTuple):
    """One driver at one density."""

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
    """A summary for each driver and number of vehicles, in the order of their first row."""
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


def write_rows(path: Path, rows: Iterable[EpisodeResult]) -> None:
    """Write the CSV file whole or not at all; raises DrlAvError where the disk refuses."""
    temporary = path.with_name(path.name + ".tmp")
    try:
        try:
            with temporary.open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, [field.name for field in fields(EpisodeResult)])
                writer.writeheader()
                writer.writerows(asdict(row) for row in rows)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise DrlAvError(
            f"The table {path} cannot be written ({error.strerror}): free some space or choose "
            "another file with --out; what was there before is unchanged."
        ) from error
