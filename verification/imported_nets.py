"""Imports the motorways of users' networks, and drives on those that are read.

    python -m verification.imported_nets FOLDER > imported_nets.txt
    python -m verification.imported_nets FOLDER --episodes 2

A fast edge has OpenStreetMap's type highway.motorway, or none of its types but two lanes for cars
and a limit of at least 22 m/s. The first route of a network is the longest of all shortest ways
over its fast edges, the others are found in the same manner among the edges that no route has yet.
A network of which no route has 1 km does not count, nor does one with the fast edges of an earlier
one. Each route is written as a scenario of the kind ``imported``; a refusal is printed with its
reason.

With episodes, ``idm-mobil`` drives each route that is read under the check ``paper``, and the
program counts its hits, and the overlaps with other bodies that are not reported as a collision.
The exit status is 1 after either.
"""

import contextlib
import io
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from heapq import heappop, heappush
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax import SAXParseException

import numpy as np

from drl_av.cli import main as drl_av
from drl_av.config import Config
from drl_av.drivers.registry import driving_config, find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import ConfigError
from drl_av.road.snapshot import EGO, EGO_ID, Snapshot
from drl_av.simulation.simulation import Simulation
from drl_av.sumo_programs import sumo_module
from studies.results import markdown_table
from verification.auditor import in_both, touching
from verification.program import Program, run_program

MOTORWAY, FROM_MAP, FAST_M_S = "highway.motorway", "highway.", 22.0
SHORTEST_M = 1000.0
ROUTES = 3
"""Largest number of routes of a network."""
CARS = "passenger"
SEEDS = 830_000
NEAR_M = 50.0
PRINTED = re.compile(
    r"^(\d+) networks, of which (\d+) .*\n(\d+) routes, .*: (\d+) are read \((\d+%)\)", re.MULTILINE
)
"""Matches the counts that this program prints."""
Links = Mapping[str, Sequence[str]]
"""The fast edges to which each fast edge leads, by id."""


class Way(NamedTuple):
    """The edges of a way, first one first, and their length."""

    length_m: float
    edges: tuple[str, ...]


def network(net: Path) -> Any:
    """Read a network by sumolib; raise ConfigError if the file is none."""
    try:
        return sumo_module("sumolib.net").readNet(str(net))
    except SAXParseException as error:
        raise ConfigError(
            f"{net} is no SUMO network ({error.getMessage()}): take it out of the folder."
        ) from error


def fast_edges(net: Any) -> tuple[dict[str, float], dict[str, list[str]]]:
    """Return the length of each fast edge of a network, metres, and the edges that it leads to."""
    lengths_m = {}
    for edge in net.getEdges():
        lanes = [lane for lane in edge.getLanes() if lane.allows(CARS)]
        fast = len(lanes) >= 2 and edge.getSpeed() >= FAST_M_S
        if edge.getType() == MOTORWAY or (fast and not edge.getType().startswith(FROM_MAP)):
            lengths_m[edge.getID()] = edge.getLength()
    links = {
        name: sorted(
            to.getID()
            for to, ways in net.getEdge(name).getOutgoing().items()
            if to.getID() in lengths_m
            if any(way.getDirection() != way.LINKDIR_TURN and way.allows(CARS) for way in ways)
        )
        for name in lengths_m
    }
    return lengths_m, links


def longest_way(lengths_m: Mapping[str, float], links: Links) -> Way:
    """Return the longest of all shortest ways over the edges of ``lengths_m``."""
    found = Way(0.0, ())
    for first in sorted(lengths_m):
        done: dict[str, tuple[float, str]] = {}
        open_ways = [(lengths_m[first], first, "")]
        while open_ways:
            way_m, name, before = heappop(open_ways)
            if name in done:
                continue
            done[name] = way_m, before
            for to in links[name]:
                if to in lengths_m and to not in done:
                    heappush(open_ways, (way_m + lengths_m[to], to, name))
        last = max(done, key=lambda name: (done[name][0], name))
        if done[last][0] > found.length_m:
            edges, step = [last], last
            while step := done[step][1]:
                edges.append(step)
            found = Way(done[last][0], tuple(reversed(edges)))
    return found


def routes_of(lengths_m: Mapping[str, float], links: Links) -> Iterator[Way]:
    """Yield the routes over the fast edges of a network, the longest one first."""
    for _ in range(ROUTES):
        way = longest_way(lengths_m, links)
        if way.length_m < SHORTEST_M:
            return
        yield way
        lengths_m = {name: one for name, one in lengths_m.items() if name not in way.edges}


def imported(net: Path, way: Way, folder: Path) -> tuple[bool, str]:
    """Write the scenario of a route; return whether it was read, and the summary or the refusal."""
    ends = [f"--from-edge={way.edges[0]}", f"--to-edge={way.edges[-1]}"]
    printed, refused = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(refused):
        words = ["scenario", str(folder), "--kind", "imported", "--net", str(net), *ends]
        status = drl_av(words)
    if status:
        text = refused.getvalue().strip().removeprefix("drl-av: ")
        return False, text.removeprefix(f"{net}: ").replace(str(net), "the file")
    return True, " ".join(printed.getvalue().split("\n")[1:]).strip()


def reason(refusal: str) -> str:
    """Return a refusal without the names and numbers of its network."""
    without = re.sub(r"'[^']*'", "X", refusal)
    return re.sub(r"(?<![\w.])\d[\d.]*", "N", without).partition(":")[0]


