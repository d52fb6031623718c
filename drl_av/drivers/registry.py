"""Finds and makes the drivers of the ego by name: rule-based, shipped, learned and external ones.

To add a rule-based driver, write its file and add a line to ``RULE_DRIVERS``. The command line help
then lists it.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from drl_av.config import Config
from drl_av.config.presets import PRESETS, as_config
from drl_av.config.schema import did_you_mean
from drl_av.drivers import policy_file
from drl_av.drivers.driver import Driver
from drl_av.drivers.external import LOADERS, driver_of_factory, is_factory
from drl_av.drivers.learned import MARGINS, LearnedDriver, Margins, learned_driver, respects_mobil
from drl_av.drivers.masked_policy import MaskedPolicyDriver, is_actor, load_actor
from drl_av.drivers.network import Layers
from drl_av.drivers.planner.driver import PlannerDriver
from drl_av.drivers.rule_based import (
    TUNED,
    GapMobilDriver,
    IdmDriver,
    IdmSumoDriver,
    MobilDriver,
    NoPassingOnTheRight,
    RandomDriver,
    SumoDriver,
)
from drl_av.driving.affordances import observed_indicators
from drl_av.errors import ConfigError, RunError
from drl_av.safety import named_check
from drl_av.safety.check import SafetyCheck
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.vehicle_calls import EgoModel

RULE_DRIVERS: dict[str, Callable[[Config], Driver]] = {
    "idm": lambda config: IdmDriver(config.safety),
    "idm-mobil": lambda config: MobilDriver(config.safety, config.ego, config.mobil),
    "gap-mobil": lambda config: GapMobilDriver(config.safety, config.ego, config.mobil, 1.1),
    "gap-mobil-1.3": lambda config: GapMobilDriver(config.safety, config.ego, config.mobil, 1.3),
    "idm-sumo": lambda config: IdmSumoDriver(config.safety),
    "sumo": lambda config: SumoDriver(EgoModel()),
    "sumo-tuned": lambda config: SumoDriver(
        TUNED._replace(overtake_right=config.ego.overtake_right)
    ),
    "planner": PlannerDriver,
    "random": lambda config: RandomDriver(),
}
"""For each rule-based driver, by name, the function that makes it from an environment's config.

Each worker process has its own copy of this table. An evaluation with a driver that your program
adds at run time can therefore use one process only.
"""

DRIVES_UNDER = {"pretrained": "strict", "pretrained-smooth": "strict"}
"""The safety check under which a shipped driver drives by default, if its training had another."""

DRIVER_FILES = (".safetensors", *LOADERS)
"""Suffixes of the files from which a driver can be loaded."""


@dataclass(frozen=True)
class DriverSpec:
    """A driver that the user requests: its name and its source."""

    name: str
    """Name of the driver in the results, unique among the requested drivers."""
    run: Path | None
    """The run's folder or the driver's file; None for a rule-based driver or a factory."""
    own: Driver | None = None
    """The driver object that the user's program passes; None if ``name`` is to be loaded."""
    check: str | None = None
    """The safety check under which it drives by default; None for that of its training."""

    @property
    def is_external(self) -> bool:
        """Whether the driver's file is a zip or ONNX file, which holds no config of drl-av."""
        return self.run is not None and self.run.suffix.lower() in LOADERS

    @cached_property
    def learned(self) -> "tuple[LearnedDriver, Config] | None":
        """The driver and the config of its training, read once; None if it has no Q-networks.

        Raises:
            RunError, CheckpointError: as ``load_learned``.
        """
        if self.run is None or self.is_external or self.actor is not None:
            return None
        return load_learned(self.run)

    @cached_property
    def actor(self) -> "tuple[Layers, Config] | None":
        """The layers and the config of a training at scale, read once; None for other drivers.

        Raises:
            RunError, CheckpointError: as ``load_learned``.
        """
        if self.run is None or self.is_external:
            return None
        file = policy_file.find_policy(self.run)
        return load_actor(file) if is_actor(file) else None

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for a worker process, which reads the driver itself."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def driver_names() -> tuple[str, ...]:
    """Return the names of the rule-based and of the shipped drivers."""
    return *RULE_DRIVERS, *policy_file.SHIPPED


def baselines(names: Iterable[str]) -> list[str]:
    """Return those names that belong to baselines, with which other drivers are compared.

    The baselines are the rule-based drivers except ``planner``, which searches among plans.
    """
    return [name for name in dict.fromkeys(names) if name in RULE_DRIVERS and name != "planner"]


MAX_BYTES = 1_000_000_000
"""The largest zip or ONNX file that is read as a driver."""


