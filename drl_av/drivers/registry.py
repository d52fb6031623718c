"""Finds and makes the drivers of the ego by name: rule-based, shipped, learned and external ones.

To add a rule-based driver, write its file and add a line to ``RULE_DRIVERS``.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.config import Config, TrafficConfig
from drl_av.config.functions import is_factory
from drl_av.config.presets import as_config
from drl_av.config.section import did_you_mean
from drl_av.drivers import policy_file
from drl_av.drivers.checked import SteadyDriver
from drl_av.drivers.driver import Driver
from drl_av.drivers.external import LOADERS, driver_of_factory
from drl_av.drivers.groups import trainings_of
from drl_av.drivers.learned import (
    LearnedDriver,
    actor_driver,
    is_actor,
    load_actor,
    load_learned,
    require_same_observation,
)
from drl_av.drivers.network import Layers
from drl_av.drivers.onnx import exported_config
from drl_av.drivers.rule_based import (
    TUNED,
    IdmDriver,
    IdmSumoDriver,
    MobilDriver,
    RandomDriver,
    SumoDriver,
)
from drl_av.errors import ConfigError, printable
from drl_av.safety import CHECKS, named_check
from drl_av.safety.check import SafetyCheck
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.vehicle_calls import EgoModel

if TYPE_CHECKING:
    from gymnasium.spaces import Space

RULE_DRIVERS: dict[str, Callable[[Config], Driver]] = {
    "idm": lambda config: IdmDriver(config.safety),
    "idm-mobil": lambda config: MobilDriver(config.safety, config.ego, config.mobil),
    "gap-mobil": lambda config: MobilDriver(config.safety, config.ego, config.mobil, 1.1),
    "gap-mobil-1.3": lambda config: MobilDriver(config.safety, config.ego, config.mobil, 1.3),
    "idm-sumo": lambda config: IdmSumoDriver(config.safety),
    "sumo": lambda config: SumoDriver(EgoModel()),
    "sumo-tuned": lambda config: SumoDriver(TUNED),
    "random": lambda config: RandomDriver(),
}
"""For each rule-based driver, by name, the function that makes it from an environment's config.

Each worker process has its own copy of this table. An evaluation with a driver that your program
adds at run time can therefore use one process only.
"""

PLANNER, PLANNER_FACTORY = "planner", "drl_av.env.planner:planner"
"""The driver that searches with ``pretrained`` as its base, and where it is made."""
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
    under: str | None = None
    """The safety check that the user names with it, as in ``pretrained@paper``; None for that of
    the evaluation."""
    group: str = ""
    """The name under which several trainings are compared; "" if there are no groups."""

    @property
    def is_external(self) -> bool:
        """Whether the driver is a zip or ONNX file."""
        return self.run is not None and self.run.suffix.lower() in LOADERS

    @property
    def is_planner(self) -> bool:
        """Whether it is the driver that searches."""
        return self.own is None and _without_check(self.name) == PLANNER

    def config(self, config: Config) -> Config:
        """Return an evaluation's config with the safety check under which this driver drives."""
        return config if self.under is None else config.updated("safety", check=self.under)

    @cached_property
    def learned(self) -> "tuple[LearnedDriver, Config] | None":
        """The driver and the config of its training, read once; None if it has no Q-networks.

        Raises the errors of ``load_learned``.
        """
        if self.run is None or self.is_external or self.actor is not None:
            return None
        return load_learned(self.run)

    @cached_property
    def actor(self) -> "tuple[Layers, Config] | None":
        """The layers and the config of a training at scale, read once; None for other drivers.

        Raises the errors of ``load_learned``.
        """
        if self.run is None or self.is_external:
            return None
        return load_actor(self.run) if is_actor(policy_file.find_policy(self.run)) else None

    @cached_property
    def trained_with(self) -> Config | None:
        """The config of the driver's training, also of one that was exported to ONNX, or None.

        Raises the errors of ``load_learned``.
        """
        if self.is_external and self.run is not None:
            return exported_config(self.run) if self.run.suffix.lower() == ".onnx" else None
        found = self.learned or self.actor
        return None if found is None else found[1]

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for a worker process, which reads the driver itself."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def driver_names() -> tuple[str, ...]:
    """Return the names of the rule-based and of the shipped drivers."""
    return *RULE_DRIVERS, *policy_file.SHIPPED, PLANNER


def baselines(names: Iterable[str]) -> list[str]:
    """Return those names that belong to rule-based drivers, with which others are compared."""
    return [name for name in dict.fromkeys(names) if _without_check(name) in RULE_DRIVERS]


