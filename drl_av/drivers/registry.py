"""The drivers of the ego by name: those by rule, the shipped one, and learned ones by their run.

To add a driver by rule, write its file and add a line to ``RULE_DRIVERS``. The command line's help
is made from these lines.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from drl_av.config import Config
from drl_av.config.schema import did_you_mean
from drl_av.drivers import policy_file
from drl_av.drivers.driver import Driver
from drl_av.drivers.external import LOADERS, driver_of_factory, is_factory
from drl_av.drivers.gap_mobil import GapMobilDriver
from drl_av.drivers.learned import LearnedDriver, learned_driver
from drl_av.drivers.mobil import MobilDriver
from drl_av.drivers.passing import NoPassingOnTheRight
from drl_av.drivers.rules import IdmDriver, IdmSumoDriver, RandomDriver
from drl_av.drivers.sumo import TUNED, SumoDriver
from drl_av.errors import ConfigError, RunError
from drl_av.traffic.ego_model import EgoModel

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
    "random": lambda config: RandomDriver(),
}
"""How a driver by rule is made from the config it drives with, by the driver's name.

Worker processes look names up in their own copy of this table, so a driver that a program adds to
it while it runs is evaluated with one process.
"""

DRIVER_FILES = (".safetensors", *LOADERS)
"""Suffixes of the files that hold a driver."""


class DriverSpec(NamedTuple):
    """A driver that was asked for, and where it comes from."""

    name: str
    """Its name in the results, unique among the drivers asked for together."""
    run: Path | None
    """A run's folder or a file; None for the rule-based driver or the factory of that name."""

    @property
    def is_external(self) -> bool:
        """Whether the file is one of another library, without a config of drl-av."""
        return self.run is not None and self.run.suffix in LOADERS


def driver_names() -> tuple[str, ...]:
    """Every name that ``find_drivers`` takes beside the paths of runs."""
    return *RULE_DRIVERS, "pretrained"


def find_drivers(words: Iterable[str]) -> tuple[DriverSpec, ...]:
    """The drivers that the words name.

    Each word is one of ``driver_names``, a run's folder, a policy file, a stable-baselines3 zip
    file, an ONNX file, or a factory of the user's written as ``module:factory``.

    Learned drivers are named by the last part of their path, or by the whole path where two would
    have the same name.

    Raises:
        ConfigError: a word is neither; suggests the most similar name.
    """
    runs: dict[str, Path | None] = {}
    for word in dict.fromkeys(words):
        if word in RULE_DRIVERS:
            runs[word] = None
        elif word == "pretrained":
            runs[word] = policy_file.PRETRAINED
        elif Path(word).exists():
            runs[word] = Path(word)
        elif is_factory(word):
            runs[word] = None
        else:
            raise _unknown(word)
    named = {*driver_names(), *filter(is_factory, runs)}
    short = {word: word if word in named else Path(word).absolute().name for word in runs}
    count = Counter(short.values())
    return tuple(
        DriverSpec(short[word] if count[short[word]] == 1 else word, run)
        for word, run in runs.items()
    )


def _unknown(word: str) -> ConfigError:
    names = driver_names()
    hint = did_you_mean(word, names)
    return ConfigError(
        f"There is no driver or run folder {word!r}{hint}; the drivers are: {', '.join(names)}."
    )


def default_config(specs: Sequence[DriverSpec]) -> Config:
    """The config of the first learned driver, or the paper's where all drive by rule.

    Raises:
        RunError: there is no such run, or it has saved no policy yet.
        CheckpointError: the policy file is damaged.
    """
    run = next((spec.run for spec in specs if spec.run and not spec.is_external), None)
    return load_driver(run)[1] if run else Config()


def make_drivers(specs: Sequence[DriverSpec], config: Config) -> dict[str, Driver]:
    """The drivers by name, for an environment of that config.

    A learned driver keeps its own margin for lane changes, unless the config has another one than
    the first of them.

    Raises:
        RunError, CheckpointError: as ``default_config``; or a learned driver was trained with
            other observations.
    """
    drivers: dict[str, Driver] = {}
    learned = {
        spec.name: load_driver(spec.run) for spec in specs if spec.run and not spec.is_external
    }
    margins = [own.learning.lane_change_margin for _, own in learned.values()]
    margin = config.learning.lane_change_margin
    for spec in specs:
        name, run = spec
        if run is None:
            drivers[name] = rule_driver(name, config)
            continue
        if spec.is_external:
            drivers[name] = LOADERS[run.suffix](run)
            continue
        driver, own = learned[name]
        drivers[name] = driver if margin == margins[0] else driver.with_margin(margin)
        if _observed_by(own) != _observed_by(config):
            raise RunError(
                f"{run} was trained with other [observation] settings or another "
                "ego.max_speed_m_s than it would drive with here: let it drive by itself, "
                "without a --config that changes them."
            )
    return drivers


def _observed_by(config: Config) -> tuple[object, ...]:
    """The settings that the numbers of an observation depend on."""
    return config.observation, config.ego.max_speed_m_s


def rule_driver(name: str, config: Config) -> Driver:
    """The rule-based driver or the factory's of that name; raises ConfigError.

    A rule-based one passes on the right only where ``ego.overtake_right`` says that it may.
    """
    if name not in RULE_DRIVERS and is_factory(name):
        return driver_of_factory(name, config)
    if name not in RULE_DRIVERS:
        raise _unknown(name)
    driver = RULE_DRIVERS[name](config)
    if config.ego.overtake_right or isinstance(driver, SumoDriver):
        return driver
    return NoPassingOnTheRight(driver, config.ego)


def load_driver(path: Path) -> tuple[LearnedDriver, Config]:
    """The driver of a run's folder or of a policy file, and the config that built it.

    Raises:
        RunError, CheckpointError: as ``policy_file.load_run``.
    """
    networks, config = policy_file.load_run(path)
    return learned_driver(networks, config.learning), config