def find_drivers(words: Iterable[str | Path]) -> tuple[DriverSpec, ...]:
    """Find the driver that each word names; a repeated word counts once.

    A word is one of ``driver_names``, a path, or a factory, as for ``load_driver``. A driver with a
    path is named after the last part of it, or after the whole path if another has that name.

    Raises:
        ConfigError: a word names no driver, or a zip or ONNX file larger than ``MAX_BYTES``.
    """
    runs: dict[str, Path | None] = {}
    given = (str(word.absolute()) if isinstance(word, Path) else word for word in words)
    for word in dict.fromkeys(given):
        if word in RULE_DRIVERS:
            runs[word] = None
        elif word in policy_file.SHIPPED:
            runs[word] = policy_file.SHIPPED[word]
        elif os.path.exists(word):
            runs[word] = _existing(Path(word))
        elif is_factory(word):
            runs[word] = None
        else:
            raise _unknown(word)
    named = {*driver_names(), *filter(is_factory, runs)}
    last = {word: Path(word).absolute().name for word in runs}
    short = {word: word if {word, last[word]} & named else last[word] for word in runs}
    count = Counter(short.values())
    return tuple(
        DriverSpec(
            short[word] if count[short[word]] == 1 else word, run, check=DRIVES_UNDER.get(word)
        )
        for word, run in runs.items()
    )


def _existing(path: Path) -> Path:
    """Return the path of a driver; raise ConfigError if it cannot be one."""
    suffix = path.suffix.lower()
    if path.is_file() and suffix not in (*DRIVER_FILES, *policy_file.OTHER_FILES):
        raise ConfigError(
            f"{path} is no driver: name a run's folder, or a file that ends in "
            f"{', '.join(DRIVER_FILES[:-1])} or {DRIVER_FILES[-1]}."
        )
    if suffix in LOADERS and not path.is_file():
        raise ConfigError(f"The driver {path} is no regular file: name a file, or rename it.")
    if suffix in LOADERS and path.stat().st_size > MAX_BYTES:
        raise ConfigError(
            f"The driver {path} is larger than {MAX_BYTES // 10**6} MB: name the file of a network."
        )
    return path


def _unknown(word: str) -> ConfigError:
    names, suffix = driver_names(), Path(word).suffix
    if suffix in (*DRIVER_FILES, ".npz"):
        return ConfigError(f"There is no file {word}: correct its path.")
    hint = did_you_mean(word, names)
    return ConfigError(
        f"There is no driver or run folder {word!r}{hint}; the drivers are: {', '.join(names)}."
    )


def default_config(specs: Sequence[DriverSpec]) -> Config:
    """Return the config of the first learned driver, or the default config without one.

    It is the config of the driver's training, with the safety check of ``DRIVES_UNDER``.

    Raises:
        RunError: the run of that driver does not exist, or has not saved a policy yet.
        CheckpointError: the policy file of that driver is damaged.
    """
    for spec in specs:
        if found := spec.learned or spec.actor:
            config = found[1]
            return config.updated("safety", check=spec.check) if spec.check else config
    return Config()


def driving_config(
    specs: Sequence[DriverSpec],
    given: Config | Mapping[str, Any] | str | Path | None,
    traffic: str | None = None,
) -> Config:
    """Return the config of an environment for these drivers.

    ``given`` is the argument ``config`` of the public functions. A dictionary or a TOML file
    changes settings of ``default_config``, in the kind of traffic ``traffic`` if there is one. A
    Config or a preset replaces all settings but the margins of the first learned driver.

    Raises:
        ConfigError: ``given`` is no config, or a setting in it is wrong.
        RunError, CheckpointError: as ``default_config``.
    """
    own = default_config(specs)
    config = as_config(given, own if traffic is None else own.with_traffic(traffic))
    is_complete = isinstance(given, Config) or (isinstance(given, str) and given in PRESETS)
    margins = {name: getattr(own.learning, name) for name in MARGINS} if is_complete else {}
    return config.updated("learning", **margins)


