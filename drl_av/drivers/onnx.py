"""Writes a learned driver as one ONNX graph, and drives with the networks of ONNX files (ours)."""

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.arrays import Float32Array
from drl_av.config import Config, from_toml
from drl_av.drivers.driver import Driver
from drl_av.drivers.network import LEAK, Layers, QNetwork
from drl_av.driving.actions import ACTIONS, Action, action_of
from drl_av.driving.affordances import INDICATORS, SLOTS
from drl_av.driving.mirror import MIRROR
from drl_av.driving.observation_scale import ObservationScale, indicator_meaning
from drl_av.driving.scene import Scene
from drl_av.driving.wide_observation import WIDE_NAMES
from drl_av.errors import CheckpointError, ConfigError, DrlAvError, needed_by
from drl_av.files.atomic import write_atomic

Constants = Mapping[str, npt.NDArray[Any]]
"""The constants of a graph by their names."""


class Port(NamedTuple):
    """An input or output of an exported driver."""

    name: str
    dtype: str
    """The numpy name of the element type."""
    columns: int | None
    """The shape is (rows, columns), or (rows,) if ``columns`` is None. Each row is one scene."""
    meaning: str

    @property
    def shape(self) -> list[str | int]:
        """The shape; a dimension of any size is given by its name."""
        return ["rows"] if self.columns is None else ["rows", self.columns]

    def __str__(self) -> str:
        return f"{self.name}, {self.dtype} ({', '.join(map(str, self.shape))})"


