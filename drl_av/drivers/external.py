"""Loads drivers from outside the package (ours).

The source is a user's Python function, the zip file of a stable-baselines3 agent or an ONNX file.
"""

import glob
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from drl_av.config import Config
from drl_av.config.functions import import_function, require_function
from drl_av.drivers.agent import driver_of_agent, statistics_file
from drl_av.drivers.driver import Driver
from drl_av.drivers.learned import require_same_observation
from drl_av.drivers.onnx import OnnxDriver, exported_config
from drl_av.driving.affordances import observed_indicators
from drl_av.errors import ConfigError, ScenarioError
from drl_av.safety.check import SafetyCheck
from drl_av.scenarios.folder import find_scenario, load_scenario


def driver_of_factory(word: str, config: Config) -> Driver:
    """Import the function ``module:factory``, call it with the config, and return its driver.

    Python searches the working directory for the module first. Each worker process of an evaluation
    calls the function once.

    Raises:
        ConfigError: the module or the function does not exist, the function does not take a config,
            or it returns an object without the methods of a driver.
    """
    factory = import_function(word, "driver")
    require_function(factory, f"The factory {word!r}", "config")
    driver: Driver = factory(config)
    require_driver(driver, f"The driver of the factory {word!r}", word)
    return driver


def require_driver(driver: Driver, what: str, name: str) -> None:
    """Raise ConfigError unless an object has the methods ``start`` and ``act`` of ``Driver``.

    ``what`` is the object in the error message, ``name`` is the driver's name there.
    """
    methods = getattr(driver, "start", None), getattr(driver, "act", None)
    if isinstance(driver, type) or not all(map(callable, methods)):
        raise ConfigError(
            f"{what} is a {type(driver).__name__}, but must be an object with start(seed) and "
            "act(scene, observation): a class or a function has to be called."
        )
    require_function(driver.start, f"The method start of the driver {name!r}", "seed")
    require_function(driver.act, f"The method act of the driver {name!r}", "scene", "observation")


def _onnx(path: Path, config: Config, own: Any, check: Callable[[], SafetyCheck]) -> Driver:
    if own is None:
        observed = len(observed_indicators(config.observation))
    else:
        observed = own.shape[0] if len(own.shape or ()) == 1 else 0
    driver = OnnxDriver(path, observed)
    if (trained := exported_config(path)) is not None:
        require_same_observation(str(path), trained, config)
        with suppress(ScenarioError):  # the road of the training may be elsewhere
            both = [each.simulation.scenario for each in (trained, config)]
            roads = [load_scenario(find_scenario(scenario)).road for scenario in both]
            if len({(len(road.open_lanes), road.lane_width_m) for road in roads}) > 1:
                raise ConfigError(
                    f"{path} scales the lateral position by the lanes of its training, of which "
                    "this road has others: drive the folder of the run."
                )
    return driver


LOADERS: dict[str, Callable[[Path, Config, Any, Callable[[], SafetyCheck]], Driver]] = {
    ".zip": driver_of_agent,
    ".onnx": _onnx,
}
"""The function that loads a driver from a file; the key is the file's suffix.

Its arguments are those of ``driver_of_agent``.
"""


def files_of(path: Path) -> list[Path]:
    """Return the files of which an external driver consists, that of its name first.

    An agent may have statistics of VecNormalize, a network in ONNX data in files beside it, whose
    names begin with its own.
    """
    if path.suffix.lower() == ".onnx":
        return [path, *sorted(path.parent.glob(f"{glob.escape(path.name)}[._]*"))]
    return [path, *filter(None, [statistics_file(path)])]
