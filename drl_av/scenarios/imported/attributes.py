"""What becomes of each attribute of a network that SUMO obeys on the edges of a route (ours)."""

from collections.abc import Iterator, Mapping
from enum import Enum
from typing import NamedTuple


class Treatment(Enum):
    """What drl-av does with an attribute or an element of a user's network."""

    CARRIED = "the road that is written has the same effect"
    REFUSED = "a value with an effect is an error"
    REPORTED = "a value with an effect is left out, and named"
    WITHOUT_EFFECT = "SUMO's cars drive the same without it"


CARRIED, REFUSED = Treatment.CARRIED, Treatment.REFUSED
REPORTED, WITHOUT_EFFECT = Treatment.REPORTED, Treatment.WITHOUT_EFFECT

TREATMENTS: Mapping[str, Mapping[str, Treatment]] = {
    "edge": {
        **dict.fromkeys(("id", "from", "to", "type"), CARRIED),
        **dict.fromkeys(("shape", "spreadType", "name", "distance", "length"), WITHOUT_EFFECT),
        **dict.fromkeys(("priority", "routingType", "crossingEdges", "param"), WITHOUT_EFFECT),
        "function": REFUSED,
        "bidi": REPORTED,
        "stopOffset": REPORTED,
    },
    "lane": {
        **dict.fromkeys(("id", "index", "length", "width", "speed"), CARRIED),
        **dict.fromkeys(("allow", "disallow", "changeLeft", "changeRight"), CARRIED),
        "acceleration": CARRIED,
        **dict.fromkeys(("shape", "customShape", "outlineShape", "type", "param"), WITHOUT_EFFECT),
        "friction": REPORTED,
        "endOffset": REPORTED,
        "prefer": REPORTED,
        "neigh": REPORTED,
        "stopOffset": REPORTED,
    },
    "connection": {
        **dict.fromkeys(("from", "to", "fromLane", "toLane", "via"), CARRIED),
        **dict.fromkeys(("allow", "disallow", "speed", "length"), CARRIED),
        **dict.fromkeys(("changeLeft", "changeRight"), CARRIED),
        **dict.fromkeys(("shape", "dir", "type", "param"), WITHOUT_EFFECT),
        **dict.fromkeys(("pass", "uncontrolled", "linkIndex", "linkIndex2"), WITHOUT_EFFECT),
        "state": REFUSED,
        "tl": REFUSED,
        "keepClear": REPORTED,
        "contPos": REPORTED,
        "visibility": REPORTED,
        "indirect": REPORTED,
        "conflict": REPORTED,
    },
}
"""The attributes and the child elements that SUMO's format has, for each element of a route.

The speed and the length of a connection are those of its lane inside the junction. Its state and
its traffic lights decide whether the route has the right of way, so "pass" and "uncontrolled" need
no treatment of their own. A type has an effect by the speed limits of classes of vehicles.
"""
NEUTRAL: Mapping[str, str] = {"friction": "1.00", "keepClear": "1", "indirect": "0"}
"""Values of reported attributes that have no effect."""


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
    treatments = TREATMENTS[found.element]
    for key, value in found.attributes.items():
        if treatments.get(key, REPORTED) is REPORTED and not _is_neutral(key, value):
            yield f"{key} {value[:40]} of".replace("  ", " "), found.name


def _is_neutral(key: str, value: str) -> bool:
    """Return whether a reported attribute has a value without an effect."""
    try:
        return float(value) == float(NEUTRAL[key])
    except (KeyError, ValueError):
        return value in ("true", "false") and value == {"1": "true", "0": "false"}.get(
            NEUTRAL.get(key, "")
        )