class Drive(NamedTuple):
    """What happened to the ego in the episodes on a route."""

    decisions: int = 0
    ego_hits: int = 0
    was_hit: int = 0
    unreported: int = 0
    """Episodes in which a body overlapped the ego's, swept through each SUMO step or according to
    SUMO, and no collision was reported."""

    def __str__(self) -> str:
        return "{} decisions, ego hits {}, was hit {}, unreported overlaps {}".format(*self)


def near_the_ego(shot: Snapshot) -> Snapshot:
    """Return a snapshot with those vehicles only that could touch the ego within a step."""
    return shot.of_rows(np.flatnonzero(np.abs(shot.s_m - shot.s_m[EGO]) < NEAR_M).tolist())


def drive(folder: Path, episodes: int) -> Drive:
    """Drive ``idm-mobil`` under ``paper`` in a scenario."""
    specs = find_drivers(["idm-mobil"])
    config = driving_config(specs, Config().with_traffic("calm"))
    [driver] = make_drivers(specs, config).values()
    found = Drive()
    with contextlib.closing(HighwayEnv(folder, config=config)) as env:
        seen: list[Snapshot] = []
        touched: set[tuple[str, str]] = set()

        def after_step(shot: Snapshot) -> None:
            shot = near_the_ego(shot)
            before, after = in_both(seen[-1] if seen else near_the_ego(env.scene.snapshot), shot)
            touched.update(touching(before, after, env.road))
            assert isinstance(env.simulation, Simulation)
            reported = env.simulation._sumo.simulation.getCollisions()
            touched.update((one.collider, one.victim) for one in reported)
            seen[:] = [shot]

        env.simulation.after_step = after_step
        vehicles = env.simulation.fleet.default_vehicle_count
        for seed in range(SEEDS, SEEDS + episodes):
            seen.clear()
            touched.clear()
            decisions = [*rollout(env, driver, seed, vehicles)]
            collision = decisions[-1].collision
            ego_hit = collision is not None and collision.kind.ego_hit
            was_hit = collision is not None and not ego_hit
            unreported = collision is None and any(EGO_ID in pair for pair in touched)
            this = len(decisions), ego_hit, was_hit, unreported
            found = Drive(*map(sum, zip(found, this, strict=True)))
    return found


class Result(NamedTuple):
    """What became of a route."""

    net: str
    way: Way
    read: bool
    text: str
    """The summary of the road, or the refusal."""
    drove: Drive

    def __str__(self) -> str:
        ends = f"from {self.way.edges[0]!r} to {self.way.edges[-1]!r}"
        became = "read" if self.read else "refused"
        text = f"{self.net}, {self.way.length_m / 1000:.1f} km {ends}: {became}.\n    {self.text}"
        return f"{text}\n    {self.drove}" if self.drove.decisions else text


def results_of(folder: Path, episodes: int) -> Iterator[Result]:
    """Yield what becomes of each route of the networks in a folder."""
    known = set[frozenset[tuple[str, float]]]()
    for net in sorted(folder.rglob("*.net.xml")):
        lengths_m, links = fast_edges(network(net))
        if (edges := frozenset(lengths_m.items())) in known:
            continue
        known.add(edges)
        for way in routes_of(lengths_m, links):
            with tempfile.TemporaryDirectory() as home:
                road = Path(home, "road")
                read, text = imported(net, way, road)
                drove = Drive()
                try:
                    drove = drive(road, episodes) if read and episodes else drove
                except ConfigError as error:
                    text += f" Not driven: {error}"
            yield Result(str(net.relative_to(folder)), way, read, text, drove)


def summary(results: Sequence[Result]) -> Iterator[str]:
    """Yield the lines that count what became of all routes."""
    read = [result for result in results if result.read]
    km = [sum(result.way.length_m for result in some) / 1000 for some in (results, read)]
    nets = [{result.net for result in some} for some in (results, read)]
    yield f"{len(nets[0])} networks, of which {len(nets[1])} have a route that is read"
    share = f"{len(read) / max(len(results), 1):.0%}"
    yield f"{len(results)} routes, {km[0]:.0f} km: {len(read)} are read ({share}), {km[1]:.0f} km"
    refused = Counter(reason(result.text) for result in results if not result.read)
    yield from (f"{count} refused: {text}" for text, count in refused.most_common())
    every = Drive(*map(sum, zip(*(result.drove for result in results), strict=True)))
    if every.decisions:
        yield f"driven: {every}"


def table(texts: Mapping[str, str]) -> str:
    """Return the Markdown table of what this program printed, by what it tried."""
    rows = []
    for tried, text in texts.items():
        [(nets, some, routes, read, share)] = PRINTED.findall(text)
        rows.append([tried, f"{some} of {nets}", f"{read} of {routes}", share])
    return markdown_table(["import", "networks with a route read", "routes read", "share"], rows)


def main() -> int:
    """Import the routes of a folder, print what became of each, and drive those that were read."""
    parser = Program(__doc__)
    parser.add_argument("folder", type=Path, help="with networks: FOLDER/.../*.net.xml")
    parser.number("--episodes", 0, "on each route that is read", low=0)
    options = parser.parse_args()
    if not options.folder.is_dir():
        parser.error(f"There is no folder {options.folder}: name one that holds networks.")
    results = []
    for result in results_of(options.folder, options.episodes):
        results.append(result)
        print(result, flush=True)
    print(*summary(results), parser.made_by(), sep="\n")
    return int(any(result.drove.ego_hits + result.drove.unreported for result in results))


if __name__ == "__main__":
    run_program(main)
