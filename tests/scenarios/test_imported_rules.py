"""What SUMO obeys on a user's network: carried over to the road, refused, or named as left out."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest
from nets import Part, along, chain, converted, east
from plain_sumo import run_sumo
from runs import Capsys, replace_in

from drl_av.cli import main
from drl_av.errors import ScenarioError
from drl_av.road.road import OPEN_LAP_M, may_cross, road_numbers
from drl_av.scenarios.folder import load_scenario, read_description, write_scenario
from drl_av.scenarios.imported.description import ImportedDescription
from drl_av.scenarios.imported.net_file import TREATMENTS, Found, left_out
from drl_av.scenarios.netconvert import program

Place = tuple[float, float]
"""x and y, metres."""
XSD = program("netconvert").parents[1] / "data" / "xsd" / "net_file.xsd"


def described(net: Path, first: str, last: str, **changed: Any) -> ImportedDescription:
    return ImportedDescription(net=str(net), from_edge=first, to_edge=last, **changed)


def node(name: str, x: float, y: float, more: str = "") -> str:
    return f'<node id="{name}" x="{x:.2f}" y="{y:.2f}" {more}/>'


def edge(name: str, first: str, last: str, lanes: int, speed: int, more: str = "") -> str:
    """An edge between two nodes; ``more`` are its other attributes."""
    ends = f'from="{first}" to="{last}"'
    return f'<edge id="{name}" {ends} numLanes="{lanes}" speed="{speed}" {more}/>'


def bend(folder: Path) -> Path:
    """Three lanes round a right angle, inside whose junction netconvert slows each lane down."""
    nodes = node("a", 0, 0) + node("b", 1000, 0, 'radius="6"') + node("c", 1000, 1000)
    return converted(folder, nodes, edge("A", "a", "b", 3, 33) + edge("B", "b", "c", 3, 33), None)


def solid(folder: Path, lane: str) -> Path:
    lanes = "".join(f'<lane index="{index}" {lane}/>' for index in range(3))
    road = edge("S", "a", "b", 3, 36).replace("/>", f">{lanes}</edge>")
    return converted(folder, node("a", 0, 0) + node("b", 2500, 0), road, None)


def test_the_list_has_every_attribute_and_child_of_sumos_format() -> None:
    space = "{http://www.w3.org/2001/XMLSchema}"
    root = ET.parse(XSD).getroot()
    for element, treatments in TREATMENTS.items():
        kinds = root.iter(f"{space}complexType")
        [kind] = [each for each in kinds if each.get("name") == f"{element}Type"]
        attributes = {each.attrib["name"] for each in kind.iter(f"{space}attribute")}
        children = {each.attrib["name"] for each in kind.iter(f"{space}element")} - {"lane"}
        assert attributes | children == {*" ".join(treatments).split()}


EVERY = [(e, key) for e, words in TREATMENTS.items() for key in " ".join(words).split()]


@pytest.mark.parametrize(("element", "key"), EVERY)
def test_what_is_left_out_is_named_and_all_else_is_not(element: str, key: str) -> None:
    named = [*left_out(Found(element, "lane 'M1_0'", {key: "7"}))]
    is_reported = key in TREATMENTS[element][1].split()
    assert named == ([(f"{key} 7 of", "lane 'M1_0'")] if is_reported else [])


def test_an_attribute_that_is_new_to_the_list_is_named() -> None:
    found = Found("lane", "lane 'a_0'", {"gravity": "3", "friction": "1.00", "speed": "9"})
    assert [*left_out(found)] == [("gravity 3 of", "lane 'a_0'")]


@pytest.mark.parametrize(
    ("old", "new", "phrase"),
    [
        ('id="e0_0" ', 'id="e0_0" friction="0.50" ', "friction 0.50 of lane 'e0_0'"),
        ('id="e0_0" ', 'id="e0_0" endOffset="9" ', "endOffset 9 of lane 'e0_0'"),
        ('id="e0_0" ', 'id="e0_0" prefer="bus" ', "prefer bus of lane 'e0_0'"),
        ('id="e0" ', 'id="e0" bidi="e1" ', "bidi e1 of edge 'e0'"),
        ('to="e1" ', 'to="e1" keepClear="0" ',
         "keepClear 0 of the way from lane 'e0_0' to 'e1_0'"),
        ('to="e1" ', 'to="e1" visibility="9" ',
         "visibility 9 of the way from lane 'e0_0' to 'e1_0'"),
        ('<lane id="e0_0"', '<stopOffset value="5"/><lane id="e0_0"', "stopOffset 5 of edge 'e0'"),
        ('id=":n1_0_0" ', 'id=":n1_0_0" friction="0.3" ', "friction 0.3 of lane ':n1_0_0'"),
        ('<lane id=":n1_0_0"', '<stopOffset value="5"/><lane id=":n1_0_0"',
         "stopOffset 5 of edge ':n1_0'"),
        ('from=":n1_0" ', 'from=":n1_0" visibility="9" ',
         "visibility 9 of the way from lane ':n1_0_0' to 'e1_0'"),
        ('id="e0_0" ', 'id="e0_0" friction="1.0" ', ""),  # it has no effect
    ],
)  # fmt: skip
def test_a_value_that_sumo_obeys_and_the_road_lacks_is_named(
    old: str, new: str, phrase: str, tmp_path: Path
) -> None:
    net = chain(tmp_path, Part(2), Part(2))
    replace_in(net, old, new)
    assert along(net, 1).leaves_out == ((phrase,) if phrase else ())


def test_a_connection_that_is_closed_to_cars_leads_nowhere(tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2), Part(2))
    way = '<connection from="e0" to="e1" fromLane="0" toLane="0"'
    replace_in(net, way, f'{way} disallow="passenger"')
    ends = [(part.lane, part.end_m) for part in along(net, 1).plan().road.partial_lanes]
    assert ends == [(0, pytest.approx(502.0, abs=1.0)), (0, float("inf"))]  # and one begins there


@pytest.mark.parametrize("word", ["1", "yes"])
def test_an_acceleration_lane_stays_one(word: str, tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2, lane='<lane index="0" acceleration="true"/>'), Part(2))
    replace_in(net, 'acceleration="1"', f'acceleration="{word}"')
    write_scenario(tmp_path / "road", along(net, 1))
    written = ET.parse(tmp_path / "road" / "highway.net.xml").iter("lane")
    assert [lane.attrib["id"] for lane in written if "acceleration" in lane.attrib] == ["e0_0"]


def test_an_edge_with_a_function_is_no_part_of_a_route(tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2), Part(2), Part(2))
    replace_in(net, 'id="e1" ', 'id="e1" function="connector" ')
    with pytest.raises(ScenarioError, match="no way leads cars from edge 'e0' to edge 'e2'"):
        along(net, 2)


def speeds(net: Path, route: str, folder: Path, lane: int = 0) -> list[float]:
    """The speeds of one car in plain SUMO that wants to drive 30 m/s, step by step."""
    rou, fcd = folder / "one.rou.xml", folder / "one.fcd.xml"
    rou.write_text(
        '<routes><vType id="t" maxSpeed="30" speedDev="0" sigma="0" '
        'lcSpeedGain="0" lcKeepRight="0"/>'
        f'<vehicle id="v" type="t" depart="0" departSpeed="max" departLane="{lane}">'
        f'<route edges="{route}"/></vehicle></routes>'
    )
    run_sumo("-n", net, "-r", rou, "--fcd-output", fcd, "--step-length", "0.1")
    return [float(one.attrib["speed"]) for one in ET.parse(fcd).iter("vehicle")]


def speeds_on(folder: Path, lane: int = 0) -> list[float]:
    """The same on the road of a scenario."""
    route = " ".join(load_scenario(folder).layout.routes["way"])
    return speeds(folder / "highway.net.xml", route, folder.parent, lane)


def kept(description: ImportedDescription, tmp_path: Path) -> Path:
    """The folder that is written of it, which has the same road."""
    write_scenario(tmp_path / "road", description)
    assert load_scenario(tmp_path / "road").road == description.plan().road
    return tmp_path / "road"


def test_each_lane_of_a_right_angle_is_as_slow_as_on_the_users_own_network(tmp_path: Path) -> None:
    net = bend(tmp_path)
    description = described(net, "A", "B")
    limits, folder = description.plan().road.speed_limits, kept(description, tmp_path)
    assert {lane[0].limit_m_s for lane in limits} == {33.0}
    # netconvert's lanes round the bend: the outer one is the fastest
    for lane, slowest in enumerate([7.66, 6.08, 3.90]):
        assert min(limit.limit_m_s for limit in limits[lane]) == slowest
        for driven in (speeds(net, "A B", tmp_path, lane), speeds_on(folder, lane)):
            assert min(driven) == pytest.approx(slowest, abs=0.01)


def test_each_lane_keeps_its_own_limit(tmp_path: Path) -> None:
    slow = '<lane index="0" speed="20"/>'
    description = along(chain(tmp_path, Part(2), Part(2, lane=slow)), 1)
    road = description.plan().road
    assert [lane[-1].limit_m_s for lane in road.speed_limits] == [20.0, 40.0]
    folder = kept(description, tmp_path)
    for lane, fastest in ((0, 20.0), (1, 30.0)):
        assert speeds_on(folder, lane)[-1] == pytest.approx(fastest, abs=0.01)


TYPES = '<types><type id="motorway"><restriction vClass="{}" speed="22"/></type></types>'


@pytest.mark.parametrize(("of", "limit"), [("passenger", 22.0), ("truck", 40.0)])
def test_the_limit_of_cars_is_carried_and_that_of_trucks_named(
    of: str, limit: float, tmp_path: Path
) -> None:
    (tmp_path / "types.xml").write_text(TYPES.format(of))
    net = chain(tmp_path, Part(2), Part(2), options=["--type-files", str(tmp_path / "types.xml")])
    text = net.read_text().replace('<edge id="e1"', '<edge id="e1" type="motorway"', 1)
    if "<restriction" not in text:
        text = text.replace("<edge ", TYPES.format(of)[7:-8] + "<edge ", 1)
    net.write_text(text)
    description = along(net, 1)
    assert description.plan().road.speed_limits[0][-1].limit_m_s == limit
    phrase = "the limit of truck on edges of type 'motorway', 22 m/s"
    assert (description.leaves_out) == ((phrase,) if of == "truck" else ())
    # plain SUMO obeys the same on the user's network
    assert speeds(net, "e0 e1", tmp_path)[-1] == pytest.approx(min(limit, 30.0), abs=0.01)


def shaped(*places: Place) -> str:
    """The attribute of an edge along these places."""
    return f'shape="{" ".join(f"{x:.2f},{y:.2f}" for x, y in places)}"'


def drawn(folder: Path, *places: Place) -> Path:
    """A road along these places, all one edge."""
    nodes = node("a", *places[0]) + node("b", *places[-1])
    return converted(folder, nodes, edge("C", "a", "b", 2, 36, shaped(*places)), None)


def arc(begin_m: float, radius_m: float) -> list[Place]:
    """A quarter of a circle to the left."""
    turned = [pi * k / 40 for k in range(21)]
    return [(begin_m + radius_m * sin(angle), radius_m * (1 - cos(angle))) for angle in turned]


def curved(folder: Path, radius_m: float) -> Path:
    """A road of 600 m, a quarter of a circle, and 600 m."""
    last = 600 + radius_m
    return drawn(folder, (0, 0), *arc(600, radius_m), (last, last))


def test_a_curve_has_the_speed_at_which_it_can_be_driven(tmp_path: Path) -> None:
    description = described(curved(tmp_path, 150.0), "C", "C")
    [curve] = description.curves
    # sqrt(5.5 m/s^2 x 150 m) = 28.7 m/s
    assert curve.limit_m_s == pytest.approx(28.7, rel=0.05)
    assert curve.begin_m == pytest.approx(600.0, abs=75.0)
    assert curve.end_m == pytest.approx(600 + 150 * 3.14159 / 2, abs=75.0)
    said = f"; 1 limit in curves, the lowest {curve.limit_m_s:.1f} m/s at {curve.begin_m:.0f} m."
    assert said in description.summary
    driven = speeds_on(kept(description, tmp_path))
    assert min(driven) == pytest.approx(curve.limit_m_s, abs=0.01)


def bent(folder: Path, edges: int) -> Path:
    """A road of 600 m, a quarter of a circle of 60 m in so many edges, and 600 m."""

    def place(turned: float) -> tuple[float, float]:
        return 600 + 60 * sin(turned * pi / 2), 60 * (1 - cos(turned * pi / 2))

    places = [(0.0, 0.0), *(place(k / edges) for k in range(edges + 1)), (660.0, 660.0)]
    nodes = "".join(node(f"n{k}", x, y) for k, (x, y) in enumerate(places))
    roads = ""
    for k in range(edges + 2):
        middle = [place((k - 0.5) / edges)] if 0 < k <= edges else []
        shape = shaped(places[k], *middle, places[k + 1])
        roads += edge(f"e{k}", f"n{k}", f"n{k + 1}", 2, 30, shape)
    return converted(folder, nodes, roads, None)


@pytest.mark.parametrize("edges", [2, 6, 18])
def test_a_curve_of_many_edges_has_the_speed_of_one_edge(edges: int, tmp_path: Path) -> None:
    # it is 94 m long, so its edges, from 47 to 5 m, are shorter than the chords that measure it
    net = bent(tmp_path, edges)
    description = described(net, "e0", f"e{edges + 1}")
    [*_, sharpest] = sorted(description.curves, key=lambda curve: -curve.limit_m_s)
    # sqrt(5.5 m/s^2 x 60 m) = 18.2 m/s
    assert sharpest.limit_m_s == pytest.approx(18.2, rel=0.05)
    assert 600 < sharpest.begin_m < 650 < sharpest.end_m < 694
    limits = [limit for *_, limit in description.plan().road.speed_limits[0]]
    # one bend: the traffic does not speed up in the middle of it
    slowest = limits.index(min(limits))
    assert limits[: slowest + 1] == sorted(limits[: slowest + 1], reverse=True)
    assert limits[slowest:] == sorted(limits[slowest:])


@pytest.mark.parametrize("at_the_end", [True, False])
def test_a_bend_in_which_the_route_begins_or_ends_has_its_speed_up_to_there(
    at_the_end: bool, tmp_path: Path
) -> None:
    # 900 m, and a quarter of a circle of 60 m, 94 m long: sqrt(5.5 m/s^2 x 60 m) = 18.2 m/s
    places = [(0.0, 0.0), *arc(900, 60)]
    net = drawn(tmp_path, *(places if at_the_end else reversed(places)))
    description = described(net, "C", "C")
    for lane in description.plan().road.speed_limits:
        bend, straight = (lane[-1], lane[0]) if at_the_end else (lane[0], lane[-1])
        assert (bend.limit_m_s, straight.limit_m_s) == (pytest.approx(18.2, rel=0.05), 36.0)
        # it begins or ends in the bend, at most a chord of 36 m from its end that is on the way
        assert abs((bend.begin_m if at_the_end else 994 - bend.end_m) - 936) < 36.0
    kept(description, tmp_path)


def test_the_curve_of_an_on_ramp_limits_the_lane_that_comes_from_it_alone(tmp_path: Path) -> None:
    # the ramp meets the motorway at an angle of 50 degrees, atan(300 / 250), and becomes its lane 0
    nodes = node("a", 0, 0) + node("r", 750, -300) + node("b", 1000, 0) + node("c", 3000, 0)
    edges = edge("M1", "a", "b", 3, 33, 'priority="9"') + edge("on", "r", "b", 1, 33)
    edges += edge("M2", "b", "c", 4, 33, 'priority="9"')
    ways = ["M1 0 M2 1", "M1 1 M2 2", "M1 2 M2 3", "on 0 M2 0"]
    net = converted(tmp_path, nodes, edges, ways, ["--junctions.limit-turn-speed", "-1"])
    description = described(net, "on", "M2")
    road, merge_m = description.plan().road, description.route.sections[0].end_m
    ramp, *motorway = road.speed_limits
    # chords of 36 m: sqrt(5.5 m/s^2 x 36 m / 0.876) = 15 m/s
    assert min(limit for *_, limit in ramp) == pytest.approx(15.0, rel=0.05)
    assert {limit for begin_m, _, limit in ramp if begin_m > merge_m} > {33.0}
    assert set(motorway) == {((merge_m, OPEN_LAP_M, 33.0),)}
    kept(description, tmp_path)


def test_the_limits_of_a_written_network_are_not_changed_in_silence(tmp_path: Path) -> None:
    write_scenario(tmp_path / "road", described(curved(tmp_path, 150.0), "C", "C"))
    written = read_description(tmp_path / "road" / "scenario.toml", "correct it")
    for name in ("sideways_m_s2", "lowest_limit_m_s"):
        with pytest.raises(ScenarioError, match="or import the network anew"):
            replace(written, **{name: 3.0})


@pytest.mark.parametrize(("radius_m", "sideways"), [(400.0, 5.5), (150.0, 9.0)])
def test_a_gentle_curve_or_a_bolder_setting_changes_nothing(
    radius_m: float, sideways: float, tmp_path: Path
) -> None:
    net = curved(tmp_path, radius_m)
    assert described(net, "C", "C", sideways_m_s2=sideways).curves == ()


def changes(net: Path, lanes_of: Callable[[str], int], edges: str, folder: Path) -> int:
    """The lane changes in plain SUMO among slow and fast vehicles."""
    rou, fcd = folder / "flow.rou.xml", folder / "flow.fcd.xml"
    rou.write_text(
        '<routes><vType id="s" maxSpeed="15"/><vType id="f" maxSpeed="40" lcSpeedGain="10"/>'
        f'<route id="r" edges="{edges}"/>'
        '<flow id="s" type="s" begin="0" end="60" number="8" route="r" departLane="1" '
        'departSpeed="max"/><flow id="f" type="f" begin="0" end="60" number="20" route="r" '
        'departLane="random" departSpeed="max"/></routes>'
    )
    run_sumo("-n", net, "-r", rou, "--fcd-output", fcd, "--end", "150", "--no-warnings", "true")
    seen: dict[str, int] = {}
    found = 0
    for one in ET.parse(fcd).iter("vehicle"):
        name, lane = one.attrib["id"], lanes_of(one.attrib["lane"])
        found += seen.get(name, lane) != lane
        seen[name] = lane
    return found


@pytest.mark.parametrize(
    ("lane", "some"), [('changeLeft="authority" changeRight="authority"', False), ("", True)]
)
def test_plain_sumo_changes_lanes_on_the_road_as_on_the_users_network(
    lane: str, some: bool, tmp_path: Path
) -> None:
    net = solid(tmp_path, lane)
    write_scenario(tmp_path / "road", described(net, "S", "S"))
    layout = load_scenario(tmp_path / "road").layout
    own = changes(net, lambda name: int(name.rpartition("_")[2]), "S", tmp_path)
    way, places = " ".join(layout.routes["way"]), layout.lane_positions
    written = tmp_path / "road" / "highway.net.xml"
    made = changes(written, lambda name: places[name][0], way, tmp_path)
    assert (own > 0, made > 0) == (some, some)


def test_each_direction_of_a_line_is_forbidden_by_itself(tmp_path: Path) -> None:
    road = described(solid(tmp_path, 'changeLeft="bus"'), "S", "S").plan().road
    assert [line[:2] for line in road.forbidden_lines] == [(0, 1), (1, 1)]
    numbers = road_numbers(road)
    assert may_cross(1, -1, 0.0, 2500.0, numbers)
    assert not may_cross(0, 1, 100.0, 101.0, numbers)
    assert may_cross(0, 1, 2600.0, 2601.0, numbers)  # beyond the user's network all is permitted
    allowed = described(solid(tmp_path, 'changeLeft="bus passenger"'), "S", "S").plan().road
    assert allowed.forbidden_lines == ()


def test_a_closed_lane_is_no_lane(tmp_path: Path) -> None:
    shoulder = '<lane index="0" disallow="all"/>'
    hov = '<lane index="3" allow="hov bus"/>'
    net = chain(tmp_path, Part(4, lane=shoulder + hov), Part(4, lane=shoulder + hov))
    description = along(net, 1)
    assert description.lanes == 2
    assert description.plan().road.partial_lanes == ()
    closed = [phrase for phrase in description.leaves_out if "closed" in phrase]
    assert closed == ["lanes closed to cars, lane 'e0_0' and 3 more"]
    kept(description, tmp_path)


FROM_MAP = (
    "rail rail_urban rail_electric rail_fast tram drone aircraft scooter container wheelchair "
    "subway cable_car ship pedestrian bicycle moped"
)
"""What netconvert's types for OpenStreetMap close a highway.motorway to."""


