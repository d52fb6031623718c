"""Builds SUMO's network files with netconvert, from the plan of a road, and writes XML."""

import os
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from drl_av.errors import ScenarioError, SimulationError
from drl_av.scenarios.layout import CONNECTION, Edge, Plan, Point, connections, split_long_edges
from drl_av.sumo_programs import missing_library, program

NETWORK_FILE = "highway.net.xml"
"""Name of the network file in a scenario folder."""
WRITE_AGAIN = "write the scenario again with: drl-av scenario DIR"
"""The advice if a file of a scenario folder is missing, damaged or changed."""
DEMO_END_S = 3600
"""Time at which the demo traffic ends."""
PRECISION = 6
"""Decimals of every length and coordinate in the network file."""


def xml_text(root: ET.Element) -> str:
    """Return an element as an indented XML document; the text is the same on every machine."""
    ET.indent(root, "    ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"


def network_text(plan: Plan, speed_limit_m_s: float) -> str:
    """Return the text of the network file of a road; the limit is that of edges that state none.

    Raises:
        ScenarioError: netconvert refuses the road.
        SimulationError: netconvert cannot be run.
    """
    plan = split_long_edges(plan)
    roots = {name: ET.Element(f"{name}s") for name in ("node", "edge", "connection")}
    nodes: dict[Point, str] = {}
    for edge in plan.edges:
        ends = [*zip((edge.begin_m, edge.end_m % plan.road.lap_m), edge.drawn_aside_m, strict=True)]
        drawn = [edge.shape[0], edge.shape[-1]] if edge.shape else [(s, -y) for s, y in ends]
        for end, (x_m, y_m) in zip(ends, drawn, strict=True):
            if end not in nodes:
                nodes[end] = f"n{len(nodes)}"
                place = {"x": _text(x_m), "y": _text(y_m), "type": "priority"}
                ET.SubElement(roots["node"], "node", {"id": nodes[end]} | place)
        _add_edge(roots["edge"], edge, [nodes[end] for end in ends], plan, speed_limit_m_s)
    for way in sorted(connections(plan)):
        ET.SubElement(roots["connection"], "connection", dict(zip(CONNECTION, way, strict=True)))
    return netconvert(roots)


def _add_edge(
    root: ET.Element, edge: Edge, nodes: list[str], plan: Plan, speed_limit_m_s: float
) -> None:
    """Add an edge to netconvert's input; without a shape its lanes lie to the right of a line."""
    width_m, leftmost = plan.road.lane_width_m, len(plan.road.open_lanes) - 1
    line_m = -(leftmost - edge.lanes[-1]) * width_m
    ends = zip((edge.begin_m, edge.end_m), edge.drawn_aside_m, strict=True)
    limits = edge.limits(speed_limit_m_s)
    element = ET.SubElement(
        root,
        "edge",
        {"id": edge.id, "from": nodes[0], "to": nodes[1]},
        numLanes=str(len(edge.lanes)),
        speed=repr(max(limits)),
        width=repr(width_m),
        length=repr(edge.end_m - edge.begin_m),
        spreadType=edge.spread,
        shape=shape_text(edge.shape or [(s_m, line_m - aside_m) for s_m, aside_m in ends]),
    )
    for index, (lane, limit_m_s) in enumerate(zip(edge.lanes, limits, strict=True)):
        further = dict(edge.lane_attributes.get(lane, {}))
        if limit_m_s != max(limits):
            further["speed"] = repr(limit_m_s)
        if further:
            ET.SubElement(element, "lane", {"index": str(index)} | further)


def shape_text(points: Iterable[Point]) -> str:
    """Return the points of a line as SUMO's text, ``x,y x,y``."""
    return " ".join(f"{_text(x_m)},{_text(y_m)}" for x_m, y_m in points)


def _text(value_m: float) -> str:
    """Return a coordinate as text with a fixed number of decimals."""
    return f"{value_m + 0.0:.{PRECISION}f}"


def netconvert(parts: Mapping[str, ET.Element]) -> str:
    """Return the text of the network file that netconvert builds from its inputs.

    ``parts`` are the root elements of the inputs, by kind ("node", "edge", "connection").

    Raises:
        ScenarioError: netconvert refuses the inputs.
        SimulationError: netconvert cannot be run.
    """
    with tempfile.TemporaryDirectory() as scratch:
        network, arguments = Path(scratch, "net.xml"), []
        for name, root in parts.items():
            file = Path(scratch, f"{name}.xml")
            file.write_text(xml_text(root), encoding="utf-8")
            arguments += [f"--{name}-files", str(file)]
        _run_netconvert(arguments, network)
        text = network.read_text(encoding="utf-8")
    return re.sub(r"<!-- generated on .*?-->\s*", "", text, count=1, flags=re.DOTALL)


def _run_netconvert(files: Sequence[str], network: Path) -> None:
    """Let netconvert write the file ``network``; ``files`` are the options that name its inputs."""
    executable = program("netconvert")
    arguments = [
        *files,
        *("--output-file", str(network)),
        *("--no-internal-links", "true", "--no-turnarounds", "true"),
        *("--offset.disable-normalization", "true", "--precision", str(PRECISION)),
    ]
    environment = os.environ | {"SUMO_HOME": str(executable.parents[1])}
    try:
        done = subprocess.run(
            [executable, *arguments], capture_output=True, text=True, check=False, env=environment
        )
    except OSError as error:
        raise SimulationError(f"SUMO's netconvert cannot be run: {error}.") from error
    if done.returncode == 127:
        raise SimulationError(missing_library("SUMO's netconvert", done.stderr))
    if done.returncode != 0 or not network.is_file():
        reason = " ".join(done.stderr.split()) or f"exit status {done.returncode}"
        raise ScenarioError(f"SUMO's netconvert cannot build this road: {reason}")
