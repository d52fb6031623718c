"""Drives several drivers through the same seeded traffic, for comparison."""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from functools import cache
from itertools import product

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import DriverSpec, make_drivers
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError, SimulationError, pluralize
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.processes import BrokenProcessPool, workers

MakeMetrics = Callable[[], EpisodeMetrics]
"""A function that makes the metrics of one episode; worker processes must be able to import it."""


def drive_all(
    env: HighwayEnv,
    drivers: Mapping[str, Driver],
    vehicles: Sequence[int],
    seeds: Sequence[int],
    make_metrics: MakeMetrics = EpisodeMetrics,
) -> Iterator[EpisodeResult]:
    """Drive one episode for each number of vehicles, seed and driver; yield each episode's result.

    The order is that of the arguments: the numbers of vehicles, then the seeds, then the drivers.
    """
    for number, seed, name in product(vehicles, seeds, drivers):
        yield drive(env, drivers[name], name, seed, number, make_metrics)


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
        self._env, self._drivers = _equipment(config, self._specs)
        implied = self._env.simulation.fleet.default_vehicle_count
        default = DENSITIES if implied is None else (implied,)
        self._vehicles = tuple(dict.fromkeys(vehicles)) or default
        for number in self._vehicles:
            self._env.require_room(number)

    def __len__(self) -> int:
        return len(self._specs) * len(self._vehicles) * len(self._seeds)

    def rows(self, jobs: int = 1) -> Generator[EpisodeResult, None, None]:
        """Drive all episodes in ``jobs`` processes; yield the result of each, in a fixed order.

        The results do not depend on ``jobs``.

        Raises:
            SimulationError: SUMO ended unexpectedly, or ended its worker process.
        """
        if jobs > 1:
            yield from self._rows_of_processes(min(jobs, len(self)))
            return
        with closing(self._env) as env:
            drives = self._drivers, self._vehicles, self._seeds, self._make_metrics
            yield from drive_all(env, *drives)

    def _rows_of_processes(self, jobs: int) -> Iterator[EpisodeResult]:
        names = [spec.name for spec in self._specs]
        episodes = list(product(self._vehicles, self._seeds, names))
        done = 0
        with workers(jobs) as submit:
            given = self._config, self._specs, self._make_metrics
            rows = [submit(_drive, *given, *episode) for episode in episodes]
            try:
                for row in rows:
                    yield row.result()
                    done += 1
            except BrokenProcessPool as error:
                number, seed, name = episodes[done]
                raise SimulationError(
                    "A process of the evaluation ended on its own, as it does when SUMO aborts: "
                    f"try again with --jobs 1; the first row missing is that of {name}, "
                    f"{pluralize(number, 'vehicle')}, seed {seed}."
                ) from error


def _equipment(
    config: Config, specs: tuple[DriverSpec, ...]
) -> tuple[HighwayEnv, dict[str, Driver]]:
    """Make the environment, which starts SUMO at its first reset, and the drivers."""
    env = HighwayEnv(config=config)
    return env, make_drivers(specs, config, env.safety_check)


_cached_equipment = cache(_equipment)
"""For the episodes of a worker process."""


def _drive(
    config: Config,
    specs: tuple[DriverSpec, ...],
    make_metrics: MakeMetrics,
    vehicles: int,
    seed: int,
    name: str,
) -> EpisodeResult:
    env, drivers = _cached_equipment(config, specs)
    return drive(env, drivers[name], name, seed, vehicles, make_metrics)
