"""Writes a learned driver as one ONNX graph, and drives with the networks of ONNX files (ours).

A written graph includes the scaling and the mirror.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.network import QNetwork
from drl_av.drivers.onnx_graph import Graph, Port, checked_by_paper
from drl_av.driving.actions import ACTIONS, Action, action_of
from drl_av.driving.affordances import INDICATORS, SLOTS
from drl_av.driving.mirror import MIRROR
from drl_av.driving.observation_scale import ObservationScale, indicator_meaning
from drl_av.driving.scene import Scene
from drl_av.errors import CheckpointError, ConfigError, DrlAvError, needed_by

_STATES = "d_x, v_x, d_y, v_y"
INPUTS = (
    Port(
        "indicators",
        "float64",
        len(INDICATORS),
        "the affordance indicators in SI units, unscaled, in the order of info['indicators']: "
        f"{_STATES} for each of {', '.join(SLOTS)}, then {', '.join(INDICATORS[-3:])}",
    ),
    Port(
        "lane_change",
        "bool",
        None,
        "only with a safety check: whether a lane change of the ego is in progress, from the "
        "decision that starts it until the ego is on the centre of a lane again",
    ),
)
INDICATORS_INPUT, LANE_CHANGE_INPUT = (port.name for port in INPUTS)
"""Names of the inputs of an ONNX file that ``drl-av export`` wrote; the second with a check."""
OUTPUTS = (
    Port(
        "action",
        "int64",
        None,
        "number of the action with the greatest Q-value, 4 * lateral (keep, right, left) + "
        "longitudinal (maintain, accelerate, brake, hard brake)",
    ),
    Port("q", "float32", len(ACTIONS), "Q-values of the actions"),
)
INSIDE = (
    "The file contains the scaling and clipping of the indicators, the network, and the mean over "
    "the scene and its mirror image if the driver was trained so. It has no safety check. One "
    "call is one decision, for the next second."
)


def inputs_of(is_checked: bool) -> Sequence[Port]:
    """Return the inputs of a file with or without the safety check."""
    return INPUTS if is_checked else INPUTS[:1]


def described() -> str:
    """Return one paragraph on the inputs, the outputs and the content of an exported driver."""
    ports = [
        f"{kind} {port}: {port.meaning}."
        for kind, of_kind in (("Input", INPUTS), ("Output", OUTPUTS))
        for port in of_kind
    ]
    algorithm_1 = "The file of a driver of Algorithm 1, such as pretrained-paper:"
    ppo = "That of a driver of PPO, such as pretrained, has others, which the export prints."
    return " ".join([algorithm_1, *ports, INSIDE, ppo])


def metadata(config: Config) -> dict[str, str]:
    """Return the metadata of an exported driver: its config, indicators and actions.

    ``indicators`` and ``actions`` are JSON lists, and ``config`` is TOML.
    """
    indicators = [{"name": name, "meaning": indicator_meaning(name)} for name in INDICATORS]
    return {
        "config": config.to_toml(),
        "indicators": json.dumps(indicators),
        "actions": json.dumps([str(action) for action in ACTIONS]),
    }


def export(
    path: Path,
    network: QNetwork,
    config: Config,
    scale: ObservationScale,
    lane_width_m: float | None = None,
) -> None:
    """Write the driver of a trained network to an ONNX file, with the package onnx.

    ``INPUTS``, ``OUTPUTS`` and ``metadata`` describe the file. With ``lane_width_m``, the width of
    the lanes, the action is the one that the check ``paper`` executes.

    Raises:
        ConfigError: as ``checked_by_paper``.
        DrlAvError: onnx is not installed, ``observation.way`` is on (not supported), or the file
            cannot be written.
    """
    if config.observation.way:
        raise DrlAvError(
            "A driver that was trained with observation.way cannot be exported, because the file "
            "has no inputs for its way: train one without, or drive it with drl-av."
        )
    graph = Graph()
    s = _scaled(graph, scale)
    values = _values(graph, network, s, config.learning.mirrored)
    q, inside = graph.add("Identity", values, name="q"), INSIDE
    name = "action" if lane_width_m is None else "proposed"
    proposed = graph.add("ArgMax", q, name=name, axis=1, keepdims=0)
    if lane_width_m is not None:
        inside = inside.replace("It has no safety check", "The action has passed the check paper")
        given = proposed, INDICATORS_INPUT, LANE_CHANGE_INPUT
        checked_by_paper(graph, *given, config, lane_width_m)
    inputs = inputs_of(is_checked=lane_width_m is not None)
    graph.write(path, inputs, OUTPUTS, metadata(config), inside)


def _scaled(graph: Graph, scale: ObservationScale) -> str:
    """Add nodes that scale the indicators like ``ObservationScale``; return the output's name."""
    shifted = graph.add("Sub", INDICATORS_INPUT, graph.constant(scale.offset))
    exact = graph.add("Div", shifted, graph.constant(scale.scale))
    s = graph.add("Cast", exact, to=1)
    s = graph.add("Max", s, graph.constant(-scale.bounds))
    return graph.add("Min", s, graph.constant(scale.bounds))