@pytest.mark.parametrize(
    ("closed", "named"),
    [
        ('disallow="truck trailer"', "truck, trailer"),
        (f'disallow="{FROM_MAP}"', ""),
        (f'disallow="{FROM_MAP} truck"', "truck"),
        ('allow="passenger"', "motorcycle, bus, coach, delivery, truck, trailer"),
    ],
)
def test_a_lane_that_is_closed_to_trucks_is_a_lane_for_all_and_is_named(
    closed: str, named: str, tmp_path: Path
) -> None:
    part = Part(2, lane=f'<lane index="1" {closed}/>')
    description = along(chain(tmp_path, part, part), 1)
    phrases = (f"that {named} may not use lane 'e0_1' and 1 more",) if named else ()
    assert (description.lanes, description.leaves_out) == (2, phrases)
    folder = kept(description, tmp_path)
    assert "allow=" not in (folder / "highway.net.xml").read_text()


def test_a_motorway_from_openstreetmap_is_closed_to_nobody_who_is_usual_there() -> None:
    assert not [phrase for phrase in east().leaves_out if "may not use" in phrase]


def test_a_shoulder_that_opens_is_a_lane_that_begins(tmp_path: Path) -> None:
    shoulder = Part(3, lane='<lane index="0" disallow="all"/>')
    net = chain(tmp_path, shoulder, Part(3), ways=["e0 1 e1 1", "e0 2 e1 2"])
    [part] = along(net, 1).plan().road.partial_lanes
    assert (part.lane, part.begin_m > 0, part.end_m) == (0, True, float("inf"))


