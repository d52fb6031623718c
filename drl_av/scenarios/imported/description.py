"""The kind of scenario ``imported``: a route through a SUMO network of the user's own."""

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, groupby
from pathlib import Path
from typing import Any, Self

from drl_av.config import TrafficConfig
from drl_av.config.section import check_fields, setting
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ScenarioError, pluralize
from drl_av.road.road import OPEN_LAP_M, ForbiddenLine, Road, SpeedLimit
from drl_av.scenarios.highways import AFTER_M, OFF_RAMP_ASIDE_M, require_usual_ego_reaches_exit
from drl_av.scenarios.imported.carriageway import Carriageway, carriageway, lane_curves
from drl_av.scenarios.imported.net_file import REMEDY
from drl_av.scenarios.imported.route import Route, Section, read_route
from drl_av.scenarios.layout import (
    RUN_OUT_M,
    Edge,
    Layout,
    OpenPlan,
    OpenStart,
    along,
    cut_edge,
    pieces_of,
    straight_on,
)
from drl_av.scenarios.netconvert import NETWORK_FILE, PRECISION, WRITE_AGAIN
from drl_av.scenarios.open_road import BEYOND_M, START_M, OpenDescription
from drl_av.scenarios.road_description import LANE_WIDTH_M, LANES, SPEED_LIMIT_M_S, toml_text

IN_THE_NETWORK = 1.0, 10_000.0
"""The least lowest limit and the largest sideways acceleration, which change no limit: those of a
network that drl-av has written."""
SHORTEST_PIECE_M = 0.5
"""Length of the shortest piece of an edge between two changes of the speed limit."""
SHORTEST_M, LONGEST_M = 600.0, 50_000.0
"""Lengths of the shortest and the longest route; on the shortest the ego drives 300 m."""