def _without_check(name: str) -> str:
    """Return a driver's name without the check that may follow an @."""
    own, _, check = name.rpartition("@")
    return own if check in CHECKS else name


BEST = "best_model.zip"
"""What stable-baselines3's EvalCallback writes in every folder; the folder belongs to its name."""


def find_drivers(words: Iterable[str | Path]) -> tuple[DriverSpec, ...]:
    """Find the driver that each word names; a repeated word counts once.

    A word is one of ``driver_names``, a path, or a factory, as for ``load_driver``; ``@`` and the
    name of a safety check may follow, such as ``pretrained@paper``. A driver with a path is named
    after the last part of it (``BEST``: the last two), or after the whole path if another has that
    name. A name shows control characters as escapes. A word ``NAME=PATTERN`` names the trainings of
    a group, whose drivers are called ``NAME/LAST``; a driver beside a group is a group of its own.

    Raises:
        ConfigError: a word names no driver or check, or a group has the name of another driver or
            a driver of another group.
    """
    runs: dict[str, Path | None] = {}
    groups: dict[str, str] = {}
    for given in words:
        word = str(given.absolute()) if isinstance(given, Path) else given
        group, trainings = trainings_of(word)
        for each in trainings:
            if (known := groups.setdefault(each, group)) != group:
                where = sorted(f"in the group {one}" if one else "alone" for one in (known, group))
                raise ConfigError(f"{each} is named twice, {' and '.join(where)}: name it once.")
            if group in driver_names():
                raise ConfigError(f"{group} is the name of a driver that ships: rename {word}.")
    for word in groups:
        own, _ = _with_check(word)
        if own in RULE_DRIVERS:
            runs[word] = None
        elif own in policy_file.SHIPPED:
            runs[word] = policy_file.SHIPPED[own]
        elif own == PLANNER:
            runs[word] = policy_file.SHIPPED["pretrained"]
        elif os.path.exists(own):
            runs[word] = _existing(Path(own))
        elif is_factory(own):
            runs[word] = None
        else:
            raise _unknown(own)
    named = {*driver_names(), *filter(is_factory, runs)}
    parts = {word: Path(word).absolute().parts for word in runs}
    last = {w: "/".join(p[-1 - p[-1].startswith(BEST) :]) for w, p in parts.items()}
    short = {w: w if {*map(_without_check, (w, last[w]))} & named else last[w] for w in runs}
    count = Counter((groups[word], name) for word, name in short.items())
    specs = []
    for word, run in runs.items():
        (_, under), group = _with_check(word), groups[word]
        name = printable(short[word] if count[group, short[word]] == 1 else word)
        if any(groups.values()):
            name, group = (f"{group}/{name}", group) if group else (name, name)
        specs.append(DriverSpec(name, run, under=under, group=group))
    times = Counter(spec.name for spec in specs)
    for spec, word in zip(specs, runs, strict=True):
        if times[spec.name] > 1 or (not groups[word] and spec.name in groups.values()):
            raise ConfigError(
                f"{word} would be called {spec.name}, as another driver or a group: rename its "
                "folder or the group."
            )
    return tuple(specs)


def _with_check(word: str) -> tuple[str, str | None]:
    """Return a driver's word without the check that may follow an @, and this check or None."""
    own, at, check = word.rpartition("@")
    if not at or os.path.exists(word):
        return word, None
    if check not in CHECKS:
        raise ConfigError(
            f"{word!r} names the safety check {check!r}{did_you_mean(check, CHECKS)}, but must "
            f"name one of: {', '.join(CHECKS)}."
        )
    return own, check


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
    return path


def _unknown(word: str) -> ConfigError:
    names, suffix = driver_names(), Path(word).suffix.lower()
    if suffix in (*DRIVER_FILES, ".npz"):
        return ConfigError(f"There is no file {word}: correct its path.")
    what = f"{word!r}{did_you_mean(word, names)}; the drivers are: {', '.join(names)}."
    own = " One of yours is written module:function." if suffix == ".py" or ":" in word else ""
    return ConfigError(f"There is no driver or run folder {what}{own}")


def find_driver(word: str | Path) -> DriverSpec:
    """Find the driver that a word names, as ``find_drivers`` does; one that names more is refused.

    Raises:
        ConfigError: there is no such driver, or the word names several.
    """
    found = find_drivers([word])
    if len(found) > 1:
        raise ConfigError(f"{word} names {len(found)} trainings: name one of them.")
    return found[0]