def meeting(folder: Path, kind: str, ramp_lanes: int = 1) -> Path:
    """A motorway of three lanes that a ramp joins in the right lane, at a junction of a kind."""
    nodes = node("a", 0, 0) + node("b", 700, 0, f'type="{kind}"')
    nodes += node("d", 1500, 0) + node("r", 400, -80)
    edges = "".join(edge(*ends, 3, 36, 'priority="5"') for ends in (("M1", *"ab"), ("M2", *"bd")))
    edges += edge("on", "r", "b", ramp_lanes, 36, 'priority="9"')
    ways = ["M1 0 M2 0", "M1 1 M2 1", "M1 2 M2 2", "on 0 M2 0"]
    return converted(folder, nodes, edges, ways)


def test_the_motorway_is_driven_past_a_ramp_to_which_its_lane_gives_way(tmp_path: Path) -> None:
    net = meeting(tmp_path, "priority")
    states = re.findall(r'<connection from="M1"[^>]*state="(.)"', net.read_text())
    assert set(states) == {"m"}  # the ramp has the higher priority
    description = described(net, "M1", "M2")
    assert description.leaves_out == (
        "1 road that joins it, with its traffic",
        "that the route gives way to the ramp 'on' at junction 'b' at the end of edge 'M1'",
    )
    assert description.plan().road.partial_lanes == ()


