"""Reads the user's network file, by means of sumolib; SUMO itself never opens the file.

``TREATMENTS`` says what becomes of each attribute that SUMO obeys on the edges of a route.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.scenarios.safe_xml import MAX_DEPTH, parse_xml
from drl_av.sumo_programs import sumo_module

REMEDY = "name a network file that netedit or netconvert has written"
CUT_OUT = "cut out the part with your route by netconvert -s FILE --keep-edges.in-boundary"
BROKEN = (KeyError, IndexError, ValueError, TypeError, AttributeError, AssertionError)
"""The errors with which sumolib fails on a file that is no network."""
TRUE = frozenset(("1", "true", "yes", "on", "x", "t"))
"""SUMO's words for a true value, in lower case."""
CHILDREN = ("stopOffset", "neigh", "conflict")
"""Child elements of edges, lanes and connections that change how SUMO drives."""
Attributes = dict[str, str]


class NetFile(NamedTuple):
    """A network that sumolib has read, and what sumolib leaves out."""

    net: Any
    """The ``sumolib.net.Net``, with the lanes inside junctions."""
    edges: dict[str, Attributes]
    """The attributes of each edge by its id. A child element is an attribute with its name."""
    lanes: dict[str, Attributes]
    connections: dict[tuple[str, str, str, str], Attributes]
    """By (from, fromLane, to, toLane)."""
    class_limits: dict[str, Attributes]
    """The speed limits of classes of vehicles, by the type of an edge and the class."""
    lights: dict[str, list[str]]
    """The states of all phases of the traffic lights, by id."""
    drives_left: bool
    """Whether its traffic drives on the left."""