_STATES = "d_x, v_x, d_y, v_y"
INPUTS: Sequence[Port] = (
    Port(
        "indicators",
        "float64",
        len(INDICATORS),
        "the affordance indicators in SI units, unscaled, in the order of info['indicators']: "
        f"{_STATES} for each of {', '.join(SLOTS)}, then {', '.join(INDICATORS[-3:])}",
    ),
)
OUTPUTS: Sequence[Port] = (
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
WIDE, MASK = "the wide observation: HighwayEnv(observation='wide')", "env.action_masks()"
ACTOR_INPUTS: Sequence[Port] = (
    Port("observation", "float32", len(WIDE_NAMES), WIDE),
    Port("action_mask", "bool", len(ACTIONS), f"which actions the safety check permits: {MASK}"),
)
ACTOR_OUTPUTS: Sequence[Port] = (
    Port("action", "int64", None, "number of the permitted action with the largest logit"),
    Port("logits", "float32", len(ACTIONS), "the logits of all actions, without the mask"),
)


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


def export(path: Path, network: QNetwork, config: Config, scale: ObservationScale) -> None:
    """Write the driver of a trained network to an ONNX file, with the package onnx.

    ``INPUTS`` and ``OUTPUTS`` describe the file. Its metadata hold the config, as TOML, and the
    indicators and actions, as JSON lists.

    Raises:
        DrlAvError: onnx is not installed, ``observation.way`` is on (not supported), or the file
            cannot be written.
    """
    if config.observation.way:
        raise DrlAvError(
            "A driver that was trained with observation.way cannot be exported, because the file "
            "has no inputs for its way: train one without, or drive it with drl-av."
        )
    nodes = """
        shifted = Sub(indicators, offset)
        exact = Div(shifted, scale)
        single = Cast<to = 1>(exact)
        above = Max(single, least)
        s = Min(above, most)"""
    constants = {"offset": scale.offset, "scale": scale.scale}
    constants |= {"least": -scale.bounds, "most": scale.bounds}
    if config.learning.mirrored:
        nodes += f"""
            {_network(network.layers, "s", "q_here")}
            permuted = Gather<axis = 1>(s, permutation)
            s_mirrored = Mul(permuted, sign)
            {_network(network.layers, "s_mirrored", "q_there")}
            q_mirrored = Gather<axis = 1>(q_there, actions)
            q_sum = Add(q_here, q_mirrored)
            q = Mul(q_sum, half)"""
        constants |= {"permutation": MIRROR.observation_permutation}
        constants |= {"sign": MIRROR.observation_sign, "actions": MIRROR.action_permutation}
        constants |= {"half": np.array(0.5, np.float32)}
    else:
        nodes += _network(network.layers, "s", "q")
    nodes += "action = ArgMax<axis = 1, keepdims = 0>(q)"
    indicators = [{"name": name, "meaning": indicator_meaning(name)} for name in INDICATORS]
    held = {"config": config.to_toml(), "indicators": json.dumps(indicators)}
    _write(path, nodes, constants | _weights(network.layers), INPUTS, OUTPUTS, held, INSIDE)


def export_actor(path: Path, layers: Layers, config: Config) -> None:
    """Write a driver that was trained at scale to an ONNX file, with the package onnx.

    ``ACTOR_INPUTS`` and ``ACTOR_OUTPUTS`` describe the file. Its metadata hold the config, and the
    names of the observation's numbers and of the actions. If no action of a row is permitted, the
    action is that with the largest logit.

    Raises:
        DrlAvError: onnx is not installed, or the file cannot be written.
    """
    nodes = f"""
        mask = Cast<to = 1>(action_mask)
        seen = Concat<axis = 1>(observation, mask)
        {_network(layers, "seen", "logits")}
        permitted = Where(action_mask, logits, least)
        some = ReduceMax<axes = [1], keepdims = 1>(mask)
        any = Cast<to = 9>(some)
        ranked = Where(any, permitted, logits)
        action = ArgMax<axis = 1, keepdims = 0>(ranked)"""
    least = np.array(np.finfo(np.float32).min)
    held = {"config": config.to_toml(), "observation": json.dumps(WIDE_NAMES)}
    _write(path, nodes, _weights(layers) | {"least": least}, ACTOR_INPUTS, ACTOR_OUTPUTS, held)


def _weights(layers: Layers) -> dict[str, npt.NDArray[Any]]:
    """Return the constants of ``_network``."""
    weights = {f"w_{n}": weight for n, (weight, _) in enumerate(layers)}
    return weights | {f"b_{n}": bias for n, (_, bias) in enumerate(layers)}


def _network(layers: Layers, given: str, made: str) -> str:
    """Return the nodes that compute the output ``made`` of a network from its input ``given``."""
    nodes, last = [], len(layers) - 1
    for n in range(last):
        nodes += [f"{made}_z{n} = Gemm<transB = 1>({given}, w_{n}, b_{n})"]
        nodes += [f"{made}_a{n} = LeakyRelu<alpha = {LEAK}>({made}_z{n})"]
        given = f"{made}_a{n}"
    return "\n".join([*nodes, f"{made} = Gemm<transB = 1>({given}, w_{last}, b_{last})\n"])


def _write(
    path: Path,
    nodes: str,
    constants: Constants,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    metadata: Mapping[str, str],
    inside: str = "",
) -> None:
    """Write a graph, whose nodes are given in ONNX's text format, to a file.

    ``inside`` describes the graph. Raises DrlAvError if onnx is missing or the file not writable.
    """
    with needed_by("The export", "onnx", "'drl-av[onnx]'"):
        import onnx
        import onnx.parser
    kinds = {"float64": "double", "float32": "float"}
    given, made = (
        ", ".join(
            f"{kinds.get(port.dtype, port.dtype)}[{', '.join(map(str, port.shape))}] {port.name}"
            for port in ports
        )
        for ports in (inputs, outputs)
    )
    model = onnx.parser.parse_model(
        f'<ir_version: 8, opset_import: ["": 17]> drl_av_driver ({given}) => ({made}) {{{nodes}}}'
    )
    values = *model.graph.input, *model.graph.output
    for value, port in zip(values, (*inputs, *outputs), strict=True):
        value.doc_string = port.meaning
    tensors = (onnx.numpy_helper.from_array(array, name) for name, array in constants.items())
    model.graph.initializer.extend(tensors)
    model.producer_name, model.doc_string, model.graph.doc_string = "drl-av", inside, inside
    actions = json.dumps([str(action) for action in ACTIONS])
    onnx.helper.set_model_props(model, {**metadata, "actions": actions})
    onnx.checker.check_model(model, full_check=True)
    write_atomic(path, model.SerializeToString())


def _session(path: Path) -> tuple[Any, Any]:
    """Return the session of an ONNX file, and options of a run.

    Raises:
        CheckpointError: the file holds no network, or onnxruntime is not installed.
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
    return session, onnxruntime.RunOptions()


def exported_config(path: Path) -> Config | None:
    """Return the settings in a file that ``drl-av export`` wrote; None for another network.

    Raises:
        CheckpointError: the file holds no network, or onnxruntime is not installed.
    """
    metadata = _session(path)[0].get_modelmeta().custom_metadata_map
    if not {"config", "actions"} <= metadata.keys():
        return None
    return from_toml(metadata["config"], name=str(path))


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
        self._path, (self._session, self._options) = path, _session(path)
        self._thread = ThreadPoolExecutor(1)
        names = [item.name for item in self._session.get_inputs()]
        self._is_exported = "indicators" in self._session.get_modelmeta().custom_metadata_map
        if self._is_exported and observed != len(INDICATORS):
            raise CheckpointError(
                f"{path} observes the {len(INDICATORS)} indicators alone: drive it without "
                "--observation (observation=), and with observation.way = false."
            )
        if set(names) == {port.name for port in ACTOR_INPUTS}:
            raise CheckpointError(
                f"{path} holds a driver of a training at scale, for programs without drl-av: drive "
                "it here by its name, or the folder of its run."
            )
        row = np.zeros((1, len(INDICATORS) if self._is_exported else observed), np.float32)
        try:
            [self._input] = names
            self._decide(row.astype(np.float64) if self._is_exported else row)
        except CheckpointError:
            raise
        except Exception as error:  # onnxruntime raises classes of its own
            raise CheckpointError(
                f"{path} does not decide ({' '.join(str(error).split())[:200]}): export a network "
                f"of one input, float32 of shape (rows, {observed}), that returns the numbers of "
                f"actions, (rows,), or {len(ACTIONS)} values, (rows, {len(ACTIONS)})."
            ) from error

    def act(self, scene: Scene, observation: Float32Array) -> Action:
        """Return the action that the network chooses by its number or by the greatest value.

        Raises:
            ConfigError: the network returns neither a number from 0 to 11 nor 12 values, or returns
                nan.
            CheckpointError: the network needs longer than ``LONGEST_RUN_S``.
        """
        seen = scene.indicators.values[:27] if self._is_exported else observation
        return self._decide(seen[None])

    def _decide(self, row: npt.NDArray[Any]) -> Action:
        [chosen] = self._run(row)
        if chosen.ndim == 0:
            return action_of(chosen)
        if chosen.shape != (len(ACTIONS),) or not np.isfinite(chosen.max()):  # -inf is a mask
            raise ConfigError(
                f"The network {self._path} returns {chosen.tolist()} for a scene, but must "
                f"return the number of an action or {len(ACTIONS)} values, none of them nan."
            )
        return ACTIONS[int(chosen.argmax())]

    def _run(self, row: npt.NDArray[Any]) -> Any:
        """Return the network's first output, or raise what the session raises.

        The session runs in a thread of its own, so that an endless network can be ended: a call of
        onnxruntime ends neither by Ctrl-C nor by itself if the network has an endless loop.
        """
        feed = {self._input: row}
        running = self._thread.submit(self._session.run, None, feed, self._options)
        try:
            return running.result(LONGEST_RUN_S)[0]
        except BaseException as error:  # Ctrl-C too
            if running.done():
                raise
            self._options.terminate = True
            wait([running], LONGEST_RUN_S)  # Python must not exit while onnxruntime runs
            if not isinstance(error, TimeoutError):
                raise
            raise CheckpointError(
                f"{self._path} has not decided within {LONGEST_RUN_S:g} s: export a network "
                "without an endless loop."
            ) from error
