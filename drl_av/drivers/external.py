"""Loads drivers from outside the package (ours).

The source is a user's Python function, the zip file of a stable-baselines3 agent or an ONNX file.
"""

import importlib
import json
import re
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.config.functions import require_function
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.driver import Driver
from drl_av.drivers.onnx_interface import INPUTS
from drl_av.driving.actions import ACTIONS, Action, action_of
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.scene import Scene
from drl_av.errors import CheckpointError, ConfigError
from drl_av.safety import action_mask
from drl_av.safety.check import SafetyCheck

INDICATORS_INPUT, LANE_CHANGE_INPUT = (port.name for port in INPUTS)
"""Names of the two inputs of an ONNX file that ``drl-av export`` wrote."""
_FACTORY = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
_AGENTS = {
    "stable_baselines3.dqn.policies": ("stable_baselines3", "DQN"),
    "sb3_contrib.qrdqn.policies": ("sb3_contrib", "QRDQN"),
    "sb3_contrib.common.maskable.policies": ("sb3_contrib", "MaskablePPO"),
}
"""The library and the class of an agent, by the module of the policy class in its zip file."""


def is_factory(word: str) -> bool:
    """Return whether a word of the command line has the form ``module:factory``."""
    return _FACTORY.fullmatch(word) is not None


def driver_of_factory(word: str, config: Config) -> Driver:
    """Import the function ``module:factory``, call it with the config, and return its driver.

    Python searches the working directory for the module first. Each worker process of an evaluation
    calls the function once.

    Raises:
        ConfigError: the module or the function does not exist, the function does not take a config,
            or it returns an object without the methods of a driver.
    """
    module, _, name = word.partition(":")
    try:
        with _working_directory_first():
            factory = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, SyntaxError) as error:
        raise ConfigError(
            f"The driver {word!r} cannot be imported ({error}): write it as module:factory, with "
            "a module in the working directory or an installed one that can be imported."
        ) from error
    require_function(factory, f"The factory {word!r}", "config")
    driver: Driver = factory(config)
    if not is_driver(driver):
        raise ConfigError(
            f"The factory {word!r} returned {driver!r}, which is no driver: return an "
            "object with start(seed) and act(scene, observation)."
        )
    require_methods(driver, word)
    return driver


def is_driver(made: object) -> bool:
    """Return whether an object has the methods ``start`` and ``act``; False for a class."""
    if isinstance(made, type):
        return False
    return callable(getattr(made, "start", None)) and callable(getattr(made, "act", None))


def require_methods(driver: Driver, name: str) -> None:
    """Raise ConfigError unless ``start`` and ``act`` take the arguments that ``Driver`` defines."""
    require_function(driver.start, f"The method start of the driver {name!r}", "seed")
    require_function(driver.act, f"The method act of the driver {name!r}", "scene", "observation")


@contextmanager
def _working_directory_first() -> Iterator[None]:
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)


class MaskedAgent(Driver):
    """An agent of MaskablePPO: it chooses among the actions that ``check`` permits."""

    def __init__(self, agent: Any, check: SafetyCheck) -> None:
        self._agent, self._check = agent, check

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the agent's most probable action under the mask of the scene."""
        mask = action_mask(self._check, scene)
        chosen, _ = self._agent.predict(observation, action_masks=mask, deterministic=True)
        return action_of(chosen)


def driver_of_agent(path: Path, observed: int, check: Callable[[], SafetyCheck]) -> Driver:
    """Load an agent that stable-baselines3 or sb3-contrib saved; the driver acts deterministically.

    The libraries unpickle the zip file, which can run any code: load only files that you trust.

    Args:
        path: The zip file.
        observed: Number of indicators in an observation.
        check: Returns the safety check of the environment, of which MaskablePPO gets the mask.

    Raises:
        CheckpointError: the file holds no such agent, its library is not installed, or the agent
            was not trained with ``observed`` indicators and 12 actions.
    """
    library, name = _agent_class(path)
    try:
        agent = getattr(importlib.import_module(library), name).load(path, device="cpu")
    except ImportError as error:
        package = library.replace("_", "-")
        raise CheckpointError(
            f"{path} needs the package {package}, which is not installed: pip install {package}."
        ) from error
    except Exception as error:  # unpickling runs the file's own code
        raise CheckpointError(
            f"{path} cannot be loaded as a {name} ({error}): save it again."
        ) from error
    spaces = agent.observation_space.shape, getattr(agent.action_space, "n", None)
    if spaces != ((observed,), len(ACTIONS)):
        raise CheckpointError(
            f"{path} was trained with observations of shape {spaces[0]} and {spaces[1]} actions, "
            f"but drives with ({observed},) and {len(ACTIONS)} here: set observation.way as in its "
            "training, or use PolicyDriver(policy, observe) in Python."
        )
    if name == "MaskablePPO":
        return MaskedAgent(agent, check())
    return PolicyDriver(lambda observation: agent.predict(observation, deterministic=True)[0])


