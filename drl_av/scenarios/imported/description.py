"""The kind of scenario ``imported``: a route through a SUMO network of the user's own."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import ClassVar

from drl_av.config import TrafficConfig
from drl_av.config.schema import setting
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ScenarioError
from drl_av.road.bounds import check_numbers
from drl_av.road.road import OPEN_LAP_M, Road
from drl_av.scenarios import open_road
from drl_av.scenarios.demo_traffic import traffic
from drl_av.scenarios.highways import AFTER_M, OFF_RAMP_ASIDE_M, require_usual_ego_reaches_exit
from drl_av.scenarios.imported.carriageway import Carriageway, carriageway
from drl_av.scenarios.imported.route import Route, Section, read_route
from drl_av.scenarios.layout import (
    RUN_OUT_M,
    Edge,
    Layout,
    OpenPlan,
    OpenStart,
    RoadType,
    along,
    straight_on,
)
from drl_av.scenarios.netconvert import NETWORK_FILE
from drl_av.scenarios.open_road import BEYOND_M, START_M, OpenDescription
from drl_av.scenarios.road_description import LANE_WIDTH_M, LANES, SPEED_LIMIT_M_S, toml_text

SHORTEST_M, LONGEST_M = 600.0, 50_000.0
"""Lengths of the shortest and the longest route; on the shortest the ego drives 300 m."""


@dataclass(frozen=True)
class ImportedDescription(OpenDescription):
    """A route through a user's network, which defines its lanes, their width and speed limits.

    The route may leave the motorway by an exit lane that begins along the route; the other vehicles
    then stay on the motorway.

    Raises:
        ScenarioError: the route cannot be read (``net_route.read_route``), is too short or too
            long, or has no lane along its whole length or to its exit
            (``carriageway.carriageway``); the ego cannot reach the exit in time; or the speed limit
            is too low for the inflow.
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
    way: Carriageway = field(init=False, repr=False, compare=False)
    """The carriageway of the route, up to the exit if it has one, and the off-ramp there."""
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
        try:
            way = carriageway(route)
        except ScenarioError as error:
            raise ScenarioError(f"{self.net}: the route {error}") from error
        derived = {
            "route": route,
            "way": way,
            "to_edge": way.off_ramp[0].edge if way.off_ramp else self.to_edge,
            "lanes": 1 + max(section.lanes[-1] for section in way.sections),
            "lane_width_m": route.lane_width_m,
            "speed_limit_m_s": min(map(self._speed_limit, way.driven)),
        }
        for name, value in derived.items():
            object.__setattr__(self, name, value)
        self._check_route()
        super().__post_init__()
        self._check_flow()
        require_usual_ego_reaches_exit(self.plan(), self.speed_limit_m_s)

    def plan(self) -> OpenPlan:
        """Return the road: the route, a straight edge beyond its end or exit, and any off-ramp."""
        way, edges = self.way, tuple(map(self._edge, self.way.sections))
        if way.off_ramp:
            ends = {"through": self._straight_on("through", AFTER_M), "exit": self._off_ramp()}
        else:
            ends = {"way": self._straight_on("beyond", RUN_OUT_M)}
        return OpenPlan(
            edges=(*edges, *ends.values()),
            routes={name: tuple(edge.id for edge in (*edges, end)) for name, end in ends.items()},
            road=Road(
                OPEN_LAP_M,
                self.lane_width_m,
                (True,) * self.lanes,
                way.end_m,
                way.partial_lanes,
                way.exit_m,
                exit_lane=max(way.exit_lanes, default=0),
            ),
            start=OpenStart(
                way.through,
                way.end_m + BEYOND_M,
                self.flow_per_h,
                None,
                START_M,
                speed_limits=tuple(
                    (section.end_m, self._speed_limit(section)) for section in way.sections
                ),
            ),
        )

    def to_toml(self) -> str:
        """Return the description as TOML text; ``net`` names the file in the scenario's folder."""
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

    def _straight_on(self, name: str, length_m: float) -> Edge:
        """Return a straight edge of that length, on which all lanes without an exit go on."""
        last, way = self._edge(self.way.sections[-1]), self.way
        drawn_m = max(length_m, way.end_m + RUN_OUT_M - last.end_m)
        return last._replace(
            id=f"{last.id}.{name}",
            begin_m=last.end_m,
            end_m=last.end_m + length_m,
            lanes=last.lanes[len(way.exit_lanes) :],
            shape=straight_on(last.shape, drawn_m),
        )

    def _off_ramp(self) -> Edge:
        """Return the edge after the exit, drawn along the edges of the route after it."""
        way = self.way
        points = chain.from_iterable(section.shape for section in way.off_ramp)
        return self._edge(way.off_ramp[0])._replace(
            begin_m=way.exit_m,
            end_m=way.end_m,
            lanes=way.exit_lanes,
            drawn_aside_m=(0.0, OFF_RAMP_ASIDE_M),
            shape=along(points, AFTER_M + RUN_OUT_M),
        )

    def _check_route(self) -> None:
        """Raise ScenarioError unless the ego can drive on the route."""
        where, length_m = f"{self.net}: the route", self.way.end_m
        if not SHORTEST_M <= length_m <= LONGEST_M:
            raise ScenarioError(
                f"{where} is {length_m:.0f} m long, but must be {SHORTEST_M:g} to {LONGEST_M:g} m: "
                "name other edges."
            )
        for name, value, bounds in (
            ("lanes", self.lanes, LANES),
            ("lane_width_m", self.lane_width_m, LANE_WIDTH_M),
            ("speed_limit_m_s", max(map(self._speed_limit, self.way.driven)), SPEED_LIMIT_M_S),
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


IMPORTED = RoadType(
    "a route through a SUMO network of your own, such as one from OpenStreetMap",
    ImportedDescription,
    open_road.network_text,
    read_layout,
    traffic,
)
