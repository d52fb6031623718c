"""Drives several drivers through the same seeded traffic, for comparison."""

import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import lru_cache
from itertools import groupby, product
from typing import NamedTuple

import cloudpickle

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import DriverSpec, default_config, make_drivers
from drl_av.env.custom import NOTHING_CUSTOM, CustomParts
from drl_av.env.episode_start import TRAINING_SEED_RANGE
from drl_av.env.highway import HighwayEnv
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.observation import default_groups
from drl_av.env.rollout import drive
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError, DrlAvWarning, warn
from drl_av.evaluation import DENSITIES, LOKY
from drl_av.evaluation.engines import ENGINES
from drl_av.evaluation.recording import RecordingFolder, recording_of
from drl_av.simulation.sumo_options import require_one_process

MakeMetrics = Callable[[], EpisodeMetrics]
"""A function that makes the metrics of one episode; worker processes must be able to import it."""


class Setup(NamedTuple):
    """What the result of an episode depends on beside its traffic and driver."""

    config: Config
    specs: tuple[DriverSpec, ...]
    """The drivers that are loaded together (see ``make_drivers``)."""
    make_metrics: MakeMetrics = EpisodeMetrics
    """Makes the metrics of an episode, which compute its row of the results."""
    custom: CustomParts = NOTHING_CUSTOM
    """The user's own check, reward and observation."""
    recordings: RecordingFolder | None = None
    """The folder that keeps the recordings; None keeps none."""


def warn_of_checks(specs: Sequence[DriverSpec], check: str) -> None:
    """Warn if some drivers without a named check would by themselves drive under another one.

    ``check`` is that of the evaluation. Rule-based drivers and factories have no check of their
    own; an agent's zip file alone would drive under that of the default config.
    """
    own = {}
    for spec in specs:
        if spec.run is not None and spec.under is None:
            own[spec.name] = default_config([spec]).safety.check
    others = {name: each for name, each in own.items() if each != check}
    if others:
        named = ", ".join(f"{name} by itself under {each}" for name, each in others.items())
        example = "@".join(next(iter(others.items())))
        warn(
            f"All drivers without a named check drive under {check}, but {named}: name one check "
            f"with --safety-check (safety_check=), or a driver's own, such as {example}."
        )


class EpisodeJob(NamedTuple):
    """One episode to drive: everything on which its result depends."""

    setup: Setup
    vehicles: int
    seed: int
    driver: str
    """The name of one of the drivers of ``setup``."""

    @property
    def key(self) -> tuple[int, int, str]:
        """Number of vehicles, traffic seed and driver."""
        return self.vehicles, self.seed, self.driver


class Evaluation:
    """The drivers, the numbers of vehicles around the ego and the traffic seeds of an evaluation.

    If ``vehicles`` is empty, the numbers are those of the published tables, or the number that the
    scenario places.

    Raises:
        RunError, CheckpointError: a learned driver cannot be read.
        ConfigError, ScenarioError: the vehicles do not fit on the road, or a seed is reserved for
            training (1,000,000 and above).
    """

    def __init__(self, setup: Setup, vehicles: Sequence[int], seeds: range) -> None:
        if seeds[-1] >= TRAINING_SEED_RANGE[0]:
            raise ConfigError(
                f"The last episode's seed would be {seeds[-1]}, but those from "
                f"{TRAINING_SEED_RANGE[0]} on belong to training: begin with a smaller one, or "
                "drive fewer episodes."
            )
        self.setup, self._seeds = setup, seeds
        _close()  # a driver may have been trained since
        equipment = _equipment(setup)
        env = equipment.env(setup.config, setup.custom)
        implied = env.simulation.fleet.default_vehicle_count
        default = DENSITIES if implied is None else (implied,)
        self._vehicles = tuple(dict.fromkeys(vehicles)) or default
        for number in self._vehicles:
            env.require_room(number)
        equipment.make_drivers()

    @property
    def jobs(self) -> list[EpisodeJob]:
        """The episodes in their order: by number of vehicles, then seed, then driver."""
        names = [spec.name for spec in self.setup.specs]
        episodes = product(self._vehicles, self._seeds, names)
        return [EpisodeJob(self.setup, *episode) for episode in episodes]


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
                yield _equipment(job.setup).drive(*job.key)
        finally:
            _close()
        return
    if episodes:
        require_one_process(episodes[0].setup.custom.sumo_options)
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
    given, usual = custom.observation, default_groups(env.config.observation)
    is_usual = given is None or (isinstance(given, list | tuple) and tuple(given) == usual)
    seen = None if is_usual else env.observation_space
    return make_drivers(specs, env.config, env.safety_check, seen)


