"""The interface of a kind of scenario."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any, NamedTuple

from drl_av.traffic.road import Road


class OpenStart(NamedTuple):
    """Where the vehicles of an open road start and enter."""

    lanes: tuple[int, ...]
    """The lanes of the other vehicles, which extend along the whole road."""
    span_m: float
    """The other vehicles start from 0 to here; those that drive farther have left."""
    flow_per_h: float
    """Inflow of each of these lanes, vehicles an hour."""
    ego_lane: int | None
    """The lane in which the ego starts; None is one of ``lanes`` at random."""
    ego_front_m: float
    """Where the ego's front bumper starts."""
    ego_speed_m_s: float | None = None
    """The ego's speed at the start; None is that of the traffic in its lane."""


class Layout(NamedTuple):
    """The road of a scenario in the terms of the simulation and in those of SUMO."""

    road: Road
    routes: dict[str, tuple[str, ...]]
    """Edge ids in driving order, by the name of a route."""
    lane_positions: dict[str, tuple[int, float]]
    """By lane id: the lane's index on the road, and the position of its start, metres."""
    start: OpenStart | None = None
    """None on a loop, on which the vehicles start anywhere."""


class ScenarioKind(NamedTuple):
    """A kind of scenario: its description, and its files in a scenario folder.

    Each function takes a description; ``read`` also takes the root of the network file and the name
    of that file. It raises ScenarioError if the network is not the described one.
    """

    meaning: str
    description: type[Any]
    """A frozen dataclass; the metadata of its fields are the help of the command line."""
    network_text: Callable[[Any], str]
    """The text of the network file."""
    read: Callable[[ET.Element, Any, str], Layout]
    traffic: Callable[[Any], ET.Element]
    """The demo traffic, with which SUMO alone opens the scenario."""
    additional: Callable[[Any], dict[str, ET.Element]] = lambda description: {}
    """More files that SUMO loads before its vehicles, by file name."""
