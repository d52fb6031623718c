"""The kind of scenario ``imported``: a route through a SUMO network of the user's own."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from drl_av.config import TrafficConfig
from drl_av.config.schema import setting
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ScenarioError
from drl_av.traffic import open_road
from drl_av.traffic.description import (
    LANE_WIDTH_M,
    LANES,
    SPEED_LIMIT_M_S,
    check_numbers,
    toml_text,
)
from drl_av.traffic.kind import Edge, Layout, OpenPlan, OpenStart, Point, ScenarioKind
from drl_av.traffic.net_route import Route, Section, read_route
from drl_av.traffic.network import NETWORK_FILE
from drl_av.traffic.open_demo import traffic
from drl_av.traffic.open_road import BEYOND_M, RUN_OUT_M, START_M, OpenDescription
from drl_av.traffic.road import OPEN_LAP_M, PartialLane, Road

SHORTEST_M, LONGEST_M = 600.0, 50_000.0
"""Lengths of the shortest and the longest route; on the shortest the ego drives 300 m."""


@dataclass(frozen=True)
class ImportedDescription(OpenDescription):
    """A route through a user's network, which defines its lanes, their width and speed limits.

    Raises:
        ScenarioError: the route cannot be read (``net_route.read_route``), is too short or too
            long, or has no lane along its whole length; or its speed limit is too low for the
            inflow.
    """

    lanes: int = field(init=False)
    lane_width_m: float = field(init=False)
    speed_limit_m_s: float = field(init=False)
    """The lowest speed limit of the route."""
    net: str = setting(
        "", "yours", "network file with the route, which netedit or netconvert has written"
    )
    from_edge: str = setting("", "yours", "id of the first edge of the route through net")
    to_edge: str = setting("", "yours", "id of the last edge of the route through net")
    lowest_limit_m_s: float = setting(
        1.0, "ours", "lower speed limits of the network are raised to this, m/s", low=1, high=100
    )
    route: Route = field(init=False, repr=False, compare=False)
    limits_vary: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_numbers(self, "The scenario's ")
        for name in ("net", "from_edge", "to_edge"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value:
                raise ScenarioError(
                    f"The scenario's {name} is {value!r}, but a scenario of the kind imported "
                    "needs net, the path of a SUMO network file, and from_edge and to_edge, two "
                    "of its edges."
                )
        route = read_route(Path(self.net), self.from_edge, self.to_edge)
        derived = {
            "route": route,
            "lanes": 1 + max(section.lanes[-1] for section in route.sections),
            "lane_width_m": route.lane_width_m,
            "speed_limit_m_s": min(map(self._speed_limit, route.sections)),
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)
        self._check_route()
        super().__post_init__()
        self._check_flow()

    def plan(self) -> OpenPlan:
        """Return the road: the edges of the route, and a straight edge beyond its end."""
        edges = [*map(self._edge, self.route.sections)]
        end_m = edges[-1].end_m
        parts, through = partial_lanes(self.route.sections), self._through()
        beyond = Edge(
            f"{edges[-1].id}.beyond",
            end_m,
            end_m + RUN_OUT_M,
            edges[-1].lanes,
            speed_limit_m_s=edges[-1].speed_limit_m_s,
            shape=_onward(edges[-1].shape),
            spread=edges[-1].spread,
        )
        lanes = (True,) * self.lanes
        return OpenPlan(
            edges=(*edges, beyond),
            routes={"way": tuple(edge.id for edge in (*edges, beyond))},
            road=Road(OPEN_LAP_M, self.lane_width_m, lanes, end_m, parts),
            start=OpenStart(
                through,
                end_m + BEYOND_M,
                self.flow_per_h,
                None,
                START_M,
                speed_limits=tuple(
                    (section.end_m, self._speed_limit(section)) for section in self.route.sections
                ),
            ),
        )

    def to_toml(self) -> str:
        """Return the description as TOML text; ``net`` is the file in the scenario's folder."""
        return toml_text(self, net=NETWORK_FILE)

    def _speed_limit(self, section: Section) -> float:
        return max(section.speed_limit_m_s, self.lowest_limit_m_s)

    def _edge(self, section: Section) -> Edge:
        return Edge(
            section.edge,
            section.begin_m,
            section.end_m,
            section.lanes,
            speed_limit_m_s=self._speed_limit(section),
            shape=section.shape,
            spread=section.spread,
        )

    def _through(self) -> tuple[int, ...]:
        """Return the lanes that lead along the whole route."""
        partial = {part.lane for part in partial_lanes(self.route.sections)}
        return tuple(lane for lane in range(self.lanes) if lane not in partial)

    def _check_route(self) -> None:
        """Raise ScenarioError unless the ego can drive on the route."""
        where, length_m = f"{self.net}: the route", self.route.length_m
        if not SHORTEST_M <= length_m <= LONGEST_M:
            raise ScenarioError(
                f"{where} is {length_m:.0f} m long, but must be {SHORTEST_M:g} to {LONGEST_M:g} m: "
                "name other edges."
            )
        if not self._through():
            raise ScenarioError(
                f"{where} has no lane that leads along all of it: name edges between which one "
                "does."
            )
        for name, value, bounds in (
            ("lanes", self.lanes, LANES),
            ("lane_width_m", self.lane_width_m, LANE_WIDTH_M),
            ("speed_limit_m_s", max(map(self._speed_limit, self.route.sections)), SPEED_LIMIT_M_S),
        ):
            low, high = (bounds.keywords[key] for key in ("low", "high"))
            if not low <= value <= high:
                raise ScenarioError(
                    f"{where} has {name} {value:g}, but must have {low:g} to {high:g}: change it "
                    "in netedit, or choose another route."
                )

    def _check_flow(self) -> None:
        """Raise ScenarioError if the inflow exceeds v / (length + gap + headway v) (ours)."""
        usual = TrafficConfig()
        speed_m_s = min(usual.desired_speed_min_m_s, self.speed_limit_m_s)
        headway_s = (usual.headway_min_s + usual.headway_max_s) / 2
        pitch_m = self.vehicle_length_m + STANDSTILL_GAP_M + headway_s * speed_m_s
        most_per_h = math.floor(3600 * speed_m_s / pitch_m)
        if self.flow_per_h > most_per_h:
            raise ScenarioError(
                f"The scenario's flow_per_h is {self.flow_per_h:g}, but at {speed_m_s:g} m/s a "
                f"lane takes at most {most_per_h}: lower it."
            )


