"""The way of a route from an edge through a junction to the next one, lane by lane."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from drl_av.errors import ScenarioError
from drl_av.scenarios.imported.net_file import Attributes, NetFile, class_limit

CARS = "passenger"
"""SUMO's class of vehicles that the lanes must admit."""
OTHERS = ("motorcycle", "bus", "coach", "delivery", "truck", "trailer")
"""SUMO's classes of the other vehicles that are usual on a motorway (ours). Its lanes in a network
from OpenStreetMap are open to them, and closed to pedestrians, bicycles, trams and the like."""
PRIORITY = ("M", "Z")
"""SUMO's states of a connection that need not give way to other traffic: major, and zipper."""
YIELDING = ("m", "=")
"""SUMO's states of a connection that gives way without a stop: minor, and equal."""
GREEN = frozenset("GgoO")
"""SUMO's states of a traffic light at which a vehicle need not stop: green, or off."""
TURNS = ("t", "T")
"""SUMO's directions of a connection that turns round."""
TOLERANCE_M = 0.01
"""Largest difference between the lengths of the lanes of an edge; SUMO rounds to centimetres."""


class Step(NamedTuple):
    """The way from an edge to the next one."""

    leading_on: range
    """Lane indices in SUMO, on the first edge."""
    shift: int
    """The SUMO index of a lane on the second edge minus that of the same lane on the first."""
    inside: Mapping[int, Sequence[Attributes]]
    """The lanes inside the junction between them, by the lane index in SUMO on the first edge."""
    further_m_s: Mapping[int, float]
    """The speed limits of the lanes behind the junction, by the lane index on the first edge."""
    leading_away: frozenset[int]
    """Lane indices in SUMO, on the first edge, of the lanes that lead to yet another edge."""
    joining: frozenset[str]
    """The ids of the other edges that lead to the second edge."""
    leaving: frozenset[str]
    """The ids of the other edges to which the first edge leads."""
    left_out: Sequence[str]

    @property
    def length_m(self) -> float:
        """Mean length of the lanes inside the junction, metres."""
        lengths = [sum(float(lane["length"]) for lane in way) for way in self.inside.values()]
        return sum(lengths) / len(lengths) if lengths else 0.0


def car_lanes(edge: Any) -> list[Any]:
    """Return the lanes of an edge that are open to cars; a closed lane is no lane."""
    return [lane for lane in edge.getLanes() if lane.allows(CARS)]


def open_range(edge: Any) -> range:
    """Return the SUMO indices of an edge's open lanes; raise ScenarioError if they do not fit."""
    name, lanes = edge.getID(), car_lanes(edge)
    found = range(lanes[0].getIndex(), lanes[-1].getIndex() + 1)
    if len(found) > len(lanes):
        closed = next(index for index in found if not edge.getLane(index).allows(CARS))
        raise ScenarioError(
            f"lane '{name}_{closed}' is closed to passenger cars and lies between lanes that are "
            "open: change it in netedit, or choose another route."
        )
    lengths = sorted(lane.getLength() for lane in lanes)
    if lengths[-1] - lengths[0] > TOLERANCE_M:
        raise ScenarioError(
            f"the lanes of edge {name!r} are {lengths[0]:g} to {lengths[-1]:g} m long, but must be "
            "equally long: write the network again with netconvert."
        )
    return found


def _ways(edge: Any, following: Any) -> dict[tuple[int, int], Any]:
    """Return the connections for cars between open lanes, by the SUMO indices of both lanes."""
    return {
        (way.getFromLane().getIndex(), way.getToLane().getIndex()): way
        for way in edge.getConnections(following)
        if way.allows(CARS) and way.getFromLane().allows(CARS) and way.getToLane().allows(CARS)
    }


