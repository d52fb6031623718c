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
    """Inflow of each of these lanes, vehicles per hour."""
    ego_lane: int | None
    """Index of the lane in which the ego starts; None chooses one of ``lanes`` at random."""
    ego_front_m: float
    """Position of the ego's front bumper at the start."""
    ego_speed_m_s: float | None = None
    """Speed of the ego at the start; None is a safe speed behind the vehicle ahead."""
    speed_limits: tuple[tuple[float, float], ...] = ()
    """Pairs of the end of a part of the road, metres, and the speed limit on it, m/s, in driving
    order; empty if the settings of the traffic cannot exceed the limits."""


class Edge(NamedTuple):
    """A part of an open road that has the same lanes from its beginning to its end."""

    id: str
    begin_m: float
    end_m: float
    lanes: range
    """Indices of its lanes on the road, rightmost first."""
    drawn_aside_m: tuple[float, float] = (0.0, 0.0)
    """Distance to the right at which its beginning and its end are drawn in sumo-gui."""
    speed_limit_m_s: float | None = None
    """None is the speed limit of the description."""
    shape: tuple[Point, ...] = ()
    """The line along which it is drawn in sumo-gui; without points it is straight."""
    spread: str = "right"
    """SUMO's spreadType: how its lanes lie about ``shape``."""


class OpenPlan(NamedTuple):
    """An open road: its edges and routes in SUMO, and the same road as the simulation needs it.

    Each lane continues in the lane of the same index on every edge that begins where its edge ends,
    unless ``road`` says that it ends there. SUMO's road goes on after the end of the ego's way: by
    edges that begin there, else the last edges are extended. The first route is the way of the
    traffic, and that of an ego that has missed its exit; the last route is the way of the ego.
    """

    edges: tuple[Edge, ...]
    routes: dict[str, tuple[str, ...]]
    road: Road
    start: OpenStart


class Layout(NamedTuple):
    """The road of a scenario, as the simulation needs it and as SUMO describes it."""

    road: Road
    routes: dict[str, tuple[str, ...]]
    """The SUMO edge ids of each route, in driving order; the key is the name of the route."""
    lane_positions: dict[str, tuple[int, float]]
    """By SUMO lane id: index of the lane, and position of its start along the road, metres."""
    start: OpenStart | None = None
    """None on a loop, on which the vehicles may start at any position."""


def route_on(routes: Mapping[str, tuple[str, ...]], edge: str, is_way: bool) -> str:
    """Return the name of a route that contains an edge: the first, or with ``is_way`` the last.

    The ego takes the last route, and so does each vehicle that starts in a lane that begins or ends
    on the way: it may lead nowhere else.
    """
    names = [name for name, edges in routes.items() if edge in edges]
    return names[-1 if is_way else 0]


class ScenarioKind(NamedTuple):
    """A kind of scenario: its description, and the functions that write and read its files.

    Each function takes a description. ``read`` takes the root element of the network file, the
    description and the name of the file, and raises ScenarioError if the network is not the
    described one.
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