def make_drivers(
    specs: Sequence[DriverSpec], config: Config, check: SafetyCheck | None = None
) -> dict[str, Driver]:
    """Load or build each driver for an environment with this config; the keys are their names.

    If ``config.learning`` has the margins of the first learned driver, each learned driver keeps
    its own. Otherwise all learned drivers use those of ``config.learning``, even if they are 0.
    ``check`` is the environment's safety check; by default it is made if a driver asks it.

    Raises:
        RunError: a run has no policy file; or a learned driver was trained with other settings of
            [observation] or another ``ego.max_speed_m_s``.
        ScenarioError: a learned driver needs the check of a scenario that cannot be read.
        CheckpointError: a file is damaged or holds no driver, or a driver with another observation.
        ConfigError: a factory does not work, or no rule-based driver has the name.
    """
    drivers: dict[str, Driver] = {}
    trained = [Margins.of(spec.learned[1].learning) for spec in specs if spec.learned]
    margins = Margins.of(config.learning)

    def its_check() -> SafetyCheck:
        return _check(config) if check is None else check

    for spec in specs:
        name, run = spec.name, spec.run
        if run is None:
            drivers[name] = rule_driver(name, config) if spec.own is None else spec.own
            continue
        if spec.actor is not None:
            drivers[name] = _actor_driver(name, spec.actor, config, its_check())
            continue
        if spec.learned is None:
            observed = len(observed_indicators(config.observation))
            drivers[name] = LOADERS[run.suffix.lower()](run, observed, its_check)
            continue
        driver, own = spec.learned
        if own.learning.permitted_only:
            driver = driver.limited_to(respects_mobil(its_check(), config.mobil))
        drivers[name] = driver if margins == trained[0] else driver.with_margins(margins)
        same_scale = own.ego.max_speed_m_s == config.ego.max_speed_m_s
        if own.observation != config.observation or not same_scale:
            raise RunError(
                f"{name} was trained with other [observation] settings or another "
                "ego.max_speed_m_s than it would drive with here: evaluate it alone, without "
                "settings that change them."
            )
    return drivers


def _actor_driver(
    name: str, actor: tuple[Layers, Config], config: Config, check: SafetyCheck
) -> Driver:
    """Return the driver of a training at scale for an environment with this config and check.

    Raises:
        RunError: it was trained with another range of observation or ``ego.max_speed_m_s``.
    """
    layers, own = actor
    seen = [(each.observation.range_m, each.ego.max_speed_m_s) for each in (own, config)]
    if seen[0] != seen[1]:
        raise RunError(
            f"{name} was trained with another observation.range_m or ego.max_speed_m_s than it "
            "would drive with here: leave these settings as they are."
        )
    scenario = load_scenario(find_scenario(config.simulation.scenario))
    return MaskedPolicyDriver(layers, check, scenario.road, config)


def _check(config: Config) -> SafetyCheck:
    """Return the safety check of an environment with this config, for its scenario's vehicles."""
    scenario = load_scenario(find_scenario(config.simulation.scenario))
    return named_check(config, scenario.vehicle_types, scenario.road)


def rule_driver(name: str, config: Config) -> Driver:
    """Make the rule-based driver of this name, or the driver of a factory ``module:factory``.

    A rule-based driver passes on the right only if ``ego.overtake_right`` permits it.

    Raises:
        ConfigError: there is no such driver, or the factory does not work.
    """
    if name not in RULE_DRIVERS and is_factory(name):
        return driver_of_factory(name, config)
    if name not in RULE_DRIVERS:
        raise _unknown(name)
    driver = RULE_DRIVERS[name](config)
    if config.ego.overtake_right or isinstance(driver, SumoDriver | PlannerDriver):
        return driver
    return NoPassingOnTheRight(driver, config.ego)


def load_driver(
    driver: str | Path, config: Config | Mapping[str, Any] | str | Path | None = None
) -> Driver:
    """Load a driver by its name, file or folder.

    Call ``driver.start(seed)`` before each episode; then ``driver.act(env.unwrapped.scene,
    observation).number`` is the action for ``env.step``. ``sumo`` and ``sumo-tuned`` have no
    actions; for them call ``env.unwrapped.hand_over(driver.model)`` after each reset.

    Args:
        driver: The name of a shipped or rule-based driver, a run's folder, a policy file, a
            stable-baselines3 zip file, an ONNX file, or a factory as ``module:factory``.
        config: The config of the environment, as in ``gymnasium.make``. A dictionary or a TOML file
            changes only the settings that it names; the others are the driver's own. A Config or a
            preset replaces all settings but the driver's margins.

    Raises:
        ConfigError: there is no such driver, or a setting is wrong.
        RunError, CheckpointError: the file cannot be used, or another observation was trained.
    """
    if not isinstance(driver, str | Path):
        raise ConfigError(
            f"driver is a {type(driver).__name__}, but must be a name, a path or "
            "'module:function'; a driver object needs no loading."
        )
    specs = find_drivers([driver])
    return make_drivers(specs, driving_config(specs, config))[specs[0].name]


def load_learned(path: Path) -> tuple[LearnedDriver, Config]:
    """Read a learned driver and its config from a run's folder or a policy file.

    Unlike that of ``make_drivers``, this driver may propose any action, also with the setting
    ``learning.permitted_only``.

    Raises:
        RunError: there is no policy file.
        CheckpointError: the policy file is damaged, or its config differs from the folder's.
    """
    networks, config = policy_file.load_run(path)
    return learned_driver(networks, config), config