class _Elements:
    """A parser's target that passes the elements of a network file on to sumolib."""

    def __init__(self) -> None:
        self._reader = sumo_module("sumolib.net").NetReader(withInternal=True, withFoes=False)
        self._open: list[tuple[str, Attributes]] = []
        self._found = NetFile(None, {}, {}, {}, {}, {}, False)

    def start(self, tag: str, attributes: Attributes) -> None:
        """Pass the start of an element to sumolib; raise ValueError if it is not allowed."""
        above = self._open[-1] if self._open else ("", {})
        self._open.append((tag, attributes))
        if len(self._open) > MAX_DEPTH:
            raise ValueError(f"it nests elements more than {MAX_DEPTH} deep")
        if (len(self._open) == 1) != (tag == "net"):
            raise ValueError(f"it is no network of SUMO, but has an element <{tag[:40]}>")
        try:
            self._keep(tag, attributes, above)
            self._reader.startElement(tag, attributes)
        except BROKEN as error:
            raise ValueError(f"its <{tag}> lacks or misstates {error}") from error

    def _keep(self, tag: str, attributes: Attributes, above: tuple[str, Attributes]) -> None:
        """Keep what sumolib leaves out; ``above`` is the element that contains this one."""
        found, (parent, its) = self._found, above
        if tag == "net" and attributes.get("lefthand", "").lower() in TRUE:
            self._found = found._replace(drives_left=True)
        elif tag == "edge":
            found.edges[attributes["id"]] = attributes
        elif tag == "lane":
            _require_numbers(attributes)
            found.lanes[attributes["id"]] = attributes
        elif tag == "connection":
            keys = (attributes[key] for key in ("from", "fromLane", "to", "toLane"))
            found.connections[next(keys), next(keys), next(keys), next(keys)] = attributes
        elif tag == "restriction" and parent == "type":
            limits = found.class_limits.setdefault(its["id"], {})
            limits[attributes["vClass"]] = attributes["speed"]
        elif tag == "phase" and parent == "tlLogic":
            found.lights.setdefault(its["id"], []).append(attributes["state"])
        elif tag in CHILDREN and parent in ("edge", "lane", "connection"):
            its[tag] = " ".join(attributes.values())

    def end(self, tag: str) -> None:
        """Pass the end of an element to sumolib."""
        self._open.pop()
        self._reader.endElement(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Raise ValueError: a document type may define entities and name other documents."""
        raise ValueError("it declares a document type")

    def close(self) -> NetFile:
        """Return the network."""
        return self._found._replace(net=self._reader.getNet())


def _require_numbers(lane: Attributes) -> None:
    """Raise ValueError unless the numbers of a lane are finite, and its speed is positive."""
    for key, low in (("length", 0.0), ("speed", 1e-9), ("width", 0.0)):
        if key in lane and not low <= float(lane[key]) < math.inf:
            raise ValueError(f"its lane {lane.get('id', '')[:40]!r} has {key} {lane[key][:40]!r}")


def read_net(path: Path, remedy: str = REMEDY) -> NetFile:
    """Read a network file of SUMO; ``remedy`` is the advice if the file is missing or damaged.

    Raises:
        ScenarioError: the file is missing, damaged, larger than 64 MB or not a network of SUMO.
    """
    found: NetFile = parse_xml(path, _Elements(), remedy, CUT_OUT)
    return found


def class_limit(file: NetFile, edge: str, vehicle_class: str) -> float | None:
    """Return the speed limit that an edge has for a class of vehicles, m/s; None if it has none.

    SUMO then obeys it in place of the limit of the lanes.
    """
    stated = file.class_limits.get(file.edges[edge].get("type", ""), {}).get(vehicle_class)
    return None if stated is None else float(stated)


def other_class_limits(file: NetFile, edges: Sequence[str], vehicle_class: str) -> list[str]:
    """Return a phrase for each speed limit of another class of vehicles on these edges."""
    found = {
        f"the limit of {other} on edges of type {kind!r}, {float(limit):g} m/s"
        for kind in {file.edges[edge].get("type", "") for edge in edges}
        for other, limit in file.class_limits.get(kind, {}).items()
        if other != vehicle_class
    }
    return sorted(found)


TREATMENTS: Mapping[str, tuple[str, str]] = {
    "edge": (
        "id from to type function shape spreadType name distance length priority routingType "
        "crossingEdges param",
        "bidi stopOffset",
    ),
    "lane": (
        "id index length width speed allow disallow changeLeft changeRight acceleration shape "
        "customShape outlineShape type param",
        "friction endOffset prefer neigh stopOffset",
    ),
    "connection": (
        "from to fromLane toLane via allow disallow speed length changeLeft changeRight state tl "
        "shape dir type param pass uncontrolled linkIndex linkIndex2",
        "keepClear contPos visibility indirect conflict",
    ),
}
"""The attributes and the child elements that SUMO's format has, for each element of a route.

The first are not named: the road that is written has the same effect, a value with an effect is an
error ("function", "state" and "tl"), or SUMO's cars drive the same without it. Of the others, a
value with an effect is left out, and named.

The speed and the length of a connection are those of its lane inside the junction. Its state and
its traffic lights decide whether the route has the right of way, so "pass" and "uncontrolled" need
no treatment of their own. The classes of vehicles to which a lane is closed are named by
``route.read_route``. A type has an effect by the speed limits of classes of vehicles.
"""
NEUTRAL: Mapping[str, float] = {"friction": 1.0, "keepClear": 1.0, "indirect": 0.0}
"""Values of attributes that would be named which have no effect."""


class Found(NamedTuple):
    """An element of the route in the user's network."""

    element: str
    """A key of ``TREATMENTS``."""
    name: str
    """How a message names it, such as "lane 'M1_0'"."""
    attributes: Mapping[str, str]
    """Its attributes; each of its child elements has an entry with the name of the element."""


def left_out(found: Found) -> Iterator[tuple[str, str]]:
    """Yield each attribute of an element that is left out, such as "friction 0.5 of", and its name.

    An attribute that ``TREATMENTS`` does not know is left out, too.
    """
    unnamed = TREATMENTS[found.element][0].split()
    for key, value in found.attributes.items():
        if key not in unnamed and not _is_neutral(key, value):
            yield f"{key} {value[:40]} of".replace("  ", " "), found.name


def _is_neutral(key: str, value: str) -> bool:
    """Return whether an attribute that would be named has a value without an effect."""
    try:
        return float({"true": "1", "false": "0"}.get(value, value)) == NEUTRAL[key]
    except (KeyError, ValueError):
        return False
