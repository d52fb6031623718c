"""Drivers compared on the same seeded traffic."""

import csv
import io
import json
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import asdict, fields
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.driving.drivers import Driver
from drl_av.env import TRAINING_SEEDS, HighwayEnv
from drl_av.episode import EpisodeResult, drive
from drl_av.errors import ConfigError, SimulationError
from drl_av.studies import DENSITIES
from drl_av.studies.drivers import Choice, build
from drl_av.studies.files import write_whole


def drive_all(
    env: HighwayEnv,
    drivers: Mapping[str, Driver],
    vehicles: Sequence[int],
    seeds: Sequence[int],
) -> Iterator[EpisodeResult]:
    """Drive every driver through every number of vehicles and every seed, a row an episode."""
    for number, seed, name in product(vehicles, seeds, drivers):
        yield drive(env, drivers[name], name, seed, number)


class Evaluation:
    """Which drivers are to be driven, among how many vehicles, and on which seeds.

    Without numbers of vehicles they are those of the published tables, or what the scenario
    places.

    Raises:
        RunError, CheckpointError: a learned driver is not to be had.
        ConfigError, ScenarioError: so many vehicles are not to be had, or training's own seeds.
    """

    def __init__(
        self,
        config: Config,
        choices: Sequence[Choice],
        vehicles: Sequence[int],
        seeds: range,
    ) -> None:
        self._config, self._choices = config, tuple(choices)
        if seeds[-1] >= TRAINING_SEEDS[0]:
            raise ConfigError(
                f"The last episode's seed would be {seeds[-1]}, but those from "
                f"{TRAINING_SEEDS[0]} on belong to training: begin with a smaller one."
            )
        build(choices, config)
        with closing(HighwayEnv(config=config)) as env:
            placed = env.simulation.placed_vehicles
            default = DENSITIES if placed is None else (placed,)
            self._vehicles = tuple(dict.fromkeys(vehicles)) or default
            for number in {min(self._vehicles), max(self._vehicles)}:
                env.reset(seed=0, options={"vehicles": number})
        self._seeds = seeds

    def __len__(self) -> int:
        return len(self._choices) * len(self._vehicles) * len(self._seeds)

    def rows(self, jobs: int = 1) -> Generator[EpisodeResult, None, None]:
        """A row an episode; in the same order and the same whatever the number of processes.

        Raises:
            SimulationError: SUMO ended on its own, and its process with it where there are several.
        """
        if jobs > 1:
            yield from self._rows_of_processes(min(jobs, len(self)))
            return
        with closing(HighwayEnv(config=self._config)) as env:
            drivers = build(self._choices, self._config)
            yield from drive_all(env, drivers, self._vehicles, self._seeds)

    def _rows_of_processes(self, jobs: int) -> Iterator[EpisodeResult]:
        names = [choice.name for choice in self._choices]
        episodes = list(product(self._vehicles, self._seeds, names))
        pool = ProcessPoolExecutor(
            jobs,
            multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(self._config, self._choices),
        )
        done = 0
        try:
            with interrupts_ignored():
                rows = pool.map(_drive, episodes)
            for row in rows:
                yield row
                done += 1
        except BrokenProcessPool as error:
            number, seed, name = episodes[done]
            raise SimulationError(
                "A process of the evaluation ended on its own, as it does when SUMO aborts: try "
                f"again with --jobs 1; the first row missing is that of {name}, "
                f"{number} vehicles, seed {seed}."
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Processes begun inside ignore Ctrl-C, which the terminal sends to all, for good."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)


class _Worker(NamedTuple):
    env: HighwayEnv
    drivers: dict[str, Driver]


_worker: list[_Worker] = []
"""What this process drives with, where it is one of an evaluation's."""


def _begin(config: Config, choices: Sequence[Choice]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _worker.append(_Worker(HighwayEnv(config=config), build(choices, config)))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _drive(episode: tuple[int, int, str]) -> EpisodeResult:
    [(env, drivers)], (number, seed, name) = _worker, episode
    return drive(env, drivers[name], name, seed, number)


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
        return Mean(float(sample.mean()), math.inf)
    error = float(sample.std(ddof=1)) / math.sqrt(len(sample))
    quantile = float(stats.t.ppf(0.975, len(sample) - 1))
    return Mean(float(sample.mean()), quantile * error)


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
    text = io.StringIO(newline="")
    names = [field.name for field in fields(EpisodeResult)]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    write_whole(path, text.getvalue().encode())


def write_summaries(path: Path, summaries: Iterable[Summary]) -> None:
    """Write a JSON list, an object a summary; raises DrlAvError where the disk refuses."""
    objects = [
        {name: _plain(value) for name, value in summary._asdict().items()} for summary in summaries
    ]
    write_whole(path, json.dumps(objects, indent=2).encode() + b"\n")


def _plain(value: object) -> object:
    """JSON has no infinity: the half-width of a single episode is null."""
    if not isinstance(value, Mean):
        return value
    known = math.isfinite(value.half_width)
    return {"mean": value.value, "ci95_half_width": value.half_width if known else None}
