"""Finds a route in a network of the user, and follows its lanes from edge to edge."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.config.section import did_you_mean
from drl_av.errors import ScenarioError
from drl_av.scenarios.imported.curves import Line
from drl_av.scenarios.imported.net_file import (
    BROKEN,
    REMEDY,
    TRUE,
    Attributes,
    Found,
    NetFile,
    left_out,
    other_class_limits,
    read_net,
)
from drl_av.scenarios.imported.passage import (
    CARS,
    OTHERS,
    Step,
    car_lanes,
    lane_limit_m_s,
    open_range,
    step_between,
)
from drl_av.scenarios.layout import Point, ways_along
from drl_av.scenarios.netconvert import PRECISION

SHORTEST_M = 0.1
"""Smallest length of an edge in SUMO."""
MOST_EDGES = 1000
"""Largest number of edges of a route."""
FORBIDDEN = "authority"
"""SUMO's classes of vehicles that may cross a forbidden line of the road that is written."""
FARTHEST_M = 1e7
"""Largest coordinate of a network in metres."""


class Part(NamedTuple):
    """A part of a section: the edge itself, or the way through the junction after it."""

    end_m: float
    """Its end, metres along the route."""
    limits_m_s: tuple[float, ...]
    """The speed limit of each of the section's lanes."""
    attributes: Mapping[int, Mapping[str, str]]
    """Further SUMO attributes of lanes, by the index of the lane on the road."""


class Section(NamedTuple):
    """An edge of a route, with the way through the junction after it."""

    edge: str
    """The edge's id."""
    begin_m: float
    end_m: float
    """Its beginning, and the end of the way through the junction, in metres along the route."""
    junction_m: float
    """The position where that way begins: the end of the edge itself."""
    parts: tuple[Part, ...]
    """One part, or two if the lanes inside the junction differ from those of the edge."""
    lanes: range
    """Indices of its lanes on the road, rightmost first."""
    leading_on: range
    """Indices of those ``lanes`` that continue on the next edge of the route."""
    leading_away: frozenset[int]
    """Indices of those ``lanes`` that lead cars to another edge than the next one of the route."""
    joining: frozenset[str]
    leaving: frozenset[str]
    """The ids of the other edges that lead to the next edge of the route, and from this one."""
    shape: tuple[Point, ...]
    spread: str
    """SUMO's spreadType: how the lanes lie about the shape."""


class Route(NamedTuple):
    """A route through a network, whose lanes continue side by side from edge to edge."""

    sections: tuple[Section, ...]
    lane_width_m: float
    line: Line
    """The middle of a lane along it."""
    left_out: tuple[str, ...]
    """What the network says about the route and is not part of it, one phrase each."""


def read_route(path: Path, from_edge: str, to_edge: str, remedy: str = REMEDY) -> Route:
    """Return the fastest route for cars from one edge to another in a network file.

    The way through a junction counts as part of the edge before it. Where the number of lanes
    changes, SUMO's connections determine which lanes continue; all others begin or end there. If a
    lane leads to two lanes of the next edge, drl-av makes the choice with which the largest number
    of lanes continues. A lane that is closed to cars is no lane. A network whose traffic drives on
    the left is mirrored. ``remedy`` is the advice if the file is missing or damaged.

    Raises:
        ScenarioError: the file is no network of SUMO, there is no such route, or the route is no
            highway that drl-av can drive; each message names the file and what to do.
    """
    file = read_net(path, remedy)
    try:
        edges = _way(file.net, from_edge, to_edge)
        opened = [open_range(edge) for edge in edges]
        width_m = _lane_width(edges)
        steps = [step_between(file, edge, following) for edge, following in pairwise(edges)]
        last = Step(range(0), 0, {}, {}, frozenset(), frozenset(), frozenset(), ())
        sections = _sections(file, edges, opened, [*steps, last])
        line = _line(file, edges, [*steps, last], sections)
        return Route(tuple(sections), width_m, line, tuple(_left_out(file, edges, steps)))
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from error
    except BROKEN as error:
        raise ScenarioError(f"{path} lacks or misstates {error}: {remedy}.") from error


def _way(net: Any, from_edge: str, to_edge: str) -> Sequence[Any]:
    """Return the edges of the fastest route for cars; raise ScenarioError if there is none."""
    names = [edge.getID() for edge in net.getEdges(withInternal=False)]
    for name in (from_edge, to_edge):
        if name not in names:
            raise ScenarioError(
                f"there is no edge {name!r}{did_you_mean(name, names)}: name an edge of the "
                "network, as netedit shows them."
            )
    ends = net.getEdge(from_edge), net.getEdge(to_edge)
    edges: Sequence[Any] | None = net.getFastestPath(*ends, vClass=CARS)[0]
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


