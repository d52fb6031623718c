"""Finds a route in a network of the user, and follows its lanes from edge to edge."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config.schema import did_you_mean
from drl_av.errors import ScenarioError
from drl_av.scenarios.imported.net_file import BROKEN, REMEDY, NetFile, read_net
from drl_av.scenarios.layout import Point
from drl_av.scenarios.netconvert import PRECISION

CARS = "passenger"
"""SUMO's class of vehicles that the lanes must admit."""
PRIORITY = ("M", "Z")
"""SUMO's states of a connection that need not give way to other traffic: major, and zipper."""
TOLERANCE_M = 0.01
"""Largest difference between the lengths of the lanes of an edge; SUMO rounds to centimetres."""
SHORTEST_M = 0.1
"""Smallest length of an edge in SUMO."""
MOST_EDGES = 1000
"""Largest number of edges of a route."""
FARTHEST_M = 1e7
"""Largest coordinate of a network in metres."""


class Section(NamedTuple):
    """An edge of a route, with the way through the junction after it."""

    edge: str
    """The edge's id."""
    begin_m: float
    end_m: float
    """Its beginning, and the end of the way through the junction, in metres along the route."""
    speed_limit_m_s: float
    lanes: range
    """Indices of its lanes on the road, rightmost first."""
    leading_on: range
    """Indices of those ``lanes`` that continue on the next edge of the route."""
    leading_away: frozenset[int]
    """Indices of those ``lanes`` that lead cars to another edge than the next one of the route."""
    shape: tuple[Point, ...]
    spread: str
    """SUMO's spreadType: how the lanes lie about the shape."""


class Route(NamedTuple):
    """A route through a network, whose lanes continue side by side from edge to edge."""

    sections: tuple[Section, ...]
    lane_width_m: float

    @property
    def length_m(self) -> float:
        """The length of the route, metres."""
        return self.sections[-1].end_m


class _Step(NamedTuple):
    """The way from an edge to the next one."""

    leading_on: range
    """Lane indices in SUMO, on the first edge."""
    shift: int
    """The SUMO index of a lane on the second edge minus that of the same lane on the first."""
    length_m: float
    """Mean length of the lanes inside the junction between them."""
    leading_away: frozenset[int]
    """Lane indices in SUMO, on the first edge, of the lanes that lead to yet another edge."""


def read_route(path: Path, from_edge: str, to_edge: str) -> Route:
    """Return the shortest route for cars from one edge to another in a network file.

    The length of a lane inside a junction counts as part of the edge before the junction. Where the
    number of lanes changes, SUMO's connections determine which lanes continue; all others begin or
    end there. If a lane leads to two lanes of the next edge, drl-av makes the choice with which the
    largest number of lanes continues.

    Raises:
        ScenarioError: the file is no network of SUMO, there is no such route, or the route is no
            highway that drl-av can drive; each message names the file and what to do.
    """
    file = read_net(path)
    try:
        edges = _way(file.net, from_edge, to_edge)
        for edge in edges:
            _require_equal_lanes(edge)
        width_m = _lane_width(edges)
        steps = [_step(file.net, edge, following) for edge, following in pairwise(edges)]
        return Route(tuple(_sections(file, edges, steps)), width_m)
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from error
    except BROKEN as error:
        raise ScenarioError(f"{path} lacks or misstates {error}: {REMEDY}.") from error


def _way(net: Any, from_edge: str, to_edge: str) -> Sequence[Any]:
    """Return the edges of the shortest route for cars; raise ScenarioError if there is none."""
    names = [edge.getID() for edge in net.getEdges(withInternal=False)]
    for name in (from_edge, to_edge):
        if name not in names:
            raise ScenarioError(
                f"there is no edge {name!r}{did_you_mean(name, names)}: name an edge of the "
                "network, as netedit shows them."
            )
    ends = net.getEdge(from_edge), net.getEdge(to_edge)
    edges: Sequence[Any] | None = net.getShortestPath(*ends, vClass=CARS)[0]
    if edges is None:
        raise ScenarioError(
            f"no way leads cars from edge {from_edge!r} to edge {to_edge!r}: name two edges of one "
            "carriageway, the first one first."
        )
    if len(edges) > MOST_EDGES:
        raise ScenarioError(
            f"the route has {len(edges)} edges, but may have {MOST_EDGES}: join them by "
            "netconvert --geometry.remove."
        )
    return edges


def _require_equal_lanes(edge: Any) -> None:
    """Raise ScenarioError unless the lanes of an edge admit cars and have one length and limit."""
    name, lanes = edge.getID(), edge.getLanes()
    for lane in lanes:
        if not lane.allows(CARS):
            raise ScenarioError(
                f"lane {lane.getID()!r} is closed to passenger cars: remove it in netedit, or "
                "choose another route."
            )
    limits = sorted({lane.getSpeed() for lane in lanes})
    if len(limits) > 1:
        raise ScenarioError(
            f"the lanes of edge {name!r} have the speed limits {limits[0]:g} to {limits[-1]:g} "
            "m/s, but must have one: change it in netedit, or choose another route."
        )
    lengths = sorted(lane.getLength() for lane in lanes)
    if lengths[-1] - lengths[0] > TOLERANCE_M:
        raise ScenarioError(
            f"the lanes of edge {name!r} are {lengths[0]:g} to {lengths[-1]:g} m long, but must be "
            "equally long: write the network again with netconvert."
        )


