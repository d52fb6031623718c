"""Drives several drivers through the same seeded traffic, for comparison."""

import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import cloudpickle

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import DriverSpec, make_drivers
from drl_av.env.custom import NOTHING_CUSTOM, CustomParts
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError, DrlAvWarning
from drl_av.evaluation import DENSITIES, LOKY
from drl_av.evaluation.engines import ENGINES
from drl_av.evaluation.recording import RecordingFolder, record_episode
from drl_av.simulation.sumo_options import require_one_process

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
    custom: CustomParts = NOTHING_CUSTOM
    recordings: RecordingFolder | None = None
    """The folder that keeps the recording; None keeps none."""

    @property
    def key(self) -> tuple[int, int, str]:
        """Number of vehicles, traffic seed and driver."""
        return self.vehicles, self.seed, self.driver


class Evaluation:
    """The drivers, the numbers of vehicles around the ego and the traffic seeds of an evaluation.

    If ``vehicles`` is empty, the numbers are those of the published tables, or the number that the
    scenario places. ``make_metrics`` makes the metrics of each episode, which compute its row of
    the results. ``custom`` holds the user's own check, reward and observation, and ``recordings``
    keeps recordings of the episodes.

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
        recordings: RecordingFolder | None = None,
    ) -> None:
        if seeds[-1] >= TRAINING_SEED_RANGE[0]:
            raise ConfigError(
                f"The last episode's seed would be {seeds[-1]}, but those from "
                f"{TRAINING_SEED_RANGE[0]} on belong to training: begin with a smaller one."
            )
        self.config, self.specs, self._seeds = config, tuple(specs), seeds
        self._make_metrics, self.custom, self._recordings = make_metrics, custom, recordings
        _close()  # a driver may have been trained since
        equipment = _equipment(config, self.specs, custom)
        env = equipment.env(config, custom)
        implied = env.simulation.fleet.default_vehicle_count
        default = DENSITIES if implied is None else (implied,)
        self._vehicles = tuple(dict.fromkeys(vehicles)) or default
        for number in self._vehicles:
            env.require_room(number)
        equipment.make_drivers()

    @property
    def jobs(self) -> list[EpisodeJob]:
        """The episodes in their order: by number of vehicles, then seed, then driver."""
        names = [spec.name for spec in self.specs]
        given, kept = (self.config, self.specs, self._make_metrics), self._recordings
        return [
            EpisodeJob(*given, *episode, self.custom, kept)
            for episode in product(self._vehicles, self._seeds, names)
        ]

    def rows(self, jobs: int = 1) -> Generator[EpisodeResult, None, None]:
        """Drive all episodes in ``jobs`` processes; yield the result of each, in their order.

        The results do not depend on ``jobs``.

        Raises:
            ConfigError: an object of the user cannot be copied into another process.
            SimulationError: SUMO ended unexpectedly, or ended its worker process.
        """
        yield from drive_episodes(self.jobs, jobs)


def drive_episodes(
    episodes: Sequence[EpisodeJob], processes: int = 1, engine: str = LOKY
) -> Generator[EpisodeResult, None, None]:
    """Drive the episodes in ``processes`` processes; yield the results in the same order.

    One process on this machine is this process. ``engine`` is a name in ``engines.ENGINES``.

    Raises:
        ConfigError: an object of the user cannot be copied into another process.
        SimulationError: SUMO ended unexpectedly, or ended its worker process again and again.
    """
    if processes == 1 and engine == LOKY:
        try:
            for job in episodes:
                equipment = _equipment(job.config, job.specs, job.custom)
                how = job.make_metrics, job.recordings
                yield equipment.drive(job.driver, job.seed, job.vehicles, *how)
        finally:
            _close()
        return
    if episodes:
        require_one_process(episodes[0].custom.sumo_options)
    done: dict[int, EpisodeResult] = {}
    place = 0
    with closing(ENGINES[engine](_drive, _packed(episodes), processes)) as running:
        for ended in running:
            done.update(ended)
            while place in done:
                yield done.pop(place)
                place += 1


def drivers_in(
    env: HighwayEnv, custom: CustomParts, specs: Sequence[DriverSpec]
) -> dict[str, Driver]:
    """Make drivers for an environment that has these parts of the user, as ``make_drivers``."""
    seen = None if custom.observation is None else env.observation_space
    return make_drivers(specs, env.config, env.safety_check, seen)


class _Packed(NamedTuple):
    """A job for another process: the same drivers and settings are the same bytes."""

    given: bytes
    driver: str
    seed: int
    vehicles: int


def _packed(episodes: Sequence[EpisodeJob]) -> list[_Packed]:
    """Return the jobs as bytes, which objects of the user become by cloudpickle."""
    made: list[tuple[tuple[object, ...], bytes]] = []
    packed = []
    for job in episodes:
        given = job.config, job.specs, job.custom, (job.make_metrics, job.recordings)
        if not made or made[-1][0] != given:
            try:
                made.append((given, cloudpickle.dumps(given)))
            except Exception as error:  # the user's objects may raise anything
                raise ConfigError(
                    f"An object of yours cannot be copied into another process ({error}): use "
                    "jobs=1, or name it as 'module:name'."
                ) from error
        packed.append(_Packed(made[-1][1], job.driver, job.seed, job.vehicles))
    return packed


class _Equipment:
    """The environments of an evaluation, one for each safety check, and its drivers."""

    def __init__(self, config: Config, specs: tuple[DriverSpec, ...], custom: CustomParts) -> None:
        self.given = config, specs, custom
        self._parts = {
            spec.name: (spec.config(config), custom.beside(spec.under)) for spec in specs
        }
        self._groups = {spec.name: spec.group for spec in specs}
        self._envs: dict[Config, HighwayEnv] = {}
        self._drivers: dict[str, Driver] = {}

    def env(self, config: Config, custom: CustomParts) -> HighwayEnv:
        """Return the environment with these settings, which starts SUMO at its first reset."""
        if config not in self._envs:
            self._envs[config] = HighwayEnv(config=config, **custom._asdict())
        return self._envs[config]

    def make_drivers(self) -> None:
        """Make the environments and then the drivers, as a driver's file may run its code."""
        config, specs, custom = self.given
        for parts in self._parts.values():
            self.env(*parts)
        self._drivers = drivers_in(self.env(config, custom), custom, specs)

    def drive(
        self,
        name: str,
        seed: int,
        vehicles: int,
        make_metrics: MakeMetrics,
        recordings: RecordingFolder | None,
    ) -> EpisodeResult:
        """Drive one episode with the driver of this name, under its safety check."""
        if not self._drivers:
            self.make_drivers()
        driven = self.env(*self._parts[name]), self._drivers[name], name, seed, vehicles
        if recordings is None:
            result = drive(*driven, make_metrics)
        else:
            recording, result = record_episode(*driven, make_metrics)
            recordings.keep(recording, result)
        return replace(result, group=self._groups[name])

    def close(self) -> None:
        """Close all environments."""
        while self._envs:
            self._envs.popitem()[1].close()


_latest: list[_Equipment] = []
"""The environments and drivers of the latest episode of this process; empty at first."""
_latest_bytes: list[tuple[bytes, tuple[MakeMetrics, RecordingFolder | None]]] = []
"""The bytes of which they were made, in another process, and the rest of what these held."""


def _equipment(config: Config, specs: tuple[DriverSpec, ...], custom: CustomParts) -> _Equipment:
    """Return the environments and drivers, kept for the next episodes that need the same."""
    if not _latest or _latest[0].given != (config, specs, custom):
        _close()
        _latest.append(_Equipment(config, specs, custom))
    return _latest[0]


def _drive(job: _Packed) -> EpisodeResult:
    if not _latest_bytes or _latest_bytes[0][0] != job.given:
        _close()
        config, specs, custom, how = cloudpickle.loads(job.given)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DrlAvWarning)  # the first process has warned
            _equipment(config, specs, custom).make_drivers()
        _latest_bytes.append((job.given, how))
    return _latest[0].drive(job.driver, job.seed, job.vehicles, *_latest_bytes[0][1])


def _close() -> None:
    _latest_bytes.clear()
    while _latest:
        _latest.pop().close()