def partial_lanes(sections: Sequence[Section]) -> tuple[PartialLane, ...]:
    """Return the lanes that do not lead along the whole route, in the order in which they begin.

    A lane of the last section has no end: its ``end_m`` is inf.
    """
    begun = dict.fromkeys(sections[0].lanes, 0.0)
    found = []
    for section in sections:
        for lane in section.lanes:
            begun.setdefault(lane, section.begin_m)
        ended = set(section.lanes) - set(section.leading_on)
        found += [(begun.pop(lane), section.end_m, lane) for lane in sorted(ended)]
    found += [(begin_m, math.inf, lane) for lane, begin_m in begun.items() if begin_m > 0.0]
    return tuple(PartialLane(lane, *[begin_m, end_m] * 2) for begin_m, end_m, lane in sorted(found))


def _onward(shape: Sequence[Point]) -> tuple[Point, ...]:
    """Return a line that goes straight on for ``RUN_OUT_M`` where a shape ends."""
    last = shape[-1]
    before = next((point for point in reversed(shape) if point != last), (last[0] - 1.0, last[1]))
    scale = RUN_OUT_M / math.dist(before, last)
    further = tuple(end + scale * (end - begin) for begin, end in zip(before, last, strict=True))
    return (last, (further[0], further[1]))


def read_layout(network: ET.Element, description: ImportedDescription, name: str) -> Layout:
    """Return the layout of a network file; ``network`` is its root element, ``name`` its path.

    Raises:
        ScenarioError: the description names another network file, or the road differs from it.
    """
    if Path(description.net) != Path(name):
        raise ScenarioError(
            f"The net of the scenario is {description.net}, but must be {NETWORK_FILE!r}: write "
            "the scenario again with: drl-av scenario DIR."
        )
    return open_road.read_layout(network, description, name)


IMPORTED = ScenarioKind(
    "a route through a SUMO network of your own, such as one from OpenStreetMap",
    ImportedDescription,
    open_road.network_text,
    read_layout,
    traffic,
)
