"""Builds ONNX graphs, and writes the check ``paper`` as one (ours)."""

from typing import Any

import numpy as np

from drl_av.config import Config
from drl_av.driving.actions import ACCELERATE, BRAKE, HARD_BRAKE, KEEP, LEFT, MAINTAIN, RIGHT, SIGNS
from drl_av.errors import ConfigError


class Graph:
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

    def add(self, kind: str, *inputs: object, name: str | None = None, **attributes: Any) -> str:
        """Add a node of the operator ``kind`` with one output, and return the output's name.

        An input is the name of an output, or the values of a constant.
        """
        output = name or f"{kind.lower()}_{len(self.nodes)}"
        given = [each if isinstance(each, str) else self.constant(each) for each in inputs]
        self.nodes.append(self._onnx.helper.make_node(kind, given, [output], **attributes))
        return output


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