def _lane_width(edges: Sequence[Any]) -> float:
    """Return the width of all lanes of a route; raise ScenarioError if they are not equal."""
    lanes = [lane for edge in edges for lane in car_lanes(edge)]
    width_m = float(lanes[0].getWidth())
    for lane in lanes:
        if lane.getWidth() != width_m:
            raise ScenarioError(
                f"lane {lanes[0].getID()!r} is {width_m:g} m wide and lane {lane.getID()!r} "
                f"{lane.getWidth():g} m, but all lanes of the route must have one width: change it "
                "in netedit."
            )
    return width_m


def _sections(
    file: NetFile, edges: Sequence[Any], opened: Sequence[range], steps: Sequence[Step]
) -> list[Section]:
    """Return the sections of a route; the lowest lane index on the road is 0."""
    rightmost = [0]
    for step in steps[:-1]:
        rightmost.append(rightmost[-1] - step.shift)
    lowest = min(right + lanes[0] for right, lanes in zip(rightmost, opened, strict=True))
    begin_m = 0.0
    sections: list[Section] = []
    for edge, right, lanes, step in zip(edges, rightmost, opened, steps, strict=True):
        first = right - lowest
        length_m = max(edge.getLength() + step.length_m, SHORTEST_M)
        end_m = round(begin_m + length_m, PRECISION)
        inside_m = round(end_m - step.length_m, PRECISION)
        parts = _parts(file, edge, lanes, step, (inside_m, end_m), first)
        on = step.leading_on if step.inside else lanes
        sections.append(
            Section(
                edge.getID(),
                begin_m,
                end_m,
                inside_m,
                tuple(parts),
                shifted(lanes, first),
                shifted(on, first),
                frozenset(first + lane for lane in step.leading_away),
                step.joining,
                step.leaving,
                _shape(file, edge),
                file.edges[edge.getID()].get("spreadType", "right"),
            )
        )
        begin_m = end_m
    return sections


def shifted(lanes: range, by: int) -> range:
    """Return the indices of lanes that lie ``by`` lanes further to the left."""
    return range(lanes.start + by, lanes.stop + by)


def _shape(file: NetFile, edge: Any) -> tuple[Point, ...]:
    """Return the line along which an edge is drawn; its mirror image if traffic drives left."""
    mirror = -1.0 if file.drives_left else 1.0
    shape = tuple((float(x), mirror * float(y)) for x, y in edge.getRawShape())
    if not all(abs(at_m) < FARTHEST_M for point in shape for at_m in point):
        raise ScenarioError(
            f"the shape of edge {edge.getID()!r} has a coordinate beyond {FARTHEST_M / 1e3:g} "
            "km: write the network again with netconvert."
        )
    return shape


def _parts(
    file: NetFile, edge: Any, lanes: range, step: Step, ends_m: tuple[float, float], first: int
) -> list[Part]:
    """Return the parts of a section: the edge up to the first end, and the junction after it.

    The junction is a part of its own if lines are forbidden there, or if its lanes are slower than
    the lanes before and behind it. A speed between the two is where SUMO lets vehicles brake.
    """
    own = {lane: file.lanes[f"{edge.getID()}_{lane}"] for lane in lanes}
    limits = [lane_limit_m_s(file, edge, lane) for lane in lanes]
    attributes = {
        first + lane: found for lane in lanes if (found := _rules(file, own[lane], [own[lane]]))
    }
    edge_part = Part(ends_m[1], tuple(limits), attributes)
    if ends_m[1] - ends_m[0] < SHORTEST_M or ends_m[0] < SHORTEST_M or not step.inside:
        return [edge_part]
    inside_limits = [
        min((float(one["speed"]) for one in step.inside.get(lane, ())), default=limit)
        for lane, limit in zip(lanes, limits, strict=True)
    ]
    inside = {
        first + lane: found
        for lane in lanes
        if (found := _rules(file, own[lane], step.inside.get(lane, ())))
    }
    slower = any(
        inside_limit < min(limit, step.further_m_s.get(lane, limit))
        for lane, limit, inside_limit in zip(lanes, limits, inside_limits, strict=True)
    )
    inside_part = Part(ends_m[1], tuple(inside_limits if slower else limits), inside)
    if inside_part == edge_part:
        return [edge_part]
    return [edge_part._replace(end_m=ends_m[0]), inside_part]


def _rules(file: NetFile, own: Attributes, lanes: Sequence[Attributes]) -> dict[str, str]:
    """Return the SUMO attributes that the road that is written gets from lanes one after another.

    ``own`` is the lane of the edge, which says whether it is an acceleration lane. SUMO's left and
    right are the driver's, so in a mirrored network each line is on the other side.
    """
    found = {"acceleration": "1"} if own.get("acceleration", "").lower() in TRUE else {}
    sides = ("changeLeft", "changeRight")
    for key, ours in zip(sides, sides[::-1] if file.drives_left else sides, strict=True):
        if any(key in lane and not _permits(lane[key]) for lane in lanes):
            found[ours] = FORBIDDEN
    return found