def _packed(episodes: Sequence[EpisodeJob]) -> list[tuple[bytes, tuple[int, int, str]]]:
    """Return the jobs for other processes; objects of the user become bytes by cloudpickle."""
    packed = []
    for setup, jobs in groupby(episodes, lambda job: job.setup):
        try:
            given = cloudpickle.dumps(setup)
        except Exception as error:  # the user's objects may raise anything
            raise ConfigError(
                f"An object of yours cannot be copied into another process ({error}): use jobs=1, "
                "or name it as 'module:name'."
            ) from error
        packed += [(given, job.key) for job in jobs]
    return packed


class _Equipment:
    """The environments of an evaluation, one for each safety check, and its drivers."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self._parts = {
            spec.name: (spec.config(setup.config), setup.custom.beside(spec.under))
            for spec in setup.specs
        }
        self._groups = {spec.name: spec.group for spec in setup.specs}
        self._envs: dict[Config, HighwayEnv] = {}
        self._drivers: dict[str, Driver] = {}

    def env(self, config: Config, custom: CustomParts) -> HighwayEnv:
        """Return the environment with these settings, which starts SUMO at its first reset."""
        if config not in self._envs:
            self._envs[config] = HighwayEnv(config=config, **custom._asdict())
        return self._envs[config]

    def make_drivers(self) -> None:
        """Make the environments and then the drivers, as a driver's file may run its code."""
        config, specs, _, custom, _ = self.setup
        for parts in self._parts.values():
            self.env(*parts)
        self._drivers = drivers_in(self.env(config, custom), custom, specs)

    def drive(self, vehicles: int, seed: int, name: str) -> EpisodeResult:
        """Drive one episode with the driver of this name, under its safety check."""
        if not self._drivers:
            self.make_drivers()
        env, recordings = self.env(*self._parts[name]), self.setup.recordings
        decisions = list[Transition]()
        driven = env, self._drivers[name], name, seed, vehicles, self.setup.make_metrics
        result = drive(*driven, [] if recordings is None else [decisions.append])
        if recordings is not None:
            recordings.keep(recording_of(decisions, env, name, seed), result)
        return replace(result, group=self._groups[name])

    def close(self) -> None:
        """Close all environments."""
        while self._envs:
            self._envs.popitem()[1].close()


_latest: list[_Equipment] = []
"""The environments and drivers of the latest episode of this process; empty at first."""


def _equipment(setup: Setup) -> _Equipment:
    """Return the environments and drivers, kept for the next episodes that need the same."""
    if not _latest or _latest[0].setup != setup:
        _close()
        _latest.append(_Equipment(setup))
    return _latest[0]


@lru_cache(1)
def _unpacked(setup: bytes) -> _Equipment:
    """Return the environments and drivers, in another process than the first."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DrlAvWarning)  # the first process has warned
        equipment = _equipment(cloudpickle.loads(setup))
        equipment.make_drivers()
    return equipment


def _drive(job: tuple[bytes, tuple[int, int, str]]) -> EpisodeResult:
    setup, episode = job
    return _unpacked(setup).drive(*episode)


def _close() -> None:
    while _latest:
        _latest.pop().close()