def test_a_junction_without_other_roads_leaves_nothing_out(tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2), Part(2))
    net.write_text(net.read_text().replace('state="M"', 'state="m"'))
    assert along(net, 1).leaves_out == ()


def test_a_route_stays_on_the_motorway_beside_a_shorter_way_through_a_town(tmp_path: Path) -> None:
    # 2,000 m at 36 m/s take 56 s, the way through the town of 1,600 m at 14 m/s takes 114 s
    nodes = node("a", 0, 0) + node("b", 700, 0) + node("m", 1500, 600)
    nodes += node("c", 2300, 0) + node("d", 3000, 0)
    motorway = (("M1", "a", "b"), ("M2", "b", "m"), ("M3", "m", "c"), ("M4", "c", "d"))
    edges = "".join(edge(*ends, 3, 36) for ends in motorway) + edge("town", "b", "c", 1, 14)
    ways = [f"{one} {lane} {other} {lane}" for one, other in pairwise(("M1", "M2", "M3", "M4"))
            for lane in range(3)]  # fmt: skip
    net = converted(tmp_path, nodes, edges, [*ways, "M1 0 town 0", "town 0 M4 0"])
    sections = described(net, "M1", "M4").way.sections
    assert [section.edge for section in sections] == ["M1", "M2", "M3", "M4"]