def _agent_class(path: Path) -> tuple[str, str]:
    """Read from an agent's zip file the names of its library and class."""
    try:
        with zipfile.ZipFile(path) as archive:
            data: dict[str, Any] = json.loads(archive.read("data"))
        module = str(data["policy_class"]["__module__"])
    except (OSError, zipfile.BadZipFile, LookupError, ValueError, TypeError) as error:
        raise CheckpointError(
            f"{path} is no agent that stable-baselines3 saved ({error}): give the file of its "
            "save method."
        ) from error
    if module == "stable_baselines3.common.policies":
        return "stable_baselines3", "PPO" if "clip_range" in data else "A2C"
    if module not in _AGENTS:
        raise CheckpointError(
            f"{path} holds an agent with a policy of {module}, which is not known here: wrap it "
            "in a factory and give it as module:factory."
        )
    return _AGENTS[module]


class OnnxDriver(Driver):
    """A driver that runs the network of an ONNX file from ``drl-av export`` or from a user.

    A user's network has one input: scaled observations, float32 of shape (rows, ``observed``). Its
    output holds either action numbers, shape (rows,), or action values, shape (rows, 12). With
    action values, the driver chooses the action that has the greatest value.

    Raises:
        CheckpointError: the file holds no such network, or onnxruntime is not installed.
    """

    def __init__(self, path: Path, observed: int = len(INDICATORS)) -> None:
        self._run, self._path = _session(path, observed), path

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """Return the action that the network chooses by its number or by the greatest value.

        Raises:
            ConfigError: the network returns neither a number from 0 to 11 nor 12 values, or returns
                nan.
        """
        feed = {
            INDICATORS_INPUT: scene.affordances.vector()[None],
            LANE_CHANGE_INPUT: np.array([scene.lane_change is not None]),
            "": observation[None],
        }
        [chosen] = self._run(feed)
        if chosen.ndim == 0:
            return action_of(chosen)
        if chosen.shape != (len(ACTIONS),) or not np.isfinite(chosen.max()):  # -inf is a mask
            raise ConfigError(
                f"The network {self._path} returns {chosen.tolist()} for a scene, but must "
                f"return the number of an action or {len(ACTIONS)} values, none of them nan."
            )
        return ACTIONS[int(chosen.argmax())]


Run = Callable[[dict[str, npt.NDArray[Any]]], npt.NDArray[Any]]


def _session(path: Path, observed: int) -> Run:
    """Return a function that runs the network on arrays by name.

    The array with the name '' is for a network of a user, which has only one input.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise CheckpointError(
            f"{path} needs the package onnxruntime, which is not installed: "
            "pip install 'drl-av[onnx]'."
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(
            path.read_bytes(), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # onnxruntime raises classes of its own, and OSError
        raise CheckpointError(
            f"{path} cannot be read as an ONNX network ({' '.join(str(error).split())[:200]}): "
            "export it again."
        ) from error
    names = [item.name for item in session.get_inputs()]
    own = set(names) == {INDICATORS_INPUT, LANE_CHANGE_INPUT}
    if own and observed != len(INDICATORS):
        raise CheckpointError(
            f"{path} observes {len(INDICATORS)} indicators, but observation.way adds others here: "
            "drive it with observation.way = false."
        )
    if not own and (len(names) != 1 or session.get_inputs()[0].shape[-1] != observed):
        raise CheckpointError(
            f"{path} takes the inputs {', '.join(names)}: give a network of one input with "
            f"observations of shape (rows, {observed}), or one that drl-av export wrote."
        )
    output = session.get_outputs()[0].name

    def run(feed: dict[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
        given = {name: feed[name if own else ""] for name in names}
        result: npt.NDArray[Any] = session.run([output], given)[0]
        return result

    one_row = {
        INDICATORS_INPUT: np.zeros((1, len(INDICATORS))),
        LANE_CHANGE_INPUT: np.zeros(1, dtype=np.bool_),
        "": np.zeros((1, observed), dtype=np.float32),
    }
    try:
        shape = run(one_row).shape
    except Exception as error:  # onnxruntime raises classes of its own
        reason = " ".join(str(error).split())[:200]
        raise CheckpointError(
            f"{path} does not run on one observation, float32 of shape (1, {observed}) "
            f"({reason}): export it with this input and a free number of rows."
        ) from error
    if shape[:1] != (1,):
        raise CheckpointError(
            f"{path} returns an array of shape {shape} for one observation, but must return one "
            f"row: export it with the output (rows,) or (rows, {len(ACTIONS)})."
        )
    return run


LOADERS: dict[str, Callable[[Path, int, Callable[[], SafetyCheck]], Driver]] = {
    ".zip": driver_of_agent,
    ".onnx": lambda path, observed, check: OnnxDriver(path, observed),
}
"""The function that loads a driver from a file; the key is the file's suffix.

Its arguments are those of ``driver_of_agent``.
"""
