"""Evaluates drivers from a user's program: ``drl_av.evaluate``."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import Any, SupportsIndex, overload

from drl_av.config import Config
from drl_av.config.presets import PRESETS, require_driving_setting
from drl_av.drivers.driver import Driver
from drl_av.drivers.external import require_driver
from drl_av.drivers.registry import DriverSpec, driver_names, driving_config, find_drivers
from drl_av.env.custom import CustomParts, with_check
from drl_av.env.episode_start import require_numbers
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.env.observation import ObservationFunction
from drl_av.env.transition import RewardFunction
from drl_av.errors import ConfigError, DrlAvError, printable
from drl_av.evaluation.criterion import CriterionResult, judge
from drl_av.evaluation.criticality import CriticalityMetrics
from drl_av.evaluation.episodes import Evaluation, Setup, drive_episodes, warn_of_checks
from drl_av.evaluation.statistics import summarize
from drl_av.evaluation.trajectories import import_pandas
from drl_av.safety.check import SafetyCheck
from drl_av.scenarios.folder import with_scenario

Word = str | Path
"""A driver as the user names it on the command line, for example ``"idm"`` or a run's folder."""


class Results(list[EpisodeResult]):
    """The results of an evaluation: a list of episodes; a notebook shows them as a table.

    A part of it, and its sum with another list of episodes, are ``Results`` too.
    """

    def __add__(self, others: list[Any]) -> "Results":  # type: ignore[override]
        return Results([*self, *others])

    @overload
    def __getitem__(self, index: SupportsIndex) -> EpisodeResult: ...

    @overload
    def __getitem__(self, index: slice) -> "Results": ...

    def __getitem__(self, index: SupportsIndex | slice) -> "EpisodeResult | Results":
        found = super().__getitem__(index)
        return Results(found) if isinstance(found, list) else found

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame with one row for each episode; its columns are those of --out.

        Raises:
            DrlAvError: pandas is not installed.
        """
        names = {name for row in self for name in row.cells()}
        rows = [
            {name: value for name, value in asdict(row).items() if name in names} for row in self
        ]
        return import_pandas("to_pandas").DataFrame(rows)

    def _repr_html_(self) -> str:
        """Return the statistics of each driver, check and number of vehicles as an HTML table.

        If episodes of different settings cannot be told apart, it is a sentence that says so.
        """
        headings = ("vehicles", "driver", "check", "episodes", "speed, m/s", "reward", "ego hits")
        try:
            summaries = summarize(self)
        except DrlAvError as error:
            return f"<p>{escape(str(error))}</p>"
        rows = [
            (s.vehicles, s.driver, s.safety_check, s.episodes, s.speed_m_s, s.reward, s.ego_hits)
            for s in summaries
        ]
        lines = [
            "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in row)
            for tag, row in [("th", headings), *(("td", row) for row in rows)]
        ]
        return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"

    @property
    def judgements(self) -> list[CriterionResult]:
        """The judgements of the drivers that are not rule-based; empty without a rule-based one."""
        return judge(self)


def evaluate(
    drivers: Word | Iterable[Word] = (),
    *,
    own: Mapping[str, Driver] = MappingProxyType({}),
    vehicles: int | Iterable[int] | None = None,
    episodes: int = 50,
    seed: int = 0,
    jobs: int = 1,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    scenario: str | Path | None = None,
    safety_check: str | SafetyCheck | None = None,
    traffic: str | None = None,
    criticality: bool = False,
    reward: str | RewardFunction | None = None,
    observation: str | Iterable[str] | ObservationFunction | None = None,
) -> Results:
    """Evaluate all drivers in the same traffic, as ``drl-av evaluate`` does.

    Args:
        drivers: One driver or several, named as for ``load_driver``; without any driver, the
            shipped one.
        own: Further drivers, by their name in the results: objects with the methods ``start(seed)``
            and ``act(scene, observation)``.
        vehicles: Numbers of vehicles around the ego; by default those of the published tables, on
            an open road the number that its flow sustains, and in a scenario that places its
            vehicles their number.
        episodes: Number of episodes for each driver and number of vehicles.
        seed: Traffic seed of the first episode; the following episodes have the next seeds, which
            must be below 1,000,000.
        jobs: Number of processes. The results do not depend on it. With more than one, each process
            gets copies of your own objects, by cloudpickle.
        config: Settings. A dictionary or a TOML file changes settings of the default config, which
            is that of the first learned driver's training; ``pretrained`` drives under ``strict``.
            Without a learned driver, the default is the paper's settings. A Config or a preset
            replaces all settings. A learned driver keeps the [learning] settings of its training.
        scenario: Folder of a scenario, or the name of a shipped one.
        safety_check: ``"permit_all"``, ``"paper"`` or ``"strict"``, or your own: a function, or its
            name as ``"module:function"``. A driver's name may name another one for this driver,
            such as ``"pretrained@paper"``; without ``safety_check``, that of the first learned
            driver is also the check of all who name none.
        traffic: The name of a kind of traffic, whose settings ``config`` may change.
        criticality: Whether to return each row as a CriticalityResult, with the columns of
            ``--criticality``.
        reward: Your own reward, a function or its name as ``"module:function"``.
        observation: Your own observation for all drivers, as in ``gymnasium.make``, or its name as
            ``"module:name"``. Learned drivers need the observation of their training.

    Returns:
        A list with one EpisodeResult for each episode, ordered by number of vehicles, then seed,
            then driver. Its ``judgements`` say which drivers pass the comparison with the
            rule-based drivers.

    Raises:
        ConfigError, ScenarioError: an argument is wrong, or the vehicles do not fit on the road.
        RunError, CheckpointError: a driver cannot be loaded.
        SimulationError: SUMO ended unexpectedly.
    """
    given = vehicles if isinstance(vehicles, Iterable) else [vehicles]
    numbers: list[Any] = [] if vehicles is None else list(given)
    if vehicles is not None and not numbers:
        raise ConfigError("vehicles names no number of vehicles: name one, or leave it out.")
    for number in numbers:
        require_numbers(vehicles=(number, 0, None))
    require_numbers(episodes=(episodes, 1, None), seed=(seed, 0, None), jobs=(jobs, 1, None))
    if not isinstance(own, Mapping):
        raise ConfigError(
            f"own is a {type(own).__name__}, but must be a dictionary of drivers by name: write "
            "own={'mine': driver}."
        )
    for section, keys in config.items() if isinstance(config, Mapping) else ():
        for key in keys if isinstance(keys, Mapping) else ():
            require_driving_setting(name := f"{section}.{key}", name, "vehicles=[5, 10]")
    specs = _specs(drivers, own)
    settings = driving_config(specs, config, traffic)
    settings = with_scenario(settings, scenario, traffic)
    settings, own_check = with_check(settings, safety_check)
    is_complete = isinstance(config, Config) or (isinstance(config, str) and config in PRESETS)
    if safety_check is None and not is_complete:
        warn_of_checks(specs, settings.safety.check)
    metrics = CriticalityMetrics if criticality else EpisodeMetrics
    seeds = range(seed, seed + episodes)
    if isinstance(observation, Iterator):  # several environments read it
        observation = tuple(observation)
    custom = CustomParts(own_check, reward, observation)
    counts = [int(number) for number in numbers]
    evaluation = Evaluation(Setup(settings, tuple(specs), metrics, custom), counts, seeds)
    with closing(drive_episodes(evaluation.jobs, jobs)) as rows:
        return Results(rows)


def _specs(drivers: Any, own: Mapping[str, Driver]) -> list[DriverSpec]:
    is_one = isinstance(drivers, str | Path) or not isinstance(drivers, Iterable)
    words: list[Any] = [drivers] if is_one else list(drivers)
    for word in words:
        if not isinstance(word, str | Path):
            raise ConfigError(
                f"drivers has a {type(word).__name__}, but must have names and paths: pass a "
                "driver object as own={'mine': driver}, the driver of a function of yours as "
                "own={'mine': function(config)} or 'module:function'."
            )
    specs = list(find_drivers(words if own else words or ["pretrained"]))
    has_groups = any(spec.group for spec in specs)
    for name, driver in own.items():
        if not isinstance(name, str) or not name:
            raise ConfigError(f"own names a driver {name!r}, but a name must be a text.")
        if name.partition("@")[0] in driver_names():
            raise ConfigError(f"own names a driver {name!r}, as one of ours: choose another name.")
        require_driver(driver, f"The driver {name!r} in own", name)
        if name in {word for spec in specs for word in (spec.name, spec.group)}:
            raise ConfigError(f"Two drivers are called {name!r}: rename the one in own.")
        group = printable(name) if has_groups else ""
        specs.append(DriverSpec(printable(name), None, driver, group=group))
    return specs