def test_a_route_that_gives_way_to_as_many_lanes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"gives way at junction 'b' .* such as the motorway"):
        described(meeting(tmp_path, "priority", ramp_lanes=3), "M1", "M2")


def lights(net: Path, motorway: str) -> Path:
    """The same network, whose lights show these states to the motorway in two phases."""
    text = net.read_text()
    links = re.findall(r'<connection from="M1"[^>]*linkIndex="(\d+)"', text)
    every = [str(link) for link in range(len(re.findall(r'linkIndex="\d+"', text)))]
    phases = ""
    for state in motorway:
        shown = "".join(state if link in links else "r" for link in every)
        phases += f'<phase duration="30" state="{shown}"/>'
    net.write_text(re.sub(r"(<tlLogic[^>]*>).*?(</tlLogic>)", rf"\1{phases}\2", text, flags=re.S))
    return net


def test_the_motorway_is_driven_past_a_ramp_meter(tmp_path: Path) -> None:
    net = lights(meeting(tmp_path, "traffic_light"), "GG")
    description = described(net, "M1", "M2")
    assert description.leaves_out == (
        "1 road that joins it, with its traffic",
        "the traffic lights of junction 'b' at the end of edge 'M1', which always let the route "
        "pass",
    )
    with pytest.raises(ScenarioError, match=r"has traffic lights that stop the route: choose"):
        described(lights(net, "Gr"), "M1", "M2")


