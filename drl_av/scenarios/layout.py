"""The plan of a road, its edges in SUMO, and their shapes."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate, chain, groupby, pairwise, zip_longest
from operator import itemgetter
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from drl_av.errors import ScenarioError
from drl_av.road.road import Road, SpeedLimit, is_open, lane_end_m

Point = tuple[float, float]
"""The coordinates x and y of a place in sumo-gui, metres."""


class OpenStart(NamedTuple):
    """The positions at which vehicles start on an open road and enter it."""

    lanes: tuple[int, ...]
    """Indices of the lanes of the other vehicles; these lanes extend along the whole road."""
    span_m: float
    """The other vehicles start between 0 and this position, and leave the road beyond it."""
    flow_per_h: float
    """Inflow of each lane in ``lanes``, vehicles per hour."""
    ego_lane: int | None
    """Index of the lane in which the ego starts; None chooses one of ``lanes`` at random."""
    ego_front_m: float
    """Position of the ego's front bumper at the start."""
    ego_speed_m_s: float | None = None
    """Speed of the ego at the start; None is a safe speed behind the vehicle ahead."""
    speed_limits: tuple[SpeedLimit, ...] = ()
    """The speed limits of ``lanes``, in driving order without gaps. Empty if the road has one
    limit, which no setting may exceed."""

    def travel_s(self, begin_m: float, end_m: float, speed_m_s: float) -> float:
        """Return the time of a drive at a speed, or at the limits that are lower, seconds."""
        limits = self.speed_limits or (SpeedLimit(begin_m, end_m, speed_m_s),)
        return sum(
            max(min(one.end_m, end_m) - max(one.begin_m, begin_m), 0.0)
            / min(one.limit_m_s, speed_m_s)
            for one in limits
        )


class Edge(NamedTuple):
    """A part of a road that has the same lanes from its beginning to its end."""

    id: str
    begin_m: float
    end_m: float
    lanes: range
    """Indices of its lanes on the road, rightmost first."""
    drawn_aside_m: tuple[float, float] = (0.0, 0.0)
    """Shift to the right of its beginning and of its end in the picture of sumo-gui, metres."""
    lane_limits_m_s: tuple[float, ...] = ()
    """The speed limit of each of ``lanes``; empty for the speed limit of the description."""
    lane_attributes: Mapping[int, Mapping[str, str]] = MappingProxyType({})
    """Further SUMO attributes of single lanes, by the index of the lane on the road."""
    shape: tuple[Point, ...] = ()
    """Points of the line along which sumo-gui draws the edge; empty for a straight edge."""
    spread: str = "right"
    """SUMO's spreadType: how its lanes lie about ``shape``."""

    def limits(self, usual_m_s: float) -> tuple[float, ...]:
        """Return the speed limit of each of ``lanes``; ``usual_m_s`` is that of the description."""
        return self.lane_limits_m_s or (usual_m_s,) * len(self.lanes)


class Plan(NamedTuple):
    """A road: its edges and routes in SUMO, and the same road as the simulation needs it.

    An edge leads to each edge whose ``begin_m`` equals its ``end_m``; the last edge of a loop leads
    to the first. There each lane continues in the lane with the same index, unless ``road`` says
    that the lane ends or is closed. The first route is that of the traffic, and of an ego that has
    missed its exit. The last route is that of the ego.
    """

    edges: tuple[Edge, ...]
    routes: dict[str, tuple[str, ...]]
    road: Road
    start: OpenStart | None = None
    """None on a loop, on which the vehicles may start at any position."""


class OpenPlan(Plan):
    """The plan of an open road.

    SUMO needs a road beyond ``road.end_m``: if no edge begins there, ``split_long_edges`` extends
    the edges that end there.
    """

    start: OpenStart


LOOP_ROUTE_M = 100_000.0
"""Smallest length of a route on a loop."""


class Layout(NamedTuple):
    """The road of a scenario, as the simulation needs it and as SUMO describes it."""

    road: Road
    routes: dict[str, tuple[str, ...]]
    """The SUMO edge ids of each route, in driving order; the key is the name of the route. The
    route of a loop is one lap."""
    lane_positions: dict[str, tuple[int, float]]
    """By SUMO lane id: the index of the lane on the road, and the position of its start, metres."""
    edge_ends_m: dict[str, float]
    """By SUMO edge id the position of its end, metres."""
    start: OpenStart | None = None
    """None on a loop."""

    def route(self, name: str, distance_m: float) -> list[str]:
        """Return the edge ids of a route, on a loop with the laps for at least ``distance_m``.

        SUMO removes a vehicle at the end of its route.
        """
        laps = 1
        if self.road.is_loop:
            laps = 2 + round(max(distance_m, LOOP_ROUTE_M) / self.road.lap_m)
        return list(self.routes[name]) * laps


