"""Drives several drivers through the same seeded traffic, for comparison."""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from itertools import product
from typing import NamedTuple

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import DriverSpec, make_drivers
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError
from drl_av.evaluation import DENSITIES, LOKY
from drl_av.evaluation.engines import ENGINES

Equipment = tuple[HighwayEnv, dict[str, Driver]]
MakeMetrics = Callable[[], EpisodeMetrics]
"""A function that makes the metrics of one episode; worker processes must be able to import it."""


class EpisodeJob(NamedTuple):
    """One episode to drive: everything on which its result depends."""

    config: Config
    specs: tuple[DriverSpec, ...]
    """The drivers that are loaded together, ``driver`` among them (see ``make_drivers``)."""
    make_metrics: MakeMetrics
    vehicles: int
    seed: int
    driver: str

    @property
    def key(self) -> tuple[int, int, str]:
        """Number of vehicles, traffic seed and driver."""
        return self.vehicles, self.seed, self.driver


class Evaluation:
    """The drivers, the numbers of vehicles around the ego and the traffic seeds of an evaluation.

    If ``vehicles`` is empty, the numbers are those of the published tables, or the number that the
    scenario places. ``make_metrics`` makes the metrics of each episode, which compute its row of
    the results. ``len`` returns the number of episodes.

    Raises:
        RunError, CheckpointError: a learned driver cannot be read.
        ConfigError, ScenarioError: the vehicles do not fit on the road, or a seed is reserved for
            training (1,000,000 and above).
    """

    def __init__(
        self,
        config: Config,
        specs: Sequence[DriverSpec],
        vehicles: Sequence[int],
        seeds: range,
        make_metrics: MakeMetrics = EpisodeMetrics,
    ) -> None:
        self._make_metrics = make_metrics
        self._config, self._specs, self._seeds = config, tuple(specs), seeds
        if seeds[-1] >= TRAINING_SEED_RANGE[0]:
            raise ConfigError(
                f"The last episode's seed would be {seeds[-1]}, but those from "
                f"{TRAINING_SEED_RANGE[0]} on belong to training: begin with a smaller one."
            )
        _close()  # a driver may have been trained since
        env, _ = _equipment(config, self._specs)
        implied = env.simulation.fleet.default_vehicle_count
        default = DENSITIES if implied is None else (implied,)
        self._vehicles = tuple(dict.fromkeys(vehicles)) or default
        for number in self._vehicles:
            env.require_room(number)

    @property
    def config(self) -> Config:
        """The settings with which the drivers drive."""
        return self._config

    @property
    def specs(self) -> tuple[DriverSpec, ...]:
        """The drivers."""
        return self._specs

    def __len__(self) -> int:
        return len(self.jobs)

    @property
    def jobs(self) -> list[EpisodeJob]:
        """The episodes in their order: by number of vehicles, then seed, then driver."""
        names = [spec.name for spec in self._specs]
        return [
            EpisodeJob(self._config, self._specs, self._make_metrics, *episode)
            for episode in product(self._vehicles, self._seeds, names)
        ]

    def rows(self, jobs: int = 1) -> Generator[EpisodeResult, None, None]:
        """Drive all episodes in ``jobs`` processes; yield the result of each, in their order.

        The results do not depend on ``jobs``.

        Raises:
            SimulationError: SUMO ended unexpectedly, or ended its worker process.
        """
        yield from drive_episodes(self.jobs, jobs)


def drive_episodes(
    episodes: Sequence[EpisodeJob], processes: int = 1, engine: str = LOKY
) -> Generator[EpisodeResult, None, None]:
    """Drive the episodes in ``processes`` processes; yield the results in the same order.

    One process on this machine is this process. ``engine`` is a name in ``engines.ENGINES``.

    Raises:
        SimulationError: SUMO ended unexpectedly, or ended its worker process again and again.
    """
    if processes == 1 and engine == LOKY:
        try:
            for episode in episodes:
                yield _drive(episode)
        finally:
            _close()
        return
    done: dict[int, EpisodeResult] = {}
    place = 0
    with closing(ENGINES[engine](_drive, episodes, processes)) as running:
        for ended in running:
            done.update(ended)
            while place in done:
                yield done.pop(place)
                place += 1


_latest: list[tuple[tuple[Config, tuple[DriverSpec, ...]], Equipment]] = []
"""The environment and drivers of the latest episode of this process; empty at first."""


def _equipment(config: Config, specs: tuple[DriverSpec, ...]) -> Equipment:
    """Return the environment, which starts SUMO at its first reset, and the drivers.

    They are kept for the next episodes of this process with the same config and drivers.
    """
    if not _latest or _latest[0][0] != (config, specs):
        _close()
        env = HighwayEnv(config=config)
        drivers = make_drivers(specs, config, env.safety_check)
        _latest.append(((config, specs), (env, drivers)))
    return _latest[0][1]


def _drive(job: EpisodeJob) -> EpisodeResult:
    env, drivers = _equipment(job.config, job.specs)
    driver = drivers[job.driver]
    return drive(env, driver, job.driver, job.seed, job.vehicles, job.make_metrics)


def _close() -> None:
    while _latest:
        _latest.pop()[1][0].close()
