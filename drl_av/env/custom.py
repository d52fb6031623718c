"""Functions of the user that an environment gets beside its settings: check, reward, observation.

Each is an object, or its name as ``module:name``. A file of settings, a run and a recording may
hold such a name, but only an argument imports it: opening a file never runs the code of others.
"""

import shlex
import sys
from collections.abc import Iterable, Sequence
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config import Config
from drl_av.config.functions import import_function, is_factory, require_function, source_digest
from drl_av.env.observation import ObservationFunction
from drl_av.env.transition import RewardFunction
from drl_av.files.atomic import files_digest
from drl_av.safety.check import SafetyCheck
from drl_av.scenarios.folder import find_scenario
from drl_av.simulation.sumo_options import option_words


class CustomParts(NamedTuple):
    """The arguments of HighwayEnv that may be functions of the user; None for the settings' own."""

    safety_check: str | SafetyCheck | None = None
    reward: str | RewardFunction | None = None
    observation: str | Iterable[str] | ObservationFunction | None = None
    sumo_options: str | Sequence[str] = ()
    """Options of SUMO beside ours, such as ``"--fcd-output fcd.xml"``."""

    def beside(self, check: str | None) -> "CustomParts":
        """Return these for a driver with a check of its own, or all of them if it has none."""
        return self._replace(safety_check=None) if check else self

    def words(self) -> dict[str, str]:
        """Return those that are given, by name, in words that a later process has too."""
        words = {name: _word(part) for name, part in self._asdict().items() if part}
        if self.sumo_options:
            words["sumo_options"] = shlex.join(option_words(self.sumo_options))
        return words


def custom_inputs(config: Config, custom: CustomParts) -> dict[str, str]:
    """Return what episodes rest on besides settings and drivers, by name; "" for nothing.

    It is the SHA-256 of the scenario's files, and each argument of the user, a function
    ``module:name`` with the SHA-256 of its module, or of its whole package.
    """
    found = {"scenario": files_digest(find_scenario(config.simulation.scenario))}
    found |= dict.fromkeys(custom._fields, "")
    for name, word in custom.words().items():
        found[name] = f"{word} {source_digest(word)}" if is_factory(word) else word
    return found


def _word(part: Any) -> str:
    module, name = "", ""
    if isinstance(part, str):
        module, _, name = part.partition(":")
        if module != "__main__":
            return part
    elif isinstance(part, Iterable):
        return " ".join(map(str, part))
    else:
        named = part if hasattr(part, "__qualname__") else type(part)
        module, name = named.__module__, named.__qualname__
    if module == "__main__":  # the program itself, which another one imports by its file's name
        module = Path(getattr(sys.modules["__main__"], "__file__", None) or module).stem
    return f"{module}:{name}"


def with_check(
    config: Config, given: str | SafetyCheck | None
) -> tuple[Config, str | SafetyCheck | None]:
    """Return the config under the safety check that an argument names, and the user's own check.

    The argument is a name, the user's own check, which is then the second result, or None.
    """
    if given is None:
        return config, None
    is_named = isinstance(given, str) and not is_factory(given)
    return config.updated("safety", check=_word(given)), None if is_named else given


def custom_check(given: str | SafetyCheck, config: Config) -> SafetyCheck:
    """Return the user's safety check: an object, a function ``module:name``, or what it makes.

    A function of one argument is a factory, which gets the config and returns the check.

    Raises:
        ConfigError: the function does not exist, or what it is or makes is not a check.
    """
    if not isinstance(given, str):
        require_function(given, "safety_check", "scene", "proposed")
        return given
    found = import_function(given, "safety check")
    if _takes_one(found):
        found = found(config)
    require_function(found, f"The safety check {given!r}", "scene", "proposed")
    check: SafetyCheck = found
    return check


def _takes_one(function: Any) -> bool:
    try:
        signature(function).bind("config")
    except (TypeError, ValueError):
        return False
    return True


def custom_reward_of(given: str | RewardFunction) -> RewardFunction:
    """Return the user's reward: an object, or a function ``module:name``.

    Raises:
        ConfigError: the function does not exist, or does not take a transition.
    """
    found = import_function(given, "reward") if isinstance(given, str) else given
    require_function(found, "reward" if found is given else f"The reward {given!r}", "transition")
    return found


def custom_observation_of(given: Any) -> Any:
    """Return the argument ``observation`` itself, or what it names as ``module:name``.

    A class is called without arguments. Raises ConfigError if there is no such object.
    """
    if not (isinstance(given, str) and is_factory(given)):
        return given
    found = import_function(given, "observation")
    if not isinstance(found, type):
        return found
    require_function(found, f"The observation {given!r}")
    return found()


NOTHING_CUSTOM = CustomParts()
