"""Builds ONNX graphs: of the check ``paper``, and of a driver trained at scale (ours)."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.drivers.network import LEAK, Layers
from drl_av.driving.actions import (
    ACCELERATE,
    ACTIONS,
    BRAKE,
    HARD_BRAKE,
    KEEP,
    LEFT,
    MAINTAIN,
    RIGHT,
    SIGNS,
)
from drl_av.driving.wide_observation import WIDE_NAMES
from drl_av.errors import ConfigError, needed_by
from drl_av.files import write_atomic


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


OPSET = 17


class Graph:
    """Collects the nodes and constants of an ONNX graph, and generates their names."""

    def __init__(self) -> None:
        with needed_by("The export", "onnx", "'drl-av[onnx]'"):
            import onnx

        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: object) -> str:
        """Add the array ``values`` to the graph as a constant, and return its generated name."""
        name = f"constant_{len(self.constants)}"
        self.constants.append(self._onnx.numpy_helper.from_array(np.asarray(values), name))
        return name

    def add(self, kind: str, *inputs: object, name: str | None = None, **attributes: Any) -> str:
        """Add a node of the operator ``kind`` with one output, and return the output's name.

        An input is the name of an output, or the values of a constant.
        """
        output = name or f"{kind.lower()}_{len(self.nodes)}"
        given = [each if isinstance(each, str) else self.constant(each) for each in inputs]
        self.nodes.append(self._onnx.helper.make_node(kind, given, [output], **attributes))
        return output

    def forward(self, layers: Sequence[tuple[object, object]], s: str) -> str:
        """Add a network whose layers are pairs (weight, bias); return the name of its output."""
        for number, layer in enumerate(layers):
            s = self.add("LeakyRelu", s, alpha=LEAK) if number else s
            s = self.add("Gemm", s, *layer, transB=1)
        return s

    def write(
        self,
        path: Path,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        metadata: Mapping[str, str],
        inside: str = "",
    ) -> None:
        """Write the graph to an ONNX file; ``inside`` describes it.

        Raises:
            DrlAvError: the file cannot be written.
        """
        helper = self._onnx.helper
        ports = (
            [
                helper.make_tensor_value_info(
                    port.name,
                    helper.np_dtype_to_tensor_dtype(np.dtype(port.dtype)),
                    port.shape,
                    doc_string=port.meaning,
                )
                for port in some
            ]
            for some in (inputs, outputs)
        )
        made = helper.make_graph(
            self.nodes, "drl_av_driver", *ports, self.constants, doc_string=inside
        )
        opset = helper.make_opsetid("", OPSET)
        model = helper.make_model(made, opset_imports=[opset], ir_version=8, doc_string=inside)
        model.producer_name = "drl-av"
        helper.set_model_props(model, dict(metadata))
        self._onnx.checker.check_model(model, full_check=True)
        write_atomic(path, model.SerializeToString())


FRONTS, REARS = np.array([0, 16, 8]), np.array([4, 20, 12])
"""Columns of the gaps ahead and behind in the own, the left and the right lane; the next column has
the relative speed. The lane at the side k, left 1 and right -1, is the column k modulo 3."""
SPEED_Y, Y = 26, 25


def checked_by_paper(
    graph: Graph, proposed: str, indicators: str, changing: str, config: Config, lane_width_m: float
) -> str:
    """Add the check ``paper`` to a graph; return the output ``action``, which it executes.

    The inputs are names: the proposed actions, the indicators and whether a lane change is in
    progress. Its direction is that of the lateral speed. A missing vehicle is one at the range
    with the ego's speed, a missing lane one in which a vehicle is beside the ego.

    Raises:
        ConfigError: the lateral plant is not kinematic, or the range is within the smallest gap.
    """
    safety, add = config.safety, graph.add
    if config.ego.has_steering or config.observation.range_m <= safety.minimum_gap_m:
        raise ConfigError(
            "The check paper of a file needs ego.lateral_plant = 'kinematic', whose lateral speed "
            "is that of the lane change, and observation.range_m above safety.minimum_gap_m: "
            "export without --safety-check."
        )

    def column(index: int) -> str:
        return add("Gather", indicators, np.int64(index), axis=1)

    def gap_condition(gap_m: str, closing_m_s: str) -> str:
        least_m = add("Mul", safety.minimum_ttc_s, closing_m_s)
        return add("Greater", add("Sub", gap_m, least_m), safety.minimum_gap_m)

    lateral, along = (add(kind, proposed, np.int64(4)) for kind in ("Div", "Mod"))
    own = add("Floor", add("Add", add("Div", column(Y), lane_width_m), 0.5))
    offset_m = add("Sub", column(Y), add("Mul", own, lane_width_m))
    toward = add("Sign", column(SPEED_Y))
    left_behind = add("Less", add("Mul", toward, offset_m), 0.0)  # the centre is in the target
    toward = add("Cast", toward, to=7)
    target = add("Where", left_behind, np.int64(0), toward)
    origin = add("Sub", target, toward)
    still, sign = add("Not", changing), add("Gather", np.array(SIGNS), lateral)
    turns = add("Equal", sign, add("Neg", toward))
    end = add("Where", still, sign, add("Where", turns, origin, target))
    start = add("Where", still, np.int64(0), add("Where", turns, target, origin))
    front_m, front_m_s = (add("Gather", indicators, at, axis=1) for at in (FRONTS, FRONTS + 1))
    rear_m, rear_m_s = (add("Gather", indicators, at, axis=1) for at in (REARS, REARS + 1))
    fronts = gap_condition(front_m, add("Neg", front_m_s))
    free = add("And", fronts, gap_condition(rear_m, rear_m_s))
    free = add("And", free, add("Gather", fronts, np.array([0]), axis=1))

    def is_clear(side: str) -> str:
        at = add("Unsqueeze", add("Mod", side, np.int64(3)), np.array([1]))
        return add("Squeeze", add("GatherElements", free, at, axis=1), np.array([1]))

    goes_back = add("Or", still, add("Equal", start, np.int64(0)))
    goes_back = add("Or", add("Or", goes_back, is_clear(start)), np.array(safety.printed_rule_3))
    goes_on = add("Or", add("Equal", start, end), is_clear(end))
    goes_on = add("Or", goes_on, add("Not", goes_back))
    back = add("Where", add("Greater", end, start), np.int64(RIGHT), np.int64(LEFT))
    back = add("Where", still, np.int64(KEEP), back)
    across = add("Where", goes_on, lateral, back)
    gap_m, closing_m_s = column(0), add("Neg", column(1))
    ttc_s = add("Div", gap_m, closing_m_s)
    safe = add("LessOrEqual", ttc_s, safety.brake_ttc_s)
    safe = add("Where", safe, np.int64(BRAKE), np.int64(MAINTAIN))
    hard = add("LessOrEqual", ttc_s, safety.hard_brake_ttc_s)
    safe = add("Where", hard, np.int64(HARD_BRAKE), safe)
    enough = add("GreaterOrEqual", along, safe)
    enough = add("And", enough, add("Not", add("Equal", along, np.int64(ACCELERATE))))
    enough = add("And", enough, np.array(not safety.printed_rule_1))
    enough = add("Or", enough, add("LessOrEqual", closing_m_s, 0.0))
    enough = add("Or", enough, gap_condition(gap_m, closing_m_s))
    along = add("Where", enough, along, safe)
    return add("Add", add("Mul", across, np.int64(4)), along, name="action")


FAR = 2048.0
"""Larger than any difference of logits; subtracted from those of the actions that are refused."""
WIDE, MASK = "the wide observation: HighwayEnv(observation='wide')", "env.action_masks()"
ACTOR_INPUTS: Sequence[Port] = (
    Port("observation", "float32", len(WIDE_NAMES), WIDE),
    Port("action_mask", "bool", len(ACTIONS), f"which actions the safety check permits: {MASK}"),
)
ACTOR_OUTPUTS: Sequence[Port] = (
    Port("action", "int64", None, "number of the permitted action with the largest logit"),
    Port("logits", "float32", len(ACTIONS), "the logits of all actions, without the mask"),
)


def export_actor(path: Path, layers: Layers, config: Config) -> None:
    """Write the driver to an ONNX file, with the package onnx.

    ``ACTOR_INPUTS`` and ``ACTOR_OUTPUTS`` describe the file. Its metadata hold the config, and the
    names of the observation's numbers and of the actions. If no action of a row is permitted, the
    action is that with the largest logit.

    Raises:
        DrlAvError: onnx is not installed, or the file cannot be written.
    """
    graph = Graph()
    mask = graph.add("Cast", "action_mask", to=1)
    seen = graph.add("Concat", "observation", mask, axis=1)
    logits = graph.add("Identity", graph.forward(layers, seen), name="logits")
    refused = graph.add("Sub", logits, np.float32(FAR))
    ranked = graph.add("Where", "action_mask", logits, refused)
    graph.add("ArgMax", ranked, name="action", axis=1, keepdims=0)
    held = {
        "config": config.to_toml(),
        "observation": json.dumps(WIDE_NAMES),
        "actions": json.dumps([str(action) for action in ACTIONS]),
    }
    graph.write(path, ACTOR_INPUTS, ACTOR_OUTPUTS, held)
