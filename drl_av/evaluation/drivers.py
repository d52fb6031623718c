"""Drivers by name: those by rule, the one that ships, and learned ones from a run's folder."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from drl_av.config import Config
from drl_av.config.schema import did_you_mean
from drl_av.drivers import policy_file
from drl_av.drivers.driver import Driver
from drl_av.drivers.gap_mobil import GapMobilDriver
from drl_av.drivers.learned import LearnedDriver, learned_driver
from drl_av.drivers.mobil import MobilDriver
from drl_av.drivers.policy_file import load_run
from drl_av.drivers.rules import IdmDriver, IdmSumoDriver, RandomDriver
from drl_av.errors import ConfigError, RunError

RULE_DRIVERS: dict[str, Callable[[Config], Driver]] = {
    "idm": lambda config: IdmDriver(config.safety),
    "idm-mobil": lambda config: MobilDriver(config.safety, config.ego, config.mobil),
    "gap-mobil": lambda config: GapMobilDriver(config.safety, config.ego, config.mobil, 1.1),
    "gap-mobil-1.3": lambda config: GapMobilDriver(config.safety, config.ego, config.mobil, 1.3),
    "idm-sumo": lambda config: IdmSumoDriver(config.safety),
    "random": lambda config: RandomDriver(),
}
DRIVERS = (*RULE_DRIVERS, "pretrained")


class Choice(NamedTuple):
    """A driver somebody asked for."""

    name: str
    """What the results call it; no two are called the same."""
    run: Path | None
    """A run's folder or a policy file; None for a driver by rule, which ``name`` names."""


def choose(words: Iterable[str]) -> tuple[Choice, ...]:
    """What each word means: one of ``DRIVERS``, a run's folder, or a policy file.

    Runs are called by the last part of their path, or by the whole path where others end alike.

    Raises:
        ConfigError: a word is neither; tells the nearest driver.
    """
    runs: dict[str, Path | None] = {}
    for word in dict.fromkeys(words):
        if word in RULE_DRIVERS:
            runs[word] = None
        elif word == "pretrained":
            runs[word] = policy_file.PRETRAINED
        elif Path(word).exists():
            runs[word] = Path(word)
        else:
            raise _unknown(word)
    short = {word: word if word in DRIVERS else Path(word).absolute().name for word in runs}
    count = Counter(short.values())
    return tuple(Choice(short[w] if count[short[w]] == 1 else w, run) for w, run in runs.items())


def _unknown(word: str) -> ConfigError:
    hint = did_you_mean(word, DRIVERS)
    return ConfigError(
        f"There is no driver or run folder {word!r}{hint}; the drivers are: {', '.join(DRIVERS)}."
    )


def config_of(choices: Sequence[Choice]) -> Config:
    """The config of the first learned driver, or the paper's where all drive by rule.

    Raises:
        RunError: there is no such run, or it has saved no policy yet.
        CheckpointError: the policy file is damaged.
    """
    run = next((choice.run for choice in choices if choice.run), None)
    return load_driver(run)[1] if run else Config()


def build(choices: Sequence[Choice], config: Config) -> dict[str, Driver]:
    """The drivers by name, for an environment of that config.

    A learned driver keeps its own margin for lane changes, unless the config has another one than
    the first of them.

    Raises:
        RunError, CheckpointError: as ``config_of``; or a learned driver sees the road otherwise.
    """
    drivers: dict[str, Driver] = {}
    learned = {name: load_driver(run) for name, run in choices if run}
    margins = [own.learning.lane_change_margin for _, own in learned.values()]
    margin = config.learning.lane_change_margin
    for name, run in choices:
        if run is None:
            drivers[name] = rule_driver(name, config)
            continue
        driver, own = learned[name]
        drivers[name] = driver if margin == margins[0] else driver.with_margin(margin)
        if _eyes(own) != _eyes(config):
            raise RunError(
                f"{run} was trained with other [observation] settings or another "
                "ego.max_speed_m_s than it would drive with here: let it drive by itself, "
                "without a --config that changes them."
            )
    return drivers


def _eyes(config: Config) -> tuple[object, ...]:
    """What the numbers that a learned driver sees depend on."""
    return config.observation, config.ego.max_speed_m_s


def rule_driver(name: str, config: Config) -> Driver:
    """The driver of that name; raises ConfigError with the nearest one."""
    if name not in RULE_DRIVERS:
        raise _unknown(name)
    return RULE_DRIVERS[name](config)


def load_driver(path: Path) -> tuple[LearnedDriver, Config]:
    """The driver of a run's folder or of a policy file, and the config that built it.

    Raises:
        RunError, CheckpointError: as ``drivers.policy_file.load_run``.
    """
    networks, config = load_run(path)
    return learned_driver(networks, config.learning), config
