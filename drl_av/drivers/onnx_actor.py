"""Writes a driver that was trained at scale as an ONNX graph (ours)."""

import json
from pathlib import Path

import numpy as np

from drl_av.config import Config
from drl_av.drivers.network import LEAK, Layers
from drl_av.driving.actions import ACTIONS
from drl_av.driving.wide_observation import WIDE_NAMES
from drl_av.errors import DrlAvError
from drl_av.files import write_atomic

OPSET = 17
FAR = 2048.0
"""Larger than any difference of logits; subtracted from those of the actions that are refused."""
PORTS = {
    "observation": "float32 (rows, {}), the wide observation: HighwayEnv(observation='wide')",
    "action_mask": "bool (rows, 12), which actions the safety check permits: env.action_masks()",
    "action": "int64 (rows), number of the permitted action with the largest logit",
    "logits": "float32 (rows, 12), the logits of all actions, without the mask",
}
"""The inputs and outputs of such a file; each row is one scene."""


def export_actor(path: Path, layers: Layers, config: Config) -> dict[str, str]:
    """Write the driver to an ONNX file, with the package onnx; return its inputs and outputs.

    The metadata of the file holds the config, and the names of the observation's numbers and of the
    actions. If no action of a row is permitted, the action is that with the largest logit.

    Raises:
        DrlAvError: onnx is not installed, or the file cannot be written.
    """
    try:
        from onnx import TensorProto, checker, helper, numpy_helper
    except ImportError as error:
        raise DrlAvError(
            "The export needs the package onnx, which is not installed: pip install 'drl-av[onnx]'."
        ) from error
    constants = {"far": np.array(FAR, np.float32)}
    make = helper.make_node
    nodes = [
        make("Cast", ["action_mask"], ["mask"], to=TensorProto.FLOAT),
        make("Concat", ["observation", "mask"], ["layer_0"], axis=1),
    ]
    for number, (weight, bias) in enumerate(layers):
        constants |= {f"weight_{number}": weight, f"bias_{number}": bias}
        is_last = number == len(layers) - 1
        made = "logits" if is_last else f"sum_{number}"
        given = [f"layer_{number}", f"weight_{number}", f"bias_{number}"]
        nodes.append(make("Gemm", given, [made], transB=1))
        if not is_last:
            nodes.append(make("LeakyRelu", [made], [f"layer_{number + 1}"], alpha=LEAK))
    nodes += [
        make("Sub", ["logits", "far"], ["refused"]),
        make("Where", ["action_mask", "logits", "refused"], ["ranked"]),
        make("ArgMax", ["ranked"], ["action"], axis=1, keepdims=0),
    ]
    meanings = {name: text.format(len(WIDE_NAMES)) for name, text in PORTS.items()}
    sizes: dict[str, tuple[int, list[str | int]]] = {
        "observation": (TensorProto.FLOAT, ["rows", len(WIDE_NAMES)]),
        "action_mask": (TensorProto.BOOL, ["rows", len(ACTIONS)]),
        "action": (TensorProto.INT64, ["rows"]),
        "logits": (TensorProto.FLOAT, ["rows", len(ACTIONS)]),
    }
    ports = [
        helper.make_tensor_value_info(name, *sizes[name], doc_string=meanings[name])
        for name in PORTS
    ]
    graph = helper.make_graph(
        nodes,
        "drl_av_actor",
        ports[:2],
        ports[2:],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    model.producer_name = "drl-av"
    held = {
        "config": config.to_toml(),
        "observation": json.dumps(WIDE_NAMES),
        "actions": json.dumps([str(action) for action in ACTIONS]),
    }
    for key, value in held.items():
        model.metadata_props.add(key=key, value=value)
    checker.check_model(model, full_check=True)
    write_atomic(path, model.SerializeToString())
    return meanings