def step_between(file: NetFile, edge: Any, following: Any) -> Step:
    """Return the way from an edge to the following one."""
    ways, lanes, further = _ways(edge, following), open_range(edge), open_range(following)
    aligned_left = further[-1] - lanes[-1]

    def likelihood(shift: int) -> tuple[int, int]:
        kept = sum((lane, lane + shift) in ways for lane in lanes)
        return kept, -abs(shift - aligned_left)

    shift = max(range(further[0] - lanes[-1], further[-1] - lanes[0] + 1), key=likelihood)
    leading_on = [lane for lane in lanes if (lane, lane + shift) in ways]
    if not leading_on:
        raise ScenarioError(
            f"no lane leads cars on from edge {edge.getID()!r} to edge {following.getID()!r}: "
            "connect them in netedit, or choose another route."
        )
    if leading_on != [*range(leading_on[0], leading_on[-1] + 1)]:
        raise ScenarioError(
            f"between lanes of edge {edge.getID()!r} that lead on to edge {following.getID()!r} "
            "lies one that does not: connect it in netedit, or choose another route."
        )
    passages = {lane: ways[lane, lane + shift] for lane in leading_on}
    phrases = [phrase for way in passages.values() for phrase in _right_of_way(file, way)]
    inside = {lane: _inside(file, way) for lane, way in passages.items()}
    return Step(
        range(leading_on[0], leading_on[-1] + 1),
        shift,
        inside,
        {lane: lane_limit_m_s(file, following, lane + shift) for lane in leading_on},
        frozenset(
            lane
            for other in edge.getOutgoing()
            if other is not following
            for lane, _ in _ways(edge, other)
        ),
        frozenset(
            other.getID()
            for other in following.getIncoming()
            if other is not edge and _leads(other, following)
        ),
        frozenset(
            other.getID()
            for other in edge.getOutgoing()
            if other is not following and _leads(edge, other)
        ),
        [*dict.fromkeys(phrases)],
    )


def _leads(edge: Any, other: Any) -> bool:
    """Whether cars may drive from an edge to another one, other than by turning round."""
    ends_inside = "internal" in (edge.getFunction(), other.getFunction())
    ways = _ways(edge, other).values()
    return not ends_inside and any(way.getDirection() not in TURNS for way in ways)


def lane_limit_m_s(file: NetFile, edge: Any, lane: int) -> float:
    """Return the speed limit of a lane for cars, m/s."""
    stated = class_limit(file, edge.getID(), CARS)
    return float(file.lanes[f"{edge.getID()}_{lane}"]["speed"]) if stated is None else stated


def _right_of_way(file: NetFile, passage: Any) -> Iterator[str]:
    """Yield what is left out where the route passes a light or gives way to a ramp.

    Raises:
        ScenarioError: the route stops there, or gives way to more than a ramp that joins it.
    """
    junction, edge = passage.getJunction().getID(), passage.getFrom()
    where = f"junction {junction!r} at the end of edge {edge.getID()!r}"
    if light := passage.getTLSID():
        link = int(passage.getTLLinkIndex())
        shown = {states[link] for states in file.lights.get(light, []) if link < len(states)}
        if not shown or not shown <= GREEN:
            raise ScenarioError(
                f"{where} has traffic lights that stop the route: choose a route without, or "
                "remove them in netedit."
            )
        yield f"the traffic lights of {where}, which always let the route pass"
        return
    if passage.getState() in PRIORITY:
        return
    cars = [
        other
        for other in passage.getJunction().getIncoming()
        if other is not edge
        and other.getFunction() != "internal"
        and any(_ways(other, to) for to in other.getOutgoing())
    ]
    if passage.getState() not in YIELDING or not all(_joins(other, passage) for other in cars):
        raise ScenarioError(
            f"the route gives way at {where}, but traffic from elsewhere is left out: choose a "
            "route that has priority, such as the motorway."
        )
    if cars:
        names = ", ".join(repr(other.getID()) for other in cars)
        yield f"that the route gives way to the ramp {names} at {where}"


def _joins(ramp: Any, passage: Any) -> bool:
    """Whether an edge only leads to the next edge of the route, and has fewer lanes than it."""
    onto = [to for to in ramp.getOutgoing() if _ways(ramp, to)]
    return onto == [passage.getTo()] and len(car_lanes(ramp)) < len(car_lanes(passage.getFrom()))


def _inside(file: NetFile, passage: Any) -> list[Attributes]:
    """Return the lanes inside a junction on a passage through it, in driving order."""
    found: list[Attributes] = []
    via = passage.getViaLaneID()
    passed: list[str] = []
    while via and via not in passed:
        passed.append(via)
        found.append(file.lanes[via])
        edge, _, index = via.rpartition("_")
        lane = file.net.getEdge(edge).getLane(int(index))
        via = next((way.getViaLaneID() for way in lane.getOutgoing()), "")
    return found