def route_on(routes: Mapping[str, tuple[str, ...]], edge: str, is_way: bool) -> str:
    """Return the name of the route for a vehicle that starts on ``edge``.

    Of the routes that contain ``edge`` it is the first one, or the last one if ``is_way`` is true.
    ``is_way`` is true for the ego, and for each vehicle that starts in a partial lane, because the
    other routes may not lead through such a lane.

    Raises:
        IndexError: no route contains ``edge``.
    """
    names = [name for name, edges in routes.items() if edge in edges]
    return names[-1 if is_way else 0]


Connection = tuple[str, str, str, str]
"""A connection of two lanes in SUMO: edge, index of its lane, next edge, index of its lane."""
CONNECTION = ("from", "fromLane", "to", "toLane")
"""The SUMO attributes of a connection."""


def connections(plan: Plan) -> set[Connection]:
    """Return the connections of the lanes of a road."""
    road = plan.road
    return {
        (one.id, str(lane - one.lanes[0]), other.id, str(lane - other.lanes[0]))
        for one in plan.edges
        for other in plan.edges
        if one.end_m % road.lap_m == other.begin_m
        for lane in one.lanes
        if lane in other.lanes
        and is_open(lane, road)
        and lane_end_m(lane, one.begin_m, road) > one.end_m
    }


LANE_ATTRIBUTES = ("allow", "disallow", "changeLeft", "changeRight")
"""The SUMO attributes of single lanes that must be as described (netconvert guesses others)."""
TOLERANCE = 1e-6


class NetworkLane(NamedTuple):
    """A lane as the network file of a scenario must have it."""

    edge: str
    length_m: float
    width_m: float
    speed_m_s: float
    attributes: Mapping[str, str] = MappingProxyType({})
    """Its values of ``LANE_ATTRIBUTES``; those that it lacks, it must not have."""


def require_network(
    network: ET.Element, lanes: Mapping[str, NetworkLane], connections: set[Connection], name: str
) -> None:
    """Compare a network with the described lanes, by SUMO lane id, and their connections.

    Args:
        network: The root element of the network file.
        lanes: All lanes; the lanes of an edge are in the order of their indices.
        connections: All connections.
        name: The file's name.

    Raises:
        ScenarioError: the network differs from the description; the message contains ``name``.
    """
    ways = network.iter("connection")
    found = {tuple(way.get(key, "") for key in CONNECTION) for way in ways}
    reason = _difference(network, lanes)
    if reason is None and found != connections:
        reason = "leads its lanes on otherwise than described"
    if reason is not None:
        raise ScenarioError(
            f"The road in {name} {reason}: write the scenario again with: drl-av scenario DIR."
        )


def _difference(network: ET.Element, wanted: Mapping[str, NetworkLane]) -> str | None:
    """Return how the lanes of a network differ from the described ones, or None if they do not.

    The result completes a sentence "The road ...".
    """
    lanes = [(edge, lane) for edge in network.iter("edge") for lane in edge.findall("lane")]
    places = [(e.get("id", ""), lane.get("id", ""), lane.get("index", "")) for e, lane in lanes]
    needed = [(lane.edge, name, name.rpartition("_")[2]) for name, lane in wanted.items()]
    pairs = zip_longest(sorted(places, key=itemgetter(0)), sorted(needed, key=itemgetter(0)))
    for place, need in pairs:
        if place != need:
            return f"has other lanes than described, one is {(place or need)[1]!r}"
    for _, lane in lanes:
        lane_id = lane.attrib["id"]
        _, length_m, width_m, speed_m_s, attributes = wanted[lane_id]
        for attribute, value in (("length", length_m), ("width", width_m), ("speed", speed_m_s)):
            try:
                number = float(lane.get(attribute, "nan"))
            except ValueError:
                number = float("nan")
            if not abs(number - value) <= TOLERANCE:
                return f"has {attribute} {lane.get(attribute)} on lane {lane_id!r}, not {value:g}"
        for attribute in LANE_ATTRIBUTES:
            if (has := lane.get(attribute)) != (needs := attributes.get(attribute)):
                return f"has {attribute} {has!r} on lane {lane_id!r}, not {needs!r}"
    return None


RUN_OUT_M = 500.0
"""Length of SUMO's road beyond the end of the ego's way; vehicles are removed before its end."""
LONGEST_M = 2000.0
"""Length of the longest edge that is not divided (ours)."""
PIECE_M = 400.0
"""Length of the longest piece of a divided edge (ours), with which SUMO is the fastest."""