WEAVING = (
    *("M1 0 M2 1", "M1 1 M2 2", "M1 2 M2 3", "on 0 M2 0"),
    *("M2 1 M3 0", "M2 2 M3 1", "M2 3 M3 2", "M2 0 off 0"),
)


def weaving(folder: Path) -> Path:
    nodes = node("a", 0, 0) + node("b", 700, 0) + node("c", 1000, 0) + node("d", 2000, 0)
    nodes += node("r", 400, -100) + node("x", 1300, -100)
    motorway = (("M1", "a", "b", 3), ("M2", "b", "c", 4), ("M3", "c", "d", 3))
    edges = "".join(edge(*each, 36, 'priority="9"') for each in motorway)
    ramps = (("on", "r", "b"), ("off", "c", "x"))
    edges += "".join(edge(*each, 1, 22, 'priority="5"') for each in ramps)
    return converted(folder, nodes, edges, WEAVING)


def test_the_motorway_is_never_taken_for_an_exit(tmp_path: Path) -> None:
    net = weaving(tmp_path)
    with pytest.raises(
        ScenarioError,
        match=r"goes on along the motorway from edge 'M2' to edge 'M3', but the lanes in which it "
        r"begins lead elsewhere: begin it on the motorway, not on a ramp, or end it on edge 'M2'",
    ):
        described(net, "on", "M3")
    exits = described(net, "M1", "off")
    assert exits.plan().road.exit_m == pytest.approx(1030.0, abs=10.0)
    assert described(net, "M1", "M3").plan().road.exit_m == float("inf")


