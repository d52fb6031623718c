"""Drives several drivers through the same seeded traffic, for comparison."""

import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from functools import cache
from itertools import product

import cloudpickle

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import DriverSpec, make_drivers
from drl_av.env.custom import NOTHING_CUSTOM, CustomParts
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError, DrlAvWarning, SimulationError, pluralize
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.processes import BrokenProcessPool, workers

MakeMetrics = Callable[[], EpisodeMetrics]
"""A function that makes the metrics of one episode; worker processes must be able to import it."""


class Evaluation:
    """The drivers, the numbers of vehicles around the ego and the traffic seeds of an evaluation.

    If ``vehicles`` is empty, the numbers are those of the published tables, or the number that the
    scenario places. ``make_metrics`` makes the metrics of each episode, which compute its row of
    the results. ``custom`` holds the user's own check, reward and observation. ``len`` returns the
    number of episodes.

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
        custom: CustomParts = NOTHING_CUSTOM,
    ) -> None:
        if seeds[-1] >= TRAINING_SEED_RANGE[0]:
            raise ConfigError(
                f"The last episode's seed would be {seeds[-1]}, but those from "
                f"{TRAINING_SEED_RANGE[0]} on belong to training: begin with a smaller one."
            )
        self._given = config, tuple(specs), make_metrics, custom
        self._names, self._seeds = [spec.name for spec in specs], seeds
        self._cells = _Cells(*self._given)
        env = self._cells.env(config, custom)
        implied = env.simulation.fleet.default_vehicle_count
        default = DENSITIES if implied is None else (implied,)
        self._vehicles = tuple(dict.fromkeys(vehicles)) or default
        for number in self._vehicles:
            env.require_room(number)
        self._cells.make_drivers()

    def __len__(self) -> int:
        return len(self._names) * len(self._vehicles) * len(self._seeds)

    def rows(self, jobs: int = 1) -> Generator[EpisodeResult, None, None]:
        """Drive all episodes in ``jobs`` processes; yield the result of each, in a fixed order.

        The results do not depend on ``jobs``.

        Raises:
            ConfigError: an object of the user cannot be copied into another process.
            SimulationError: SUMO ended unexpectedly, or ended its worker process.
        """
        episodes = list(product(self._vehicles, self._seeds, self._names))
        if jobs > 1:
            yield from self._rows_of_processes(episodes, min(jobs, len(self)))
            return
        with closing(self._cells):
            for episode in episodes:
                yield self._cells.drive(*episode)

    def _rows_of_processes(
        self, episodes: Sequence[tuple[int, int, str]], jobs: int
    ) -> Iterator[EpisodeResult]:
        try:
            given = cloudpickle.dumps(self._given)
        except Exception as error:  # the user's objects may raise anything
            raise ConfigError(
                f"An object of yours cannot be copied into another process ({error}): use "
                "jobs=1, or name it as 'module:name'."
            ) from error
        done = 0
        with workers(jobs) as submit:
            rows = [submit(_drive, given, *episode) for episode in episodes]
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


class _Cells:
    """The environments of an evaluation, one for each safety check, and its drivers."""

    def __init__(
        self,
        config: Config,
        specs: Sequence[DriverSpec],
        make_metrics: MakeMetrics,
        custom: CustomParts,
    ) -> None:
        self._config, self._specs, self._custom = config, specs, custom
        self._make_metrics = make_metrics
        self._parts = {
            spec.name: (spec.config(config), custom._replace(safety_check=None))
            if spec.under
            else (config, custom)
            for spec in specs
        }
        self._envs: dict[Config, HighwayEnv] = {}
        self._drivers: dict[str, Driver] = {}

    def env(self, config: Config, custom: CustomParts) -> HighwayEnv:
        """Return the environment with these settings, which starts SUMO at its first reset."""
        if config not in self._envs:
            self._envs[config] = HighwayEnv(config=config, **custom._asdict())
        return self._envs[config]

    def make_drivers(self) -> None:
        """Make the environments and then the drivers, as a driver's file may run its code."""
        for config, custom in self._parts.values():
            self.env(config, custom)
        env, observed = self.env(self._config, self._custom), None
        if self._custom.observation is not None:
            shape = env.observation_space.shape or ()
            observed = shape[0] if len(shape) == 1 else 0
        self._drivers = make_drivers(self._specs, self._config, env.safety_check, observed)

    def drive(self, vehicles: int, seed: int, name: str) -> EpisodeResult:
        """Drive one episode with the driver of this name, under its safety check."""
        env = self.env(*self._parts[name])
        return drive(env, self._drivers[name], name, seed, vehicles, self._make_metrics)

    def close(self) -> None:
        """Close all environments; another ``drive`` makes them again."""
        while self._envs:
            self._envs.popitem()[1].close()


@cache
def _cells(given: bytes) -> _Cells:
    """Make the environments and drivers of a worker process; cached for its next episodes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DrlAvWarning)  # the first process has warned
        cells = _Cells(*cloudpickle.loads(given))
        cells.make_drivers()
        return cells


def _drive(given: bytes, vehicles: int, seed: int, name: str) -> EpisodeResult:
    return _cells(given).drive(vehicles, seed, name)