def split_long_edges(plan: Plan) -> Plan:
    """Return a plan with the edges and routes that its road has in SUMO; a loop stays as it is.

    The last edges extend beyond the end of the ego's way. An edge longer than ``LONGEST_M`` is
    divided: for each vehicle SUMO looks at all vehicles in the same lane of the edge, so the time
    of a step would grow with the square of their number.
    """
    if plan.road.is_loop:
        return plan
    end_m = plan.road.end_m
    run_out_m = 0.0 if any(edge.begin_m == end_m for edge in plan.edges) else RUN_OUT_M
    pieces = {
        edge.id: pieces_of(edge._replace(end_m=end_m + run_out_m) if edge.end_m == end_m else edge)
        for edge in plan.edges
    }
    routes = {
        name: tuple(piece.id for edge in edges for piece in pieces[edge])
        for name, edges in plan.routes.items()
    }
    return plan._replace(edges=tuple(chain(*pieces.values())), routes=routes)


def pieces_of(edge: Edge) -> list[Edge]:
    """Return the pieces of an edge, of equal length up to a metre; the first one keeps its id."""
    length_m = edge.end_m - edge.begin_m
    if length_m <= LONGEST_M:
        return [edge]
    count = math.ceil(length_m / PIECE_M)
    cuts_m = [edge.begin_m + round(length_m * cut / count) for cut in range(1, count)]
    return cut_edge(edge, cuts_m)


def cut_edge(edge: Edge, cuts_m: Sequence[float], name: str = "") -> list[Edge]:
    """Return the parts of an edge between ascending positions, metres along the road.

    The first part keeps the id of the edge; the others add ``name`` and a number to it.
    """
    length_m = edge.end_m - edge.begin_m
    first_m, last_m = edge.drawn_aside_m
    slope = (last_m - first_m) / length_m
    shares = [(cut_m - edge.begin_m) / length_m for cut_m in (edge.begin_m, *cuts_m, edge.end_m)]
    shapes = cut_line(edge.shape, shares) if edge.shape else [()] * (len(cuts_m) + 1)
    return [
        edge._replace(
            id=f"{edge.id}.{name}{number}" if number else edge.id,
            begin_m=begin_m,
            end_m=end_m,
            drawn_aside_m=(
                first_m + slope * (begin_m - edge.begin_m),
                first_m + slope * (end_m - edge.begin_m),
            ),
            shape=shape,
        )
        for number, ((begin_m, end_m), shape) in enumerate(
            zip(pairwise([edge.begin_m, *cuts_m, edge.end_m]), shapes, strict=True)
        )
    ]


def ways_along(points: Sequence[Point]) -> list[float]:
    """Return the distance of each point of a line from its first one along the line, metres."""
    return [*accumulate((math.dist(*ends) for ends in pairwise(points)), initial=0.0)]


def cut_line(points: Sequence[Point], shares: Sequence[float]) -> list[tuple[Point, ...]]:
    """Return the parts of a line between ascending shares of its length, from 0 to 1."""
    ways_m, parts = ways_along(points), []
    for low, high in pairwise(shares):
        ends_m = low * ways_m[-1], high * ways_m[-1]
        inner = [
            point
            for point, way_m in zip(points, ways_m, strict=True)
            if ends_m[0] + ROUNDING_M < way_m < ends_m[1] - ROUNDING_M
        ]
        x_m, y_m = (np.interp(ends_m, ways_m, each).tolist() for each in zip(*points, strict=True))
        parts.append(((x_m[0], y_m[0]), *inner, (x_m[1], y_m[1])))
    return parts


ROUNDING_M = 0.001
"""Difference of lengths that is ignored, so that a line of the wanted length is left as it is."""


def straight_on(shape: Sequence[Point], length_m: float) -> tuple[Point, Point]:
    """Return begin and end of a straight line of ``length_m`` metres that continues a shape."""
    last = shape[-1]
    before = next((point for point in reversed(shape) if point != last), (last[0] - 1.0, last[1]))
    scale = length_m / math.dist(before, last)
    further = tuple(end + scale * (end - begin) for begin, end in zip(before, last, strict=True))
    return last, (further[0], further[1])


def along(points: Iterable[Point], length_m: float) -> tuple[Point, ...]:
    """Return a line of ``length_m`` metres along the points; it goes straight on after the last."""
    line = [point for point, _ in groupby(points)]
    left_m = length_m - ways_along(line)[-1]
    if abs(left_m) < ROUNDING_M:
        return tuple(line)
    if left_m > 0.0:
        line.append(straight_on(line, left_m)[1])
    return cut_line(line, (0.0, length_m / ways_along(line)[-1]))[0]