def test_the_roads_that_join_and_leave_a_route_are_left_out_by_their_number(tmp_path: Path) -> None:
    net = weaving(tmp_path)
    joins = "1 road that joins it, with its traffic"
    whole, both = described(net, "M1", "M3"), "1 road that joins it and 1 road that leaves it"
    assert whole.leaves_out == (f"{both}, with their traffic",)
    assert whole.summary.endswith(f"\nLeft out: {whole.leaves_out[0]}.")
    # where the route leaves the motorway, that goes on
    leaving, *others = described(net, "M1", "off").leaves_out
    assert (leaving, "behind the exit" in others[0], len(others)) == (joins, True, 1)
    assert described(net, "M2", "M3").leaves_out == ("1 road that leaves it, with its traffic",)
    turning = re.sub(r'(<connection from="M2" to="off" [^>]*dir=)"."', r'\1"t"', net.read_text())
    net.write_text(turning)
    assert described(net, "M1", "M3").leaves_out == (joins,)


def test_traffic_on_the_left_is_driven_in_the_mirror(tmp_path: Path) -> None:
    middle = '<lane index="1" changeLeft="bus"/>'
    net = chain(tmp_path, Part(3), Part(3, lane=middle), options=["--lefthand", "true"])
    description = along(net, 1)
    [line] = description.plan().road.forbidden_lines
    assert (line.lane, line.side) == (1, -1)  # SUMO's left is towards lane 0
    [phrase] = description.leaves_out
    assert phrase == "that its traffic drives on the left: the road is its mirror image"
    shape = description.plan().edges[-2].shape
    assert shape[-1][1] < shape[0][1]  # the network bends to the left
    kept(description, tmp_path)


