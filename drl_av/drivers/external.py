"""External drivers: a user's factory, a stable-baselines3 agent, an ONNX file (ours)."""

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
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.driver import Driver
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.scene import Scene
from drl_av.errors import CheckpointError, ConfigError

INDICATORS_INPUT, LANE_CHANGE_INPUT = "indicators", "lane_change"
"""Inputs of an ONNX file that ``drl-av export`` wrote."""
_FACTORY = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
_AGENTS = {
    "stable_baselines3.dqn.policies": ("stable_baselines3", "DQN"),
    "sb3_contrib.qrdqn.policies": ("sb3_contrib", "QRDQN"),
    "sb3_contrib.common.maskable.policies": ("sb3_contrib", "MaskablePPO"),
}
"""Library and class of an agent, by the module of its policy class."""


def is_factory(word: str) -> bool:
    """Whether a word has the form ``module:factory``."""
    return _FACTORY.fullmatch(word) is not None


def driver_of_factory(word: str, config: Config) -> Driver:
    """The driver that the factory ``module:factory`` returns for a config.

    Python searches the working directory for the module first. Each worker process of an evaluation
    calls the factory once.

    Raises:
        ConfigError: the module or the factory does not exist, or the factory returns no driver.
    """
    module, _, name = word.partition(":")
    try:
        with _working_directory_first():
            factory = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ConfigError(
            f"The driver {word!r} cannot be imported ({error}): write it as module:factory, with "
            "a module in the working directory or an installed one."
        ) from error
    driver: Driver = factory(config)
    if not is_driver(driver):
        raise ConfigError(
            f"The factory {word!r} made a {type(driver).__name__}, which is no driver: return an "
            "object with start(seed) and act(scene, observation)."
        )
    return driver


def is_driver(made: object) -> bool:
    """Whether an object has the methods of a driver, ``start`` and ``act``."""
    return callable(getattr(made, "start", None)) and callable(getattr(made, "act", None))


@contextmanager
def _working_directory_first() -> Iterator[None]:
    folder = str(Path.cwd())
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)


def driver_of_agent(path: Path) -> Driver:
    """The deterministic policy of an agent in a zip file of stable-baselines3 or sb3-contrib.

    Their loader unpickles the file, which can run any code: load only files that you trust.

    Raises:
        CheckpointError: the file holds no such agent, its library is missing, or the agent was
            trained with another observation space or other actions.
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
    if spaces != ((len(INDICATORS),), len(ACTIONS)):
        raise CheckpointError(
            f"{path} was trained with observations of shape {spaces[0]} and {spaces[1]} actions: "
            f"give an agent trained on drl_av/Highway-v0, with ({len(INDICATORS)},) and "
            f"{len(ACTIONS)}."
        )
    return PolicyDriver(lambda observation: agent.predict(observation, deterministic=True)[0])


def _agent_class(path: Path) -> tuple[str, str]:
    """Library and class name of the agent in a zip file."""
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


class OnnxDriver:
    """A driver made of a network in an ONNX file: from ``drl-av export``, or from a user.

    The network of a user takes observations, float32 of shape (rows, 27). It returns action
    numbers, shape (rows,), or a value for each action, shape (rows, 12). In the second case the
    driver chooses the action of the greatest value.

    Raises:
        CheckpointError: the file holds no such network, or onnxruntime is not installed.
    """

    def __init__(self, path: Path) -> None:
        self._run = _session(path)

    def start(self, seed: int) -> None:
        """Stateless and deterministic."""

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        """The action that the network's first output selects."""
        feed = {
            INDICATORS_INPUT: scene.affordances.vector()[None],
            LANE_CHANGE_INPUT: np.array([scene.lane_change is not None]),
            "": observation[None],
        }
        [chosen] = self._run(feed)
        return ACTIONS[int(chosen if chosen.ndim == 0 else chosen.argmax())]


Run = Callable[[dict[str, npt.NDArray[Any]]], npt.NDArray[Any]]


def _session(path: Path) -> Run:
    """The network as a function of a dictionary of inputs; the key '' holds the observations."""
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
    if not own and (len(names) != 1 or session.get_inputs()[0].shape[-1] != len(INDICATORS)):
        raise CheckpointError(
            f"{path} takes the inputs {', '.join(names)}: give a network of one input with "
            f"observations of shape (rows, {len(INDICATORS)}), or one that drl-av export wrote."
        )
    output = session.get_outputs()[0].name

    def run(feed: dict[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
        given = {name: feed[name if own else ""] for name in names}
        result: npt.NDArray[Any] = session.run([output], given)[0]
        return result

    return run


LOADERS: dict[str, Callable[[Path], Driver]] = {".zip": driver_of_agent, ".onnx": OnnxDriver}
"""The function that makes a driver from a file, by the file's suffix."""