def default_config(specs: Sequence[DriverSpec]) -> Config:
    """Return the config of the first driver that drl-av trained, or the default config without one.

    It is that of the driver's training, in SUMO, with the safety check that the user names with it.
    If the training drew the kind of traffic of each episode, the traffic is the default one.

    Raises:
        RunError: the run of that driver does not exist, or has not saved a policy yet.
        CheckpointError: the policy file of that driver is damaged.
    """
    for spec in specs:
        if (own := spec.trained_with) is not None:
            config = spec.config(own.updated("simulation", world="sumo"))
            return replace(config, traffic=TrafficConfig()) if config.traffic.presets else config
    return Config()


def driving_config(
    specs: Sequence[DriverSpec],
    given: Config | Mapping[str, Any] | str | Path | None,
    traffic: str | None = None,
) -> Config:
    """Return the config of an environment for these drivers.

    ``given`` is the argument ``config`` of the public functions. A dictionary or a TOML file
    changes settings of ``default_config``, a Config or a preset replaces them all; ``traffic``, if
    there is one, is the kind of traffic.

    Raises:
        ConfigError: ``given`` is no config, or a setting in it is wrong.
        RunError, CheckpointError: as ``default_config``.
    """
    return as_config(given, default_config(specs), traffic)


def make_drivers(
    specs: Sequence[DriverSpec],
    config: Config,
    check: SafetyCheck | None = None,
    own_observation: "Space[Any] | None" = None,
) -> dict[str, Driver]:
    """Load or build each driver for an environment with this config; the keys are their names.

    A learned driver keeps the [learning] settings of its training, such as its mirror. With
    ``driver.hold_s`` each is a ``SteadyDriver``, but SUMO's own. ``check`` is the environment's
    safety check, which is made if a driver asks it; ``own_observation`` is the space of the
    environment's observation, if that is the user's.

    Raises:
        RunError: a run has no policy file; or a learned driver was trained with other settings of
            [observation], another ``ego.max_speed_m_s`` or another observation.
        ScenarioError: a learned driver needs the check of a scenario that cannot be read.
        CheckpointError: a file is damaged or holds no driver, or a driver with another observation.
        ConfigError: a factory does not work, or no rule-based driver has the name.
    """
    drivers: dict[str, Driver] = {}

    def its_check(spec: DriverSpec) -> SafetyCheck:
        if check is not None and not spec.under:
            return check
        scenario = load_scenario(find_scenario(config.simulation.scenario))
        return named_check(spec.config(config), scenario.vehicle_types, scenario.road)

    for spec in specs:
        name, driven_by = spec.name, spec.config(config)
        if spec.is_planner:
            drivers[name] = driver_of_factory(PLANNER_FACTORY, driven_by)
        elif spec.actor is not None:
            drivers[name] = actor_driver(name, spec.actor, driven_by, its_check(spec))
        elif spec.learned is not None:
            drivers[name], own = spec.learned
            require_same_observation(name, own, config, own_observation)
        elif spec.own is not None:
            drivers[name] = spec.own
        elif not spec.is_external:
            drivers[name] = rule_driver(_without_check(name), driven_by)
    for spec in specs:  # at the end: a zip file is not loaded if another driver is refused
        if spec.is_external and spec.run is not None:
            load = LOADERS[spec.run.suffix.lower()]
            drivers[spec.name] = load(spec.run, config, own_observation, partial(its_check, spec))
        if config.driver.hold_s and not isinstance(drivers[spec.name], SumoDriver):
            drivers[spec.name] = SteadyDriver(drivers[spec.name], its_check(spec), config)
    return {spec.name: drivers[spec.name] for spec in specs}


def rule_driver(name: str, config: Config) -> Driver:
    """Make the rule-based driver of this name, or the driver of a factory ``module:factory``.

    Raises:
        ConfigError: there is no such driver in this world, or the factory does not work.
    """
    if name not in RULE_DRIVERS:
        if is_factory(name):
            return driver_of_factory(name, config)
        raise _unknown(name)
    driver, world = RULE_DRIVERS[name](config), config.simulation.world
    if world != "sumo" and isinstance(driver, SumoDriver | IdmSumoDriver):
        raise ConfigError(
            "SUMO drives or changes lanes for the drivers sumo, sumo-tuned and idm-sumo, but the "
            f"world is the {world}: evaluate them in SUMO."
        )
    return driver


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
            preset replaces all settings.

    Raises:
        ConfigError: there is no such driver, or a setting is wrong.
        RunError, CheckpointError: the file cannot be used, or another observation was trained.
    """
    if not isinstance(driver, str | Path):
        raise ConfigError(
            f"driver is a {type(driver).__name__}, but must be a name, a path or "
            "'module:function'; a driver object needs no loading."
        )
    specs = [find_driver(driver)]
    [driver_made] = make_drivers(specs, driving_config(specs, config)).values()
    return driver_made