@pytest.mark.parametrize("encoding", ["iso-8859-1", "utf-16", "utf-8-sig", "windows-1252"])
def test_a_network_is_read_in_the_encoding_that_it_declares(encoding: str, tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2), Part(2))
    text = net.read_text().replace('<edge id="e0"', '<edge name="S\u00fcdring" id="e0"', 1)
    declared = text.replace('encoding="UTF-8"', f'encoding="{encoding.removesuffix("-sig")}"', 1)
    net.write_bytes(declared.encode(encoding))
    assert along(net, 1).lanes == 2


def test_a_projection_and_heights_are_left_out_by_name(tmp_path: Path) -> None:
    road = edge("L", "a", "b", 2, 30)
    level = converted(tmp_path, node("a", 0, 0) + node("b", 900, 0), road, None)
    assert described(level, "L", "L").leaves_out == ()
    hill = converted(tmp_path, node("a", 0, 0) + node("b", 900, 0, 'z="20"'), road, None)
    replace_in(hill, 'projParameter="!"', 'projParameter="+proj=utm +zone=32"')
    assert described(hill, "L", "L").leaves_out == (
        "its projection: SUMO's outputs have no longitudes and latitudes",
        "its heights: the road is level",
    )


def test_what_was_made_of_a_route_is_said_by_the_verbs_and_kept_in_the_folder(
    tmp_path: Path, capsys: Capsys
) -> None:
    net = chain(tmp_path, Part(3), Part(2), ways=["e0 1 e1 0", "e0 2 e1 1"])
    replace_in(net, 'id="e0_0" ', 'id="e0_0" friction="0.50" ')
    description = along(net, 1)
    length_m, summary = description.way.end_m, description.summary
    assert summary == (
        f"The road: {length_m:.0f} m from edge 'e0' on, 2 to 3 lanes of 3.5 m, limits 40 m/s; no "
        "exit; lanes that begin: 0, and that end: 1.\nLeft out: friction 0.50 of lane 'e0_0'."
    )
    words = ["--kind", "imported", "--net", str(net), "--from-edge", "e0", "--to-edge", "e1"]
    assert main(["scenario", str(tmp_path / "road"), *words]) == 0
    assert summary in capsys.readouterr().out
    assert read_description(tmp_path / "road" / "scenario.toml").summary == summary
    again = ["evaluate", "--driver", "idm", "--episodes", "1", "--vehicles", "1", "--scenario"]
    assert main([*again, str(tmp_path / "road")]) == 0
    assert summary in capsys.readouterr().err
    assert main([*again, "circular_three_lane"]) == 0
    assert "The road:" not in capsys.readouterr().err


def test_a_long_edge_that_bends_is_divided_like_a_straight_one(tmp_path: Path) -> None:
    net = drawn(tmp_path, (0, 0), (2500, 100), (6000, 900))
    description = described(net, "C", "C")
    edges = [each for each in description.plan().edges if "beyond" not in each.id]
    assert max(each.end_m - each.begin_m for each in edges) <= 401.0
    assert [each.id for each in edges[:3]] == ["C", "C.1", "C.2"]
    # each piece begins where the one before ends, also in the picture
    for one, other in pairwise(edges):
        assert (one.end_m, one.shape[-1]) == (other.begin_m, pytest.approx(other.shape[0]))
    assert (2500.0, 100.0) in [point for each in edges for point in each.shape]
    kept(description, tmp_path)


@pytest.mark.parametrize(
    ("names", "taken"),
    [
        (("L", "L.1"), "L.1"),  # 2,500 m are divided into L, L.1, ..., L.6
        (("L", "L.6"), "L.6"),
        (("L.6.beyond", "L"), "L.6.beyond"),  # the road that is added behind the route
        (("L", "L.7"), ""),
        (("L.1", "L"), "L.1"),
    ],
)
def test_an_edge_with_the_name_of_a_piece_is_refused(
    names: tuple[str, str], taken: str, tmp_path: Path
) -> None:
    nodes = node("a", 0, 0) + node("b", 2500, 0) + node("c", 5000, 0)
    roads = edge(names[0], "a", "b", 2, 36) + edge(names[1], "b", "c", 2, 36)
    net = converted(tmp_path, nodes, roads, None)
    if not taken:
        kept(described(net, *names), tmp_path)
        return
    with pytest.raises(
        ScenarioError,
        match=rf"own.net.xml: the route has an edge '{taken}', but drl-av gives this name to "
        r"another part of the road: rename the edge in netedit\.$",
    ):
        described(net, *names)
