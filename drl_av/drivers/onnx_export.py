"""Writes a learned driver as one ONNX graph, with scaling, mirror, ensemble and margins (ours)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drl_av.config import Config
from drl_av.drivers.external import INDICATORS_INPUT, LANE_CHANGE_INPUT
from drl_av.drivers.learned import Margins
from drl_av.drivers.network import LEAK, QNetwork
from drl_av.drivers.onnx_interface import INPUTS, INSIDE, OUTPUTS, Port, metadata
from drl_av.driving.mirror import MIRROR
from drl_av.driving.observation_scale import ObservationScale
from drl_av.errors import DrlAvError
from drl_av.files import write_atomic

OPSET = 17


class _Graph:
    """Collects the nodes and constants of an ONNX graph, and generates their names."""

    def __init__(self) -> None:
        import onnx

        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: object) -> str:
        """Add the array ``values`` to the graph as a constant, and return its generated name."""
        name = f"constant_{len(self.constants)}"
        self.constants.append(self._onnx.numpy_helper.from_array(np.asarray(values), name))
        return name

    def add(self, kind: str, *inputs: str, name: str | None = None, **attributes: Any) -> str:
        """Add a node of the operator ``kind`` with one output, and return the output's name."""
        output = name or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, inputs, [output], **attributes))
        return output


def export(
    path: Path, networks: Sequence[QNetwork], config: Config, scale: ObservationScale
) -> None:
    """Write the driver of trained networks to an ONNX file, with the package onnx.

    The module ``onnx_interface`` describes the file's inputs, outputs and metadata.

    Raises:
        DrlAvError: onnx is not installed, ``observation.way`` or ``learning.permitted_only`` is on
            (not supported), or the file cannot be written.
    """
    lacking = {
        "observation.way": config.observation.way and "its way",
        "learning.permitted_only": config.learning.permitted_only and "the safety check",
    }
    if used := {setting: inputs for setting, inputs in lacking.items() if inputs}:
        raise DrlAvError(
            f"A driver that was trained with {' and '.join(used)} cannot be exported, because the "
            f"file has no inputs for {' and '.join(used.values())}: train one without, or drive "
            "it with drl-av."
        )
    try:
        import onnx
    except ImportError as error:
        raise DrlAvError(
            "The export needs the package onnx, which is not installed: pip install 'drl-av[onnx]'."
        ) from error
    graph = _Graph()
    s = _scaled(graph, scale)
    members = [_values(graph, network, s, config.learning.mirrored) for network in networks]
    total = members[0]
    for member in members[1:]:
        total = graph.add("Add", total, member)
    q = graph.add("Div", total, graph.constant(np.float32(len(members))), name="q")
    _chosen(graph, q, Margins.of(config.learning))
    helper, inputs, outputs = onnx.helper, *(_described(ports) for ports in (INPUTS, OUTPUTS))
    made = helper.make_graph(
        graph.nodes, "drl_av_driver", inputs, outputs, graph.constants, doc_string=INSIDE
    )
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    model.producer_name = "drl-av"
    model.doc_string = INSIDE
    for key, value in metadata(config).items():
        model.metadata_props.add(key=key, value=value)
    onnx.checker.check_model(model, full_check=True)
    write_atomic(path, model.SerializeToString())


def _described(ports: Sequence[Port]) -> list[Any]:
    """Return the inputs or outputs as ONNX objects with types, shapes and meanings."""
    from onnx import helper

    return [
        helper.make_tensor_value_info(
            port.name,
            helper.np_dtype_to_tensor_dtype(np.dtype(port.dtype)),
            port.shape,
            doc_string=port.meaning,
        )
        for port in ports
    ]


def _scaled(graph: _Graph, scale: ObservationScale) -> str:
    """Add nodes that scale the indicators like ``ObservationScale``; return the output's name."""
    shifted = graph.add("Sub", INDICATORS_INPUT, graph.constant(scale.offset))
    exact = graph.add("Div", shifted, graph.constant(scale.scale))
    s = graph.add("Cast", exact, to=1)
    s = graph.add("Max", s, graph.constant(-scale.bounds))
    return graph.add("Min", s, graph.constant(scale.bounds))


def _values(graph: _Graph, network: QNetwork, s: str, mirrored: bool) -> str:
    """Add nodes that compute Q(s, .), or its mean over both mirror images; return their output."""
    layers = [tuple(map(graph.constant, layer)) for layer in network.layers]
    q = _forward(graph, layers, s)
    if not mirrored:
        return q
    reflected = graph.add("Gather", s, graph.constant(MIRROR.observation_permutation), axis=1)
    reflected = graph.add("Mul", reflected, graph.constant(MIRROR.observation_sign))
    other = _forward(graph, layers, reflected)
    other = graph.add("Gather", other, graph.constant(MIRROR.action_permutation), axis=1)
    return graph.add("Mul", graph.add("Add", q, other), graph.constant(np.float32(0.5)))


def _forward(graph: _Graph, layers: Sequence[tuple[str, ...]], s: str) -> str:
    for number, (weight, bias) in enumerate(layers):
        s = graph.add("Gemm", s, weight, bias, transB=1)
        if number < len(layers) - 1:
            s = graph.add("LeakyRelu", s, alpha=LEAK)
    return s


def _chosen(graph: _Graph, q: str, margins: Margins) -> None:
    """Add nodes that choose the action as ``LearnedDriver.act`` does; the output is ``action``."""
    began = graph.add("Unsqueeze", LANE_CHANGE_INPUT, graph.constant(np.array([1])))
    penalties = (graph.constant(margins.action_penalties(changing)) for changing in (True, False))
    worth = graph.add("Sub", q, graph.add("Where", began, *penalties))
    graph.add("ArgMax", worth, name="action", axis=1, keepdims=0)