def _lane_width(edges: Sequence[Any]) -> float:
    """Return the width of all lanes of a route; raise ScenarioError if they are not equal."""
    lanes = [lane for edge in edges for lane in edge.getLanes()]
    width_m = float(lanes[0].getWidth())
    for lane in lanes:
        if lane.getWidth() != width_m:
            raise ScenarioError(
                f"lane {lanes[0].getID()!r} is {width_m:g} m wide and lane {lane.getID()!r} "
                f"{lane.getWidth():g} m, but all lanes of the route must have one width: change it "
                "in netedit."
            )
    return width_m


def _step(net: Any, edge: Any, following: Any) -> _Step:
    """Return the way from an edge to the following one."""
    ways = {
        (way.getFromLane().getIndex(), way.getToLane().getIndex()): way
        for way in edge.getConnections(following)
        if way.allows(CARS)
    }
    lanes = range(edge.getLaneNumber())
    aligned_left = following.getLaneNumber() - len(lanes)

    def likelihood(shift: int) -> tuple[int, int]:
        kept = sum((lane, lane + shift) in ways for lane in lanes)
        return kept, -abs(shift - aligned_left)

    shift = max(range(1 - len(lanes), following.getLaneNumber()), key=likelihood)
    leading_on = [lane for lane in lanes if (lane, lane + shift) in ways]
    if leading_on != [*range(leading_on[0], leading_on[-1] + 1)]:
        raise ScenarioError(
            f"between lanes of edge {edge.getID()!r} that lead on to edge {following.getID()!r} "
            "lies one that does not: connect it in netedit, or choose another route."
        )
    passages = [ways[lane, lane + shift] for lane in leading_on]
    for passage in passages:
        _require_priority(passage)
    lengths = [_inside_m(net, passage) for passage in passages]
    away = frozenset(
        way.getFromLane().getIndex()
        for other, others in edge.getOutgoing().items()
        for way in others
        if other is not following and way.allows(CARS)
    )
    return _Step(range(leading_on[0], leading_on[-1] + 1), shift, sum(lengths) / len(lengths), away)


def _require_priority(passage: Any) -> None:
    """Raise ScenarioError if other traffic may have priority over a passage of a junction."""
    junction, edge = passage.getJunction().getID(), passage.getFrom().getID()
    if passage.getTLSID():
        raise ScenarioError(
            f"junction {junction!r} at the end of edge {edge!r} has traffic lights: choose a "
            "route without, or remove them in netedit."
        )
    if passage.getState() not in PRIORITY:
        raise ScenarioError(
            f"the route gives way at junction {junction!r} at the end of edge {edge!r}, but "
            "traffic from elsewhere is left out: choose a route that has priority."
        )


def _inside_m(net: Any, passage: Any) -> float:
    """Return the length of the lanes inside a junction on a passage through it, metres."""
    length_m, via = 0.0, passage.getViaLaneID()
    passed: list[str] = []
    while via and via not in passed:
        passed.append(via)
        edge, _, index = via.rpartition("_")
        lane = net.getEdge(edge).getLane(int(index))
        length_m += float(lane.getLength())
        via = next((way.getViaLaneID() for way in lane.getOutgoing()), "")
    return length_m


def _sections(file: NetFile, edges: Sequence[Any], steps: Sequence[_Step]) -> list[Section]:
    """Return the sections of a route; the lowest lane index on the road is 0."""
    rightmost = [0]
    for step in steps:
        rightmost.append(rightmost[-1] - step.shift)
    lowest, begin_m = min(rightmost), 0.0
    sections: list[Section] = []
    last = _Step(range(edges[-1].getLaneNumber()), 0, 0.0, frozenset())
    for edge, right, step in zip(edges, rightmost, (*steps, last), strict=True):
        first = right - lowest
        shape = tuple((float(x), float(y)) for x, y in edge.getRawShape())
        if not all(abs(at_m) < FARTHEST_M for point in shape for at_m in point):
            raise ScenarioError(
                f"the shape of edge {edge.getID()!r} has a coordinate beyond {FARTHEST_M / 1e3:g} "
                "km: write the network again with netconvert."
            )
        length_m = max(edge.getLength() + step.length_m, SHORTEST_M)
        end_m = round(begin_m + length_m, PRECISION)
        sections.append(
            Section(
                edge.getID(),
                begin_m,
                end_m,
                float(edge.getSpeed()),
                range(first, first + edge.getLaneNumber()),
                range(first + step.leading_on.start, first + step.leading_on.stop),
                frozenset(first + lane for lane in step.leading_away),
                shape,
                file.spreads[edge.getID()],
            )
        )
        begin_m = end_m
    return sections