def _values(graph: Graph, network: QNetwork, s: str, mirrored: bool) -> str:
    """Add nodes that compute Q(s, .), or its mean over both mirror images; return their output."""
    layers = [(graph.constant(weight), graph.constant(bias)) for weight, bias in network.layers]
    q = graph.forward(layers, s)
    if not mirrored:
        return q
    reflected = graph.add("Gather", s, graph.constant(MIRROR.observation_permutation), axis=1)
    reflected = graph.add("Mul", reflected, graph.constant(MIRROR.observation_sign))
    other = graph.forward(layers, reflected)
    other = graph.add("Gather", other, graph.constant(MIRROR.action_permutation), axis=1)
    return graph.add("Mul", graph.add("Add", q, other), graph.constant(np.float32(0.5)))


LONGEST_RUN_S = 10.0
"""A network that takes longer for one decision, which needs a millisecond, is refused."""


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
            CheckpointError: the network needs longer than ``LONGEST_RUN_S``.
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


Feed = dict[str, npt.NDArray[Any]]
Run = Callable[[Feed], npt.NDArray[Any]]


class _Watched:
    """Runs a session in a thread of its own, so that an endless network can be ended.

    A call of onnxruntime ends neither by Ctrl-C nor by itself if the network has an endless loop.
    """

    def __init__(self, path: Path, session: Any, options: Any) -> None:
        self._path, self._options = path, options
        self._feeds: SimpleQueue[Feed | None] = SimpleQueue()
        self._results: SimpleQueue[Any] = SimpleQueue()
        given = session, options, self._feeds, self._results
        self._thread = Thread(target=_serve, args=given, daemon=True)
        self._thread.start()

    def __call__(self, feed: Feed) -> Any:
        """Return the network's first output, or raise what the session raises."""
        self._feeds.put(feed)
        try:
            found = self._results.get(timeout=LONGEST_RUN_S)
        except BaseException as error:  # Ctrl-C too
            self._options.terminate = True
            self._feeds.put(None)
            self._thread.join(LONGEST_RUN_S)  # Python must not exit while onnxruntime runs
            if not isinstance(error, Empty):
                raise
            raise CheckpointError(
                f"{self._path} has not decided within {LONGEST_RUN_S:g} s: export a network "
                "without an endless loop."
            ) from error
        if isinstance(found, Exception):
            raise found
        return found

    def __del__(self) -> None:
        self._feeds.put(None)


def _serve(
    session: Any, options: Any, feeds: "SimpleQueue[Feed | None]", results: "SimpleQueue[Any]"
) -> None:
    """Answer each feed with the session's first output, or its error, until the feed is None."""
    output = session.get_outputs()[0].name
    while (feed := feeds.get()) is not None:
        try:
            results.put(session.run([output], feed, options)[0])
        except Exception as error:
            results.put(error)


def _session(path: Path, observed: int) -> Run:
    """Return a function that runs the network on arrays by name.

    The array with the name '' is for a network of a user, which has only one input. Weights in
    other files are read from the folder of ``path``.
    """
    with needed_by(path, "onnxruntime", "'drl-av[onnx]'", CheckpointError):
        import onnxruntime
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # the error is raised, too
    try:
        session = onnxruntime.InferenceSession(
            str(path.absolute()), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # onnxruntime raises classes of its own, and OSError
        raise CheckpointError(
            f"{path} cannot be read as an ONNX network ({' '.join(str(error).split())[:200]}): "
            "export it again."
        ) from error
    names = [item.name for item in session.get_inputs()]
    own = "indicators" in session.get_modelmeta().custom_metadata_map
    if own and observed != len(INDICATORS):
        raise CheckpointError(
            f"{path} observes the {len(INDICATORS)} indicators alone: drive it without "
            "--observation (observation=), and with observation.way = false."
        )
    if set(names) == {"observation", "action_mask"}:
        raise CheckpointError(
            f"{path} holds a driver of a training at scale, for programs without drl-av: drive it "
            "here by its name, or the folder of its run."
        )
    shape = session.get_inputs()[0].shape if names else None
    if not own and (len(names) != 1 or not shape or shape[-1] != observed):
        raise CheckpointError(
            f"{path} takes the inputs {', '.join(names)}: give a network of one input with "
            f"observations of shape (rows, {observed}), or one that drl-av export wrote."
        )
    watched = _Watched(path, session, onnxruntime.RunOptions())

    def run(feed: Feed) -> npt.NDArray[Any]:
        result: npt.NDArray[Any] = watched({name: feed[name if own else ""] for name in names})
        return result

    one_row = {
        INDICATORS_INPUT: np.zeros((1, len(INDICATORS))),
        LANE_CHANGE_INPUT: np.zeros(1, dtype=np.bool_),
        "": np.zeros((1, observed), dtype=np.float32),
    }
    try:
        made = run(one_row)
        shape, kind = made.shape, made.dtype.kind
    except CheckpointError:
        raise
    except Exception as error:  # onnxruntime raises classes of its own
        reason = " ".join(str(error).split())[:200]
        raise CheckpointError(
            f"{path} does not run on one observation, float32 of shape (1, {observed}) "
            f"({reason}): export it with this input and a free number of rows."
        ) from error
    if shape[:1] != (1,) or kind not in "fiu":
        raise CheckpointError(
            f"{path} returns an array of shape {shape} and type {made.dtype} for one observation, "
            "but must return one row of numbers: export it with the output (rows,) or "
            f"(rows, {len(ACTIONS)})."
        )
    return run