@dataclass(frozen=True)
class ImportedDescription(OpenDescription):
    """A route through a user's network, which defines its lanes, their width and speed limits.

    The route may leave the motorway by an exit lane that begins along the route; the other vehicles
    then stay on the motorway.

    net: network file with the route, which netedit or netconvert has written (yours)
    from_edge: id of the first edge of the route through net (yours)
    to_edge: id of the last edge of the route through net (yours)
    lowest_limit_m_s: lower speed limits of the network are raised to this, m/s (ours)
    sideways_m_s2: sideways acceleration that limits the speed in curves, m/s^2; netconvert's for
        junctions (ours)

    Raises:
        ScenarioError: the route cannot be read (``route.read_route``), is too short or too
            long, or has no lane along its whole length or to its exit
            (``carriageway.carriageway``); the ego cannot reach the exit in time; or the speed limit
            is too low for the inflow.
    """

    lanes: int = field(init=False)
    lane_width_m: float = field(init=False)
    speed_limit_m_s: float = field(init=False)
    """The lowest speed limit of the route."""
    meaning = "a route through a SUMO network of your own, such as one from OpenStreetMap"
    net: str = ""
    from_edge: str = ""
    to_edge: str = ""
    lowest_limit_m_s: float = setting(1.0, low=IN_THE_NETWORK[0], high=100)
    sideways_m_s2: float = setting(5.5, low=0.5, high=IN_THE_NETWORK[1])
    left_out: tuple[str, ...] | None = None
    """What the network says about the route and the scenario leaves out, one phrase each; None
    finds it in the network."""
    leaves_out: tuple[str, ...] = field(init=False, repr=False, compare=False)
    """``left_out``, or what was found in the network."""
    route: Route = field(init=False, repr=False, compare=False)
    way: Carriageway = field(init=False, repr=False, compare=False)
    """The carriageway of the route, up to the exit if it has one, and the off-ramp there."""
    lane_curves: Mapping[tuple[str, int], tuple[SpeedLimit, ...]] = field(
        init=False, repr=False, compare=False
    )
    """The parts that are too sharp for the speed limits, by the edge's id and the lane's index."""

    def __post_init__(self) -> None:
        check_fields(self, "The scenario's ", ScenarioError)
        for name in ("net", "from_edge", "to_edge"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value:
                raise ScenarioError(
                    f"The scenario's {name} is {value!r}, but a scenario of the kind imported "
                    "needs net, the path of a SUMO network file, and from_edge and to_edge, two "
                    "of its edges."
                )
        net, is_written = Path(self.net), self.left_out is not None
        phrases = self.left_out if isinstance(self.left_out, list | tuple) else [None]
        if is_written and not all(isinstance(phrase, str) for phrase in phrases):
            raise ScenarioError(
                f"The scenario's left_out is {self.left_out!r}, but must be a list of texts."
            )
        if is_written and (self.lowest_limit_m_s, self.sideways_m_s2) != IN_THE_NETWORK:
            raise ScenarioError(
                f"{self.net} has its limits from the time when it was imported: keep "
                "lowest_limit_m_s = 1.0 and sideways_m_s2 = 10000.0, or import the network anew."
            )
        remedy = WRITE_AGAIN if is_written and net.name == NETWORK_FILE else REMEDY
        route = read_route(net, self.from_edge, self.to_edge, remedy)
        try:
            way = carriageway(route)
        except ScenarioError as error:
            raise ScenarioError(f"{self.net}: the route {error}") from error
        derived = {
            "route": route,
            "way": way,
            "lanes": 1 + max(section.lanes[-1] for section in way.sections),
            "lane_width_m": route.lane_width_m,
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)
        fastest_m_s = max(map(self._raised, _limits(way.driven)))
        curves = lane_curves(way, route.line, self.sideways_m_s2, fastest_m_s)
        object.__setattr__(self, "lane_curves", curves)
        last = way.off_ramp[0].edge if way.off_ramp else self._edges(way.sections[-1])[-1].id
        object.__setattr__(self, "to_edge", last)
        leaves_out = self._left_out() if self.left_out is None else map(str, self.left_out)
        object.__setattr__(self, "leaves_out", tuple(leaves_out))
        slowest = min(min(edge.lane_limits_m_s) for edge in self.plan().edges)
        object.__setattr__(self, "speed_limit_m_s", slowest)
        self._check_route()
        super().__post_init__()
        self._check_flow()
        fastest_m_s = max(one.limit_m_s for one in self.plan().start.speed_limits)
        require_usual_ego_reaches_exit(self.plan(), fastest_m_s)

    def plan(self) -> OpenPlan:
        """Return the road: the route, a straight edge beyond its end or exit, and any off-ramp."""
        way = self.way
        edges = tuple(chain.from_iterable(map(self._edges, way.sections)))
        if way.off_ramp:
            through, off_ramp = self._straight_on(edges[-1], "through", AFTER_M), self._off_ramp()
            ends = {"through": through, "exit": off_ramp}
        else:
            ends = {"way": self._straight_on(edges[-1], "beyond", RUN_OUT_M)}
        every = (*edges, *ends.values())
        return OpenPlan(
            edges=every,
            routes={name: tuple(edge.id for edge in (*edges, end)) for name, end in ends.items()},
            road=Road(
                OPEN_LAP_M,
                self.lane_width_m,
                (True,) * self.lanes,
                way.end_m,
                way.partial_lanes,
                way.exit_m,
                exit_lane=max(way.exit_lanes, default=0),
                speed_limits=tuple(_stretches(every, [lane]) for lane in range(self.lanes)),
                forbidden_lines=tuple(_forbidden_lines(edges)),
            ),
            start=OpenStart(
                way.through,
                way.end_m + BEYOND_M,
                self.flow_per_h,
                None,
                START_M,
                speed_limits=_stretches(edges, way.through),
            ),
        )

    def read_layout(self, network: ET.Element, name: str) -> Layout:
        """Return the layout of a network file, as ``RoadDescription.read_layout``.

        Raises:
            ScenarioError: the description names another network file, or the road differs from it.
        """
        if Path(self.net) != Path(name):
            raise ScenarioError(
                f"The net of the scenario is {self.net}, but must be {NETWORK_FILE!r}: "
                f"{WRITE_AGAIN}."
            )
        return super().read_layout(network, name)

    def updated(self, **given: Any) -> Self:
        """Return the description with other settings; another network has limits of its own."""
        if "net" in given and self.left_out is not None:
            names = "left_out", "lowest_limit_m_s", "sideways_m_s2"
            given = {name: getattr(ImportedDescription, name) for name in names} | given
        return replace(self, **given)

    def to_toml(self) -> str:
        """Return the description as TOML text, which describes the network file of its folder.

        The limits in that file are raised already, and its curves have their limits.
        """
        limits = dict(zip(("lowest_limit_m_s", "sideways_m_s2"), IN_THE_NETWORK, strict=True))
        return toml_text(self, net=NETWORK_FILE, left_out=self.leaves_out, **limits)

    @property
    def summary(self) -> str:
        """What was made of the network: length, lanes, limits, exit, and what is left out."""
        way, road = self.way, self.plan().road
        counts = sorted({len(section.lanes) for section in way.sections})
        limits = sorted({limit for lane in road.speed_limits for *_, limit in lane})
        lanes = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else f"{counts[0]}"
        speeds = f"{limits[0]:.4g} to {limits[-1]:.4g}" if len(limits) > 1 else f"{limits[0]:.4g}"
        ends = [part for part in way.partial_lanes if part.end_m < math.inf]
        begin = [part for part in way.partial_lanes if part.begin_m > 0.0]
        facts = [
            f"{way.sections[-1].end_m:.0f} m from edge {self.from_edge!r} on, {lanes} lanes of "
            f"{self.lane_width_m:g} m, limits {speeds} m/s",
            f"an exit on the right at {way.exit_m:.0f} m" if way.off_ramp else "no exit",
            f"lanes that begin: {len(begin)}, and that end: {len(ends)}",
        ]
        if road.forbidden_lines:
            facts.append(f"{pluralize(len(road.forbidden_lines), 'forbidden line')}")
        if self.curves:
            sharpest = min(self.curves, key=lambda curve: curve.limit_m_s)
            facts.append(
                f"{pluralize(len(self.curves), 'limit')} in curves, the lowest "
                f"{sharpest.limit_m_s:.1f} m/s at {sharpest.begin_m:.0f} m"
            )
        return (
            f"The road: {'; '.join(facts)}.\nLeft out: {'; '.join(self.leaves_out or ['nothing'])}."
        )

    @property
    def curves(self) -> tuple[SpeedLimit, ...]:
        """The curves of all lanes, in driving order."""
        return tuple(sorted(set(chain.from_iterable(self.lane_curves.values()))))

    def _raised(self, limit_m_s: float) -> float:
        return max(limit_m_s, self.lowest_limit_m_s)

    def _edges(self, section: Section) -> list[Edge]:
        """Return the edges of a section, each with the limits of its lanes all along it."""
        whole = Edge(
            section.edge,
            section.begin_m,
            section.end_m,
            section.lanes,
            shape=section.shape,
            spread=section.spread,
        )
        inner = [
            end_m
            for curve in self.curves
            for end_m in (curve.begin_m, curve.end_m)
            if section.begin_m + SHORTEST_PIECE_M < end_m < section.end_m - SHORTEST_PIECE_M
        ]
        joints = [part.end_m for part in section.parts[:-1]]
        inner = [cut for cut in inner if all(abs(cut - at) > SHORTEST_PIECE_M for at in joints)]
        cuts_m = sorted({round(cut_m, PRECISION) for cut_m in (*inner, *joints)})
        edges = (self._limited(edge, section) for edge in cut_edge(whole, cuts_m, "part"))
        return [*chain.from_iterable(map(pieces_of, _joined(edges)))]

    def _limited(self, edge: Edge, section: Section) -> Edge:
        """Return a part of a section's edge with the limits and the lines of its lanes."""
        middle_m = (edge.begin_m + edge.end_m) / 2
        part = next(part for part in section.parts if middle_m < part.end_m)
        limits = (
            round(min([self._raised(limit_m_s), *self._curves_on(edge, section, lane)]), PRECISION)
            for lane, limit_m_s in zip(section.lanes, part.limits_m_s, strict=True)
        )
        return edge._replace(lane_limits_m_s=tuple(limits), lane_attributes=part.attributes)

    def _curves_on(self, edge: Edge, section: Section, lane: int) -> Iterator[float]:
        """Yield the speed of each curve of a lane on a part of a section's edge, m/s."""
        for curve in self.lane_curves[section.edge, lane]:
            if (
                curve.begin_m < edge.end_m - SHORTEST_PIECE_M
                and edge.begin_m + SHORTEST_PIECE_M < curve.end_m
            ):
                yield curve.limit_m_s

    def _straight_on(self, last: Edge, name: str, length_m: float) -> Edge:
        """Return a straight edge of that length, on which all lanes without an exit go on."""
        way, gone = self.way, len(self.way.exit_lanes)
        drawn_m = max(length_m, way.end_m + RUN_OUT_M - last.end_m)
        return last._replace(
            id=f"{last.id}.{name}",
            begin_m=last.end_m,
            end_m=last.end_m + length_m,
            lanes=last.lanes[gone:],
            lane_limits_m_s=last.lane_limits_m_s[gone:],
            lane_attributes={},
            shape=straight_on(last.shape, drawn_m),
        )

    def _off_ramp(self) -> Edge:
        """Return the edge after the exit, drawn along the edges of the route after it."""
        way = self.way
        points = chain.from_iterable(section.shape for section in way.off_ramp)
        first, lanes = way.off_ramp[0], way.exit_lanes
        ramp = chain.from_iterable(map(self._edges, way.driven[len(way.sections) :]))
        near = [edge for edge in ramp if edge.begin_m < way.end_m]
        limit_m_s = min(min(edge.lane_limits_m_s) for edge in near)
        return Edge(
            first.edge,
            way.exit_m,
            way.end_m,
            lanes,
            drawn_aside_m=(0.0, OFF_RAMP_ASIDE_M),
            lane_limits_m_s=(limit_m_s,) * len(lanes),
            shape=along(points, AFTER_M + RUN_OUT_M),
            spread=first.spread,
        )

    def _left_out(self) -> Iterator[str]:
        """Yield a phrase for everything that the scenario leaves out."""
        if self.way.other_roads:
            yield self.way.other_roads
        if self.way.left_out_m >= 1.0:
            yield f"{self.way.left_out_m:.0f} m of the route behind the exit"
        yield from self.route.left_out

    def _check_route(self) -> None:
        """Raise ScenarioError unless the ego can drive on the route."""
        way = self.way
        where, length_m = f"{self.net}: the route", way.end_m
        if not SHORTEST_M <= length_m <= LONGEST_M:
            raise ScenarioError(
                f"{where} is {length_m:.0f} m long, but must be {SHORTEST_M:g} to {LONGEST_M:g} m: "
                "name other edges."
            )
        for name, value, bounds in (
            ("lanes", self.lanes, LANES),
            ("lane_width_m", self.lane_width_m, LANE_WIDTH_M),
            ("speed_limit_m_s", max(map(self._raised, _limits(way.driven))), SPEED_LIMIT_M_S),
        ):
            low, high = (bounds.keywords[key] for key in ("low", "high"))
            if not low <= value <= high:
                raise ScenarioError(
                    f"{where} has {name} {value:g}, but must have {low:g} to {high:g}: change it "
                    "in netedit, or choose another route."
                )
        for name, number in Counter(edge.id for edge in self.plan().edges).items():
            if number > 1:
                raise ScenarioError(
                    f"{where} has an edge {name!r}, but drl-av gives this name to another part of "
                    "the road: rename the edge in netedit."
                )

    def _check_flow(self) -> None:
        """Raise ScenarioError if the inflow exceeds v / (length + gap + headway v) (ours)."""
        usual, limits = TrafficConfig(), self.plan().start.speed_limits
        speed_m_s = min(usual.desired_speed_min_m_s, *(one.limit_m_s for one in limits))
        headway_s = (usual.headway_min_s + usual.headway_max_s) / 2
        pitch_m = self.longest_m + STANDSTILL_GAP_M + headway_s * speed_m_s
        most_per_h = math.floor(3600 * speed_m_s / pitch_m)
        if self.flow_per_h > most_per_h:
            raise ScenarioError(
                f"The scenario's flow_per_h is {self.flow_per_h:g}, but at {speed_m_s:g} m/s a "
                f"lane takes at most {most_per_h}: lower it."
            )


def _limits(sections: Iterable[Section]) -> Iterator[float]:
    """Yield the speed limit of each lane of each part of some sections, m/s."""
    for section in sections:
        for part in section.parts:
            yield from part.limits_m_s


def _joined(edges: Iterable[Edge]) -> Iterator[Edge]:
    """Yield edges one after another, with equal neighbours joined to one edge."""
    for _, alike in groupby(edges, lambda edge: (edge.lane_limits_m_s, edge.lane_attributes)):
        first, *others = alike
        shape = chain(first.shape, *(edge.shape[1:] for edge in others))
        yield first._replace(end_m=[first, *others][-1].end_m, shape=tuple(shape))


def _stretches(edges: Iterable[Edge], lanes: Collection[int]) -> tuple[SpeedLimit, ...]:
    """Return the lowest limit of some lanes along edges; the last edge goes on for ever."""
    found: list[SpeedLimit] = []
    for edge in edges:
        pairs = zip(edge.lanes, edge.lane_limits_m_s, strict=True)
        limits = [limit_m_s for lane, limit_m_s in pairs if lane in lanes]
        if not limits:
            continue
        if found and found[-1][1:] == (edge.begin_m, min(limits)):
            found[-1] = found[-1]._replace(end_m=edge.end_m)
        else:
            found.append(SpeedLimit(edge.begin_m, edge.end_m, min(limits)))
    return (*found[:-1], found[-1]._replace(end_m=OPEN_LAP_M))


def _forbidden_lines(edges: Iterable[Edge]) -> list[ForbiddenLine]:
    """Return the lines that may not be crossed, each over all edges that it follows."""
    found: dict[tuple[int, int, float], ForbiddenLine] = {}
    for edge in edges:
        for lane, attributes in edge.lane_attributes.items():
            for key, side in (("changeLeft", 1), ("changeRight", -1)):
                if key in attributes and lane + side in edge.lanes:
                    before = found.pop((lane, side, edge.begin_m), edge)
                    line = ForbiddenLine(lane, side, before.begin_m, edge.end_m)
                    found[lane, side, edge.end_m] = line
    return [*found.values()]
