"""Reads the user's network file, by means of sumolib; SUMO itself never opens the file."""

import math
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.scenarios.safe_xml import MAX_DEPTH, parse_xml
from drl_av.sumo_programs import sumo_module

REMEDY = "name a network file that netedit or netconvert has written"
BROKEN = (KeyError, IndexError, ValueError, TypeError, AttributeError, AssertionError)
"""The errors with which sumolib fails on a file that is no network."""


class NetFile(NamedTuple):
    """A network that sumolib has read."""

    net: Any
    """The ``sumolib.net.Net``, with the lanes inside junctions."""
    spreads: dict[str, str]
    """SUMO's spreadType of each edge: how its lanes lie about its shape, by edge id."""


class _Elements:
    """A parser's target that passes the elements of a network file on to sumolib."""

    def __init__(self) -> None:
        self._reader = sumo_module("sumolib.net").NetReader(withInternal=True, withFoes=False)
        self._depth = 0
        self._spreads: dict[str, str] = {}

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Pass the start of an element to sumolib; raise ValueError if it is not allowed."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ValueError(f"it nests elements more than {MAX_DEPTH} deep")
        if (self._depth == 1) != (tag == "net"):
            raise ValueError(f"it is no network of SUMO, but has an element <{tag[:40]}>")
        if tag == "net" and attributes.get("lefthand") in ("1", "true"):
            raise ValueError("its traffic drives on the left, and drl-av's on the right")
        if tag == "lane":
            _require_numbers(attributes)
        if tag == "edge" and "id" in attributes:
            self._spreads[attributes["id"]] = attributes.get("spreadType", "right")
        try:
            self._reader.startElement(tag, attributes)
        except BROKEN as error:
            raise ValueError(f"its <{tag}> lacks or misstates {error}") from error

    def end(self, tag: str) -> None:
        """Pass the end of an element to sumolib."""
        self._depth -= 1
        self._reader.endElement(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Raise ValueError: a document type may define entities and name other documents."""
        raise ValueError("it declares a document type")

    def close(self) -> NetFile:
        """Return the network."""
        return NetFile(self._reader.getNet(), self._spreads)


def _require_numbers(lane: dict[str, str]) -> None:
    """Raise ValueError unless the numbers of a lane are finite and not negative."""
    for key in ("length", "speed", "width"):
        if key in lane and not 0 <= float(lane[key]) < math.inf:
            raise ValueError(f"its lane {lane.get('id', '')[:40]!r} has {key} {lane[key][:40]!r}")


def read_net(path: Path) -> NetFile:
    """Read a network file of SUMO.

    Raises:
        ScenarioError: the file is missing, damaged, larger than 64 MB or not a network of SUMO, or
            its traffic drives on the left.
    """
    found: NetFile = parse_xml(path, _Elements(), REMEDY)
    return found
