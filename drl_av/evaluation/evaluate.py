"""Evaluates drivers from a user's program: ``drl_av.evaluate``."""

from collections.abc import Iterable, Mapping
from contextlib import closing
from numbers import Integral
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeGuard

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.external import is_driver, require_methods
from drl_av.drivers.registry import DriverSpec, driving_config, find_drivers
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.errors import ConfigError
from drl_av.evaluation.comparison import Evaluation
from drl_av.evaluation.criterion import CriterionResult, judge
from drl_av.evaluation.criticality import CriticalityMetrics
from drl_av.scenarios.folder import with_scenario

Word = str | Path
"""A driver as the user names it on the command line, for example ``"idm"`` or a run's folder."""


class Results(list[EpisodeResult]):
    """The results of an evaluation: a list of episodes."""

    @property
    def judgements(self) -> list[CriterionResult]:
        """The judgements of the drivers that are not rule-based; empty without a rule-based one."""
        return judge(self)


def evaluate(
    drivers: Word | Iterable[Word] = (),
    *,
    own: Mapping[str, Driver] = MappingProxyType({}),
    vehicles: int | Iterable[int] = (),
    episodes: int = 50,
    seed: int = 0,
    jobs: int = 1,
    config: Config | Mapping[str, Any] | str | Path | None = None,
    scenario: str | Path | None = None,
    safety_check: str | None = None,
    traffic: str | None = None,
    criticality: bool = False,
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
        jobs: Number of processes; it must be 1 with ``own``. The results do not depend on it.
        config: Settings. A dictionary or a TOML file changes settings of the default config, which
            is that of the first learned driver's training; ``pretrained`` and ``pretrained-smooth``
            drive under ``strict``. Without a learned driver, the default is the paper's settings. A
            Config or a preset replaces all settings but the margins of learned drivers.
        scenario: Folder of a scenario, or the name of a shipped one.
        safety_check: ``"permit_all"``, ``"paper"`` or ``"strict"``.
        traffic: The name of a kind of traffic, whose settings ``config`` may change.
        criticality: Whether to return each row as a CriticalityResult, with the columns of
            ``--criticality``.

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
    numbers = [_whole("vehicles", number, 0) for number in given]
    episodes, seed = _whole("episodes", episodes, 1), _whole("seed", seed, 0)
    jobs = _whole("jobs", jobs, 1)
    if not isinstance(own, Mapping):
        raise ConfigError(
            f"own is a {type(own).__name__}, but must be a dictionary of drivers by name: write "
            "own={'mine': driver}."
        )
    if own and jobs > 1:
        raise ConfigError(
            "The drivers in own are objects and drive in one process: name a factory as "
            "'module:factory' among the drivers instead, or use jobs=1."
        )
    specs = _specs(drivers if _is_several(drivers) else [drivers], own)
    settings = driving_config(specs, config, traffic)
    settings = with_scenario(settings, scenario)
    if safety_check is not None:
        settings = settings.updated("safety", check=safety_check)
    metrics = CriticalityMetrics if criticality else EpisodeMetrics
    seeds = range(seed, seed + episodes)
    evaluation = Evaluation(settings, specs, numbers, seeds, metrics)
    with closing(evaluation.rows(jobs)) as rows:
        return Results(rows)


def _is_several(drivers: object) -> TypeGuard[Iterable[Word]]:
    return isinstance(drivers, Iterable) and not isinstance(drivers, str | Path)


def _specs(drivers: Iterable[Any], own: Mapping[str, Driver]) -> list[DriverSpec]:
    words = list(drivers)
    for word in words:
        if not isinstance(word, str | Path):
            raise ConfigError(
                f"drivers has a {type(word).__name__}, but must have names and paths: pass a "
                "driver object as own={'mine': driver}, the driver of a function of yours as "
                "own={'mine': function(config)} or 'module:function'."
            )
    specs = list(find_drivers(words if own else words or ["pretrained"]))
    for name, driver in own.items():
        if not isinstance(name, str) or not name:
            raise ConfigError(f"own names a driver {name!r}, but a name must be a text.")
        if not is_driver(driver):
            raise ConfigError(
                f"The driver {name!r} in own is a {type(driver).__name__}, but must be an object "
                "with start(seed) and act(scene, observation): a class or a function has to be "
                "called."
            )
        require_methods(driver, name)
        if name in [spec.name for spec in specs]:
            raise ConfigError(f"Two drivers are called {name!r}: rename the one in own.")
        specs.append(DriverSpec(name, None, driver))
    return specs


def _whole(name: str, value: object, least: int) -> int:
    """Return ``value`` as an int; raise ConfigError unless it is whole and at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise ConfigError(f"{name} is {value!r}, but must be a whole number from {least} on.")
    return int(value)
