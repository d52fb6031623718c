"""The interface of a kind of scenario."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from drl_av.traffic.road import Road

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
    speed_limits: tuple[tuple[float, float], ...] = ()
    """One pair for each part of the road, in driving order: the position of its end, metres, and
    its speed limit, m/s. Empty if the road has one limit, which no setting may exceed."""


class Edge(NamedTuple):
    """A part of an open road that has the same lanes from its beginning to its end."""

    id: str
    begin_m: float
    end_m: float
    lanes: range
    """Indices of its lanes on the road, rightmost first."""
    drawn_aside_m: tuple[float, float] = (0.0, 0.0)
    """Shift to the right of its beginning and of its end in the picture of sumo-gui, metres."""
    speed_limit_m_s: float | None = None
    """None is the speed limit of the description."""
    shape: tuple[Point, ...] = ()
    """Points of the line along which sumo-gui draws the edge; empty for a straight edge."""
    spread: str = "right"
    """SUMO's spreadType: how its lanes lie about ``shape``."""


class OpenPlan(NamedTuple):
    """An open road: its edges and routes in SUMO, and the same road as the simulation needs it.

    An edge leads to each edge whose ``begin_m`` equals its ``end_m``. There each lane continues in
    the lane with the same index, unless ``road`` says that the lane ends. The first route is that
    of the traffic, and of an ego that has missed its exit. The last route is that of the ego. SUMO
    needs a road beyond ``road.end_m``: if no edge begins there, ``in_sumo`` extends the edges that
    end there.
    """

    edges: tuple[Edge, ...]
    routes: dict[str, tuple[str, ...]]
    road: Road
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
    start: OpenStart | None = None
    """None on a loop, on which the vehicles may start at any position."""

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


class ScenarioKind(NamedTuple):
    """A kind of scenario: its description, and the functions that write and read its files.

    Each function takes a description, but ``read`` takes (root element of the network file,
    description, name of the file). It raises ScenarioError if the network differs from the
    description.
    """

    meaning: str
    description: type[Any]
    """A frozen dataclass; the command line shows the metadata of its fields as help."""
    network_text: Callable[[Any], str]
    """Returns the text of the network file."""
    read: Callable[[ET.Element, Any, str], Layout]
    traffic: Callable[[Any], ET.Element]
    """Returns the demo traffic, which is used when SUMO alone opens the scenario."""
    additional: Callable[[Any], dict[str, ET.Element]] = lambda description: {}
    """Returns more files that SUMO loads before its vehicles, by file name."""
