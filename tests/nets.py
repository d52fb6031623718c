"""Networks of a user's own: a true one from OpenStreetMap, and small ones that netconvert makes."""

import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from drl_av.scenarios.imported.description import ImportedDescription
from drl_av.scenarios.netconvert import program

A10 = Path(__file__).parent / "scenarios" / "a10.net.xml"
"""A motorway from OpenStreetMap; its origin and licence are in a10.md beside it."""
EAST = ("264306385", "264308376")
WEST = ("290296351", "264308373")
"""The first and the last edge of its two carriageways."""


def east(**changed: object) -> ImportedDescription:
    """Its eastern carriageway, on which 40 m/s are allowed."""
    return ImportedDescription(**needed("imported") | changed)


def needed(kind: str) -> dict[str, Any]:
    """The settings without which a kind of scenario has no road."""
    ends = {"from_edge": EAST[0], "to_edge": EAST[1], "lowest_limit_m_s": 40.0}
    return {"net": str(A10)} | ends if kind == "imported" else {}


class Part(NamedTuple):
    """An edge of a chain: 500 m of road."""

    lanes: int
    speed_m_s: float = 40.0
    width_m: float = 3.5
    lane: str = ""
    """An element <lane> of netconvert's input."""


def chain(
    folder: Path,
    *parts: Part,
    ways: Sequence[str] | None = None,
    nodes: str = "",
    edges: str = "",
    kind: str = "priority",
    options: Sequence[str] = (),
) -> Path:
    """A bent road of edges e0, e1, ... from node n0 to n1, n2, ..., with junction lanes.

    ``ways`` are the connections of its lanes, such as "e0 1 e1 0"; None leaves them to netconvert.
    ``nodes`` and ``edges`` are more elements of netconvert's input, ``kind`` the type of n1.
    """
    roads = "".join(
        f'<edge id="e{k}" from="n{k}" to="n{k + 1}" numLanes="{part.lanes}" priority="9" '
        f'speed="{part.speed_m_s}" width="{part.width_m}">{part.lane}</edge>'
        for k, part in enumerate(parts)
    )
    places = "".join(
        f'<node id="n{k}" x="{500 * k}" y="{40 * k * k}" type="{kind if k == 1 else "priority"}"/>'
        for k in range(len(parts) + 1)
    )
    return converted(folder, places + nodes, roads + edges, ways, options)


def converted(
    folder: Path, nodes: str, edges: str, ways: Sequence[str] | None, options: Sequence[str] = ()
) -> Path:
    """The network that netconvert makes of these elements and connections."""
    inputs = {"node": nodes, "edge": edges}
    if ways is not None:
        form = '<connection from="{}" fromLane="{}" to="{}" toLane="{}"/>'
        inputs["connection"] = "".join(form.format(*way.split()) for way in ways)
    words: list[str | Path] = [*options, "--no-turnarounds", "true"]
    for name, text in inputs.items():
        file = folder / f"{name}.xml"
        file.write_text(f"<{name}s>{text}</{name}s>")
        words += [f"--{name}-files", file]
    net = folder / "own.net.xml"
    subprocess.run([program("netconvert"), *words, "-o", net], check=True, capture_output=True)
    return net


def along(net: Path, last: int, **changed: object) -> ImportedDescription:
    """The route from e0 to the edge with the number ``last`` of a chain."""
    given = {"net": str(net), "from_edge": "e0", "to_edge": f"e{last}"} | changed
    return ImportedDescription(**given)  # type: ignore[arg-type]


def ways_of(folder: Path) -> set[str]:
    """The connections of lanes in the network of a scenario's folder, such as "e0 1 e1 0"."""
    keys = ("from", "fromLane", "to", "toLane")
    network = ET.parse(folder / "highway.net.xml").getroot()
    return {" ".join(way.attrib[key] for key in keys) for way in network.iter("connection")}


LEAVING_WAYS = (
    *("e0 0 e1 1", "e0 1 e1 2", "e0 2 e1 3"),
    *("e1 0 off 0", "e1 1 e2 0", "e1 2 e2 1", "e1 3 e2 2"),
    *("off 0 away 0", "off 0 away 1"),
)
"""Three lanes, a fourth one that begins to their right, and the off-ramp that it becomes."""
TWO_LANES = (3, 5, 3, 2)
TWO_LANES_WAYS = (
    *("e0 0 e1 2", "e0 1 e1 3", "e0 2 e1 4"),
    *("e1 0 off 0", "e1 1 off 1", "e1 2 e2 0", "e1 3 e2 1", "e1 4 e2 2"),
    *("off 0 away 0", "off 1 away 1"),
)
"""The numbers of lanes and the connections of an off-ramp of two lanes that both begin."""


def leaving(
    folder: Path,
    before_m: float = 1000.0,
    beside_m: float = 250.0,
    ways: Sequence[str] = LEAVING_WAYS,
    lanes: Sequence[int] = (3, 4, 3, 1),
    aside_m: float = -90.0,
    ramp_m: float = 250.0,
) -> Path:
    """A motorway e0, e1, e2 that the edges off and away leave; beside e1 lies the exit's lane.

    ``before_m`` and ``beside_m`` are the lengths of e0 and e1, ``lanes`` the numbers of lanes of
    e0, e1, e2 and off. The off-ramp leads to the right, or to the left if ``aside_m`` is positive;
    ``ramp_m`` is how far off goes.
    """
    cuts = [0.0, before_m, before_m + beside_m, before_m + beside_m + 600.0]
    nodes = "".join(f'<node id="n{k}" x="{x_m}" y="0"/>' for k, x_m in enumerate(cuts))
    nodes += f'<node id="r1" x="{cuts[2] + ramp_m}" y="{aside_m}"/>'
    nodes += f'<node id="r2" x="{cuts[2] + 450}" y="{4 * aside_m}"/>'
    form = '<edge id="{}" from="{}" to="{}" numLanes="{}" priority="9" speed="{}" width="3.5"/>'
    roads = (
        *(("e0", "n0", "n1", lanes[0], 40), ("e1", "n1", "n2", lanes[1], 36)),
        *(("e2", "n2", "n3", lanes[2], 40), ("off", "n2", "r1", lanes[3], 32)),
        ("away", "r1", "r2", 2, 10),
    )
    edges = "".join(form.format(*road) for road in roads)
    # the lanes inside the junction are as fast as the edges: each limit has one place
    return converted(folder, nodes, edges, ways, ["--junctions.limit-turn-speed", "-1"])