def _permits(classes: str) -> bool:
    """Whether SUMO's list of classes that may change lanes contains cars."""
    return not {"all", CARS}.isdisjoint(classes.split())


def _line(
    file: NetFile, edges: Sequence[Any], steps: Sequence[Step], sections: Sequence[Section]
) -> Line:
    """Return the middle of a lane along the whole route and through its junctions.

    Where that lane ends, the line goes on along the next lane that leads on, moved sideways to it.
    """
    line: list[tuple[float, Point]] = []
    lane, aside = math.inf, (0.0, 0.0)
    for edge, step, section in zip(edges, steps, sections, strict=True):
        leading_on = step.leading_on or open_range(edge)
        own = int(min(max(lane, leading_on[0]), leading_on[-1]))
        inside = step.inside.get(own, ())
        places = [*_places([file.lanes[f"{edge.getID()}_{own}"], *inside], section.begin_m)]
        if line and own != lane:
            (_, end), (_, begin) = line[-1], places[0]
            aside = end[0] - begin[0], end[1] - begin[1]
        line += [(at_m, (x + aside[0], y + aside[1])) for at_m, (x, y) in places]
        lane = own + step.shift
    return line


def _places(lanes: Iterable[Attributes], begin_m: float) -> Iterator[tuple[float, Point]]:
    """Yield the points of lanes one after another, with their positions from ``begin_m`` on."""
    for lane in lanes:
        length_m = float(lane["length"])
        points = [_point(text) for text in lane["shape"].split()]
        ways_m = ways_along(points)
        for way_m, point in zip(ways_m, points, strict=True):
            yield begin_m + way_m / (ways_m[-1] or 1.0) * length_m, point
        begin_m += length_m


def _point(text: str) -> Point:
    x, y = map(float, text.split(",")[:2])
    if not abs(x) + abs(y) < FARTHEST_M:
        raise ScenarioError(
            f"a lane has the point {text[:40]!r}, but coordinates must be below "
            f"{FARTHEST_M / 1e3:g} km: write the network again with netconvert."
        )
    return x, y


def _left_out(file: NetFile, edges: Sequence[Any], steps: Sequence[Step]) -> Iterator[str]:
    """Yield a phrase for everything that the network says about the route and that is left out."""
    if file.drives_left:
        yield "that its traffic drives on the left: the road is its mirror image"
    if file.net.hasGeoProj():
        yield "its projection: SUMO's outputs have no longitudes and latitudes"
    if any(height_m for edge in edges for *_, height_m in edge.getShape3D()):
        yield "its heights: the road is level"
    names = [edge.getID() for edge in edges]
    places: dict[str, list[str]] = {}
    inside = {lane["id"] for step in steps for way in step.inside.values() for lane in way}
    for what, place in _attributes_left_out(file, edges, inside):
        places.setdefault(what, []).append(place)
    for what, (place, *others) in places.items():
        yield f"{what} {place}" + (f" and {len(others)} more" if others else "")
    yield from other_class_limits(file, names, CARS)
    for step in steps:
        yield from step.left_out


def _attributes_left_out(
    file: NetFile, edges: Sequence[Any], inside: Collection[str]
) -> Iterator[tuple[str, str]]:
    """Yield each attribute of a route that is left out, and the element that has it.

    ``inside`` has the ids of its lanes inside junctions.
    """
    for edge in edges:
        name = edge.getID()
        yield from left_out(Found("edge", f"edge {name!r}", file.edges[name]))
        for lane in edge.getLanes():
            found = Found("lane", f"lane {lane.getID()!r}", file.lanes[lane.getID()])
            if not lane.allows(CARS):
                yield "lanes closed to cars,", found.name
                continue
            yield from left_out(found)
            if closed_to := [name for name in OTHERS if not lane.allows(name)]:
                yield f"that {', '.join(closed_to)} may not use", found.name
    for name in sorted({lane.rpartition("_")[0] for lane in inside}):
        yield from left_out(Found("edge", f"edge {name!r}", file.edges[name]))
    for name in sorted(inside):
        yield from left_out(Found("lane", f"lane {name!r}", file.lanes[name]))
    ends = {*pairwise(edge.getID() for edge in edges)}
    for (from_edge, lane, to_edge, to_lane), attributes in file.connections.items():
        if (from_edge, to_edge) in ends or f"{from_edge}_{lane}" in inside:
            name = f"the way from lane '{from_edge}_{lane}' to '{to_edge}_{to_lane}'"
            yield from left_out(Found("connection", name, attributes))
