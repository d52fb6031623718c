"""Reads the loop of a SUMO network file, and compares it with the scenario's description."""

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from drl_av.errors import ScenarioError, counted
from drl_av.traffic.description import ScenarioDescription

TOLERANCE = 1e-6
SUMO_LANE_WIDTH_M = "3.2"
"""The width that SUMO gives a lane without a width attribute."""


@dataclass(frozen=True)
class Loop:
    """The closed loop of a network."""

    edges: tuple[str, ...]
    """Edge ids in driving order."""
    lane_positions: dict[str, tuple[int, float]]
    """By SUMO lane id: index of the lane, and position of its start along the loop, metres."""
    circumference_m: float


def read_loop(network: ET.Element, description: ScenarioDescription, name: str) -> Loop:
    """Return the loop of a network; check that it is closed and agrees with the description.

    ``network`` is the root element of SUMO's network file, ``name`` the file's name.

    Raises:
        ScenarioError: the road is not a closed loop, or differs from the description; the message
            contains ``name``.
    """
    try:
        lanes = {edge.attrib["id"]: edge.findall("lane") for edge in network.iter("edge")}
        edges, vias = _follow(network, description)
        positions: dict[str, tuple[int, float]] = {}
        s_m = 0.0
        for piece in _pieces(edges, vias):
            for lane in lanes[piece]:
                positions[lane.attrib["id"]] = (int(lane.attrib["index"]), s_m)
            s_m += _length_m(lanes[piece], piece)
        for edge in edges:
            _compare(lanes[edge], edge, description)
        if abs(s_m - description.circumference_m) > TOLERANCE:
            raise _LoopMismatch(f"is {s_m:.6f} m long, not {description.circumference_m:.6f} m")
    except (_LoopMismatch, KeyError, ValueError) as error:
        reason = str(error) if isinstance(error, _LoopMismatch) else f"lacks or misstates {error}"
        raise ScenarioError(
            f"The road in {name} {reason}: write the scenario again with: drl-av scenario DIR."
        ) from error
    return Loop(edges, positions, s_m)


class _LoopMismatch(Exception):
    """The road is not the described loop; the message completes a sentence "The road ..."."""


def _follow(
    network: ET.Element, description: ScenarioDescription
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the edges in driving order, and the junction edge after each edge that has one.

    Raises:
        _LoopMismatch: the edges are not one closed loop.
    """
    normal = [e.attrib["id"] for e in network.iter("edge") if e.get("function") is None]
    if not normal:
        raise _LoopMismatch("has no edges")
    ways: dict[str, list[ET.Element]] = defaultdict(list)
    for connection in network.iter("connection"):
        ways[connection.attrib["from"]].append(connection)
    edges: list[str] = []
    vias: dict[str, str] = {}
    edge = normal[0]
    while edge not in edges:
        edges.append(edge)
        following, via = _step(ways[edge], edge, description)
        if via:
            vias[edge] = via
        edge = following
    if edge != edges[0] or len(edges) != len(normal):
        raise _LoopMismatch("is not one closed loop through all its edges")
    return tuple(edges), vias


def _step(
    ways: list[ET.Element], edge: str, description: ScenarioDescription
) -> tuple[str, str | None]:
    """Return the id of the edge after ``edge``, and that of the junction edge between them or None.

    ``ways`` are the connections that leave ``edge``.

    Raises:
        _LoopMismatch: there is not exactly one next edge, or its lanes are connected otherwise than
            straight on.
    """
    following = {way.attrib["to"] for way in ways}
    if len(following) != 1:
        raise _LoopMismatch(f"leads from edge {edge!r} to {len(following)} edges instead of one")
    onward = {(int(way.attrib["fromLane"]), int(way.attrib["toLane"])) for way in ways}
    needed = {(lane, lane) for lane, is_open in enumerate(description.open_lanes) if is_open}
    if onward != needed:
        raise _LoopMismatch(
            f"does not lead each open lane of edge {edge!r}, and no other, straight on"
        )
    via = ways[0].get("via")
    return following.pop(), via.rsplit("_", 1)[0] if via else None


def _pieces(edges: tuple[str, ...], vias: dict[str, str]) -> Iterator[str]:
    """Yield the ids of all edges and junction edges in driving order."""
    for edge in edges:
        yield edge
        if edge in vias:
            yield vias[edge]


def _length_m(lanes: list[ET.Element], edge: str) -> float:
    """Return the common length of an edge's lanes, metres; raise _LoopMismatch if they differ."""
    lengths = {float(lane.attrib["length"]) for lane in lanes}
    if len(lengths) != 1:
        raise _LoopMismatch(f"has no lanes of one length on edge {edge!r}")
    return lengths.pop()


def _compare(lanes: list[ET.Element], edge: str, description: ScenarioDescription) -> None:
    """Raise _LoopMismatch unless the lanes of an edge are as the description says."""
    if len(lanes) != description.lanes:
        raise _LoopMismatch(
            f"has {counted(len(lanes), 'lane')} on edge {edge!r}, not {description.lanes}"
        )
    for index, (lane, is_open) in enumerate(zip(lanes, description.open_lanes, strict=True)):
        if lane.attrib["index"] != str(index) or lane.attrib["id"] != f"{edge}_{index}":
            raise _LoopMismatch(f"has no lane {index} in its place on edge {edge!r}")
        if lane.get("allow") is not None or lane.get("disallow") not in (None, "all"):
            raise _LoopMismatch(f"has lane {lane.attrib['id']!r} for some kinds of vehicles only")
        if (lane.get("disallow") is None) != is_open:
            state = "barricaded" if is_open else "open"
            raise _LoopMismatch(f"has lane {lane.attrib['id']!r} {state}, unlike its description")
        for attribute, default, wanted in (
            ("width", SUMO_LANE_WIDTH_M, description.lane_width_m),
            ("speed", "nan", description.speed_limit_m_s),
        ):
            value = float(lane.get(attribute, default))
            if not abs(value - wanted) <= TOLERANCE:
                raise _LoopMismatch(
                    f"has {attribute} {value:g} on lane {lane.attrib['id']!r}, not {wanted:g}"
                )
