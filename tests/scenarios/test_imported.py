"""Roads from a user's own network: what is read from it, what is driven, and what is refused."""

import gzip
import math
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from nets import A10, EAST, WEST, Part, along, chain, east, ways_of
from plain_sumo import run_sumo, states
from runs import Capsys, files_of, refused_scenario, replace_in

from drl_av.cli import main
from drl_av.errors import ScenarioError
from drl_av.road.road import OPEN_LAP_M, PartialLane
from drl_av.scenarios.folder import load_scenario, read_description, write_scenario
from drl_av.scenarios.imported import route
from drl_av.scenarios.imported.description import ImportedDescription
from drl_av.scenarios.road_description import PlacedVehicle

ENDLESS = math.inf


@pytest.fixture(scope="module")
def a10(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the A 10 as the command line writes it."""
    folder = tmp_path_factory.mktemp("imported") / "a10"
    words = ["--kind", "imported", "--net", str(A10), "--from-edge", EAST[0], "--to-edge", EAST[1]]
    assert main(["scenario", str(folder), *words]) == 0
    return folder


def lanes_of(description: ImportedDescription) -> list[PartialLane]:
    return [*description.plan().road.partial_lanes]


def part(lane: int, begin_m: float, end_m: float) -> PartialLane:
    return PartialLane(lane, *[pytest.approx(begin_m, abs=0.02), pytest.approx(end_m)] * 2)


def test_a_motorway_from_openstreetmap_is_one_road_whose_right_lane_comes_and_goes(
    a10: Path,
) -> None:
    layout = load_scenario(a10).layout
    road, start = layout.road, layout.start
    # SUMO's lengths of each edge and of the lanes inside the junction after it
    first, second, third, fourth = 1194.87 + 8.20, 137.39 + 3.20, 226.05 + 3.24, 192.89 + 7.96
    leaves, joins = first + second, first + second + third
    assert road.end_m == pytest.approx(joins + fourth + 992.68)
    assert road.partial_lanes == (
        part(0, first, leaves),  # beside the three lanes to the exit
        part(0, joins, joins + fourth),  # from the on-ramp
    )
    assert (road.lane_width_m, len(road.open_lanes)) == (3.2, 4)
    assert layout.lane_positions["264306385_0"] == (1, 0.0)
    assert layout.lane_positions["264308375_0"] == (0, first)
    assert layout.lane_positions["264308376_2"] == (3, pytest.approx(joins + fourth))
    assert (start.lanes, start.ego_lane, start.ego_front_m) == ((1, 2, 3), None, 300.0)
    assert start.speed_limits == road.speed_limits[1] == ((0.0, OPEN_LAP_M, 27.78),)


def test_the_road_is_drawn_where_the_motorway_lies(a10: Path) -> None:
    there, drawn = (ET.parse(file).getroot() for file in (A10, a10 / "highway.net.xml"))

    def middle(net: ET.Element) -> list[float]:
        lane = next(lane for lane in net.iter("lane") if lane.get("id") == "264308376_1")
        return [float(number) for number in lane.attrib["shape"].split()[6].split(",")]

    assert middle(drawn) == pytest.approx(middle(there), abs=0.02)


def test_plain_sumo_drives_the_same_distance_with_and_without_the_lanes_inside_junctions(
    a10: Path, tmp_path: Path
) -> None:
    routes, driven = tmp_path / "one.rou.xml", []
    way = "264306385 264308375 264308383 4054057 264308376"
    routes.write_text(
        f'<routes><vehicle id="x" depart="0" departPos="0" departLane="1" departSpeed="20">'
        f'<route edges="{way}"/></vehicle></routes>'
    )
    for net in (A10, a10 / "highway.net.xml"):
        trips = tmp_path / "trips.xml"
        run_sumo("-n", net, "-r", routes, "--tripinfo-output", trips)
        driven += [float(trip.attrib["routeLength"]) for trip in ET.parse(trips).iter("tripinfo")]
    assert driven == pytest.approx([2766.48, 2766.48], abs=0.1)


def test_plain_sumo_opens_the_road_and_obeys_its_speed_limit(a10: Path) -> None:
    vehicles = [vehicle.attrib for moment in states(a10, 300) for vehicle in moment]
    assert "ego" in {vehicle["id"] for vehicle in vehicles}
    assert len({vehicle["id"] for vehicle in vehicles}) > 100
    assert {vehicle["lane"].rpartition("_")[0] for vehicle in vehicles} >= {"264308376.beyond"}
    assert 25.0 < max(float(vehicle["speed"]) for vehicle in vehicles) <= 27.78


def test_what_is_written_reads_back_equal_and_to_the_same_bytes(a10: Path, tmp_path: Path) -> None:
    scenario = load_scenario(a10)
    assert scenario.as_written
    write_scenario(tmp_path / "again", scenario.description)
    assert files_of(tmp_path / "again") == files_of(a10)
    text = (a10 / "scenario.toml").read_text()
    assert text.startswith('kind = "imported"\n')
    assert 'net = "highway.net.xml"' in text
    assert "lane_width_m" not in text  # it is the network's
    (a10 / "own.toml").write_text(re.sub(r"(?s)left_out = .*?\]", "left_out = 5", text))
    with pytest.raises(ScenarioError, match="left_out is 5, but must be a list of texts"):
        read_description(a10 / "own.toml")


def test_a_toml_file_names_the_net_beside_it_and_options_change_the_rest(tmp_path: Path) -> None:
    (tmp_path / "roads").mkdir()
    (tmp_path / "roads" / "own.net.xml").write_bytes(A10.read_bytes())
    (tmp_path / "roads" / "road.toml").write_text(
        f'kind = "imported"\nnet = "own.net.xml"\nfrom_edge = "{WEST[0]}"\nto_edge = "{WEST[1]}"\n'
        '[[vehicle_types]]\nid = "van"\nshare = 0.5\nlength_m = 7\nwidth_m = 2.2\n'
    )
    words = ["--from", str(tmp_path / "roads" / "road.toml"), "--lowest-limit-m-s", "36"]
    assert main(["scenario", str(tmp_path / "west"), *words]) == 0
    west: Any = load_scenario(tmp_path / "west").description
    assert (west.speed_limit_m_s, west.vehicle_length_m, west.lanes) == (36.0, 7.0, 4)
    assert main(["scenario", str(tmp_path / "busy"), "--from", str(tmp_path / "west"),
                 "--flow-per-h", "1500"]) == 0  # fmt: skip
    busy: Any = read_description(tmp_path / "busy" / "scenario.toml")
    assert (busy.flow_per_h, busy.speed_limit_m_s, busy.from_edge) == (1500.0, 36.0, WEST[0])


THREE = (Part(3), Part(2), Part(3))


@pytest.mark.parametrize(
    ("parts", "ways", "lanes", "found", "left_out"),
    [
        pytest.param(
            *(THREE, "e0 1 e1 0, e0 2 e1 1, e1 0 e2 0, e1 1 e2 1"),
            *(3 + 1, [(0, 0, 1), (3, 2, ENDLESS)], ""),
            id="the right lane ends, and later one begins on the left",
        ),
        pytest.param(
            *(THREE, "e0 0 e1 0, e0 1 e1 1, e1 0 e2 1, e1 1 e2 2"),
            *(3 + 1, [(3, 0, 1), (0, 2, ENDLESS)], ""),
            id="the left lane ends, and later one begins on the right",
        ),
        pytest.param(
            *(THREE[:2], "e0 0 e1 0, e0 1 e1 0, e0 2 e1 1"),
            *(3, [(0, 0, 1)], "e0 0 e1 0"),
            id="of two lanes that merge in a junction, the one that lies straight goes on",
        ),
        pytest.param(
            *((Part(2), Part(3)), "e0 0 e1 0, e0 0 e1 1, e0 1 e1 2"),
            *(3, [(0, 1, ENDLESS)], "e0 0 e1 0"),
            id="a lane that leads to two lanes keeps its place beside the others",
        ),
        pytest.param(
            *((Part(3), Part(3)), "e0 1 e1 1, e0 2 e1 2"),
            *(3, [(0, 0, 1), (0, 1, ENDLESS)], ""),
            id="where a lane ends, another may begin, but none leads on",
        ),
        pytest.param(
            *((Part(5), Part(3), Part(2)), "e0 2 e1 0, e0 3 e1 1, e0 4 e1 2, e1 0 e2 0, e1 1 e2 1"),
            *(5, [(0, 0, 1), (1, 0, 1), (4, 0, 2)], ""),
            id="two lanes end together on the right, and one on the left",
        ),
    ],
)
def test_the_connections_say_which_lanes_lead_on(
    parts: Sequence[Part],
    ways: str,
    lanes: int,
    found: list[tuple[int, float, float]],
    left_out: str,
    tmp_path: Path,
) -> None:
    given = ways.split(", ")
    description = along(chain(tmp_path, *parts, ways=given), len(parts) - 1)
    cuts = [0.0, *(section.end_m for section in description.route.sections)]
    places = dict(enumerate(cuts)) | {ENDLESS: ENDLESS}
    assert description.lanes == lanes
    assert lanes_of(description) == [
        part(lane, places[begin], places[end]) for lane, begin, end in found
    ]
    write_scenario(tmp_path / "road", description)
    kept = {way for way in ways_of(tmp_path / "road") if "beyond" not in way}
    assert kept == {*given} - {left_out}
    assert load_scenario(tmp_path / "road").road == description.plan().road


def test_each_edge_keeps_its_speed_limit_unless_it_is_raised(tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2, 36.0), Part(2, 22.0), Part(2, 30.0))
    for lowest, limits in ((1.0, [36.0, 22.0, 30.0, 30.0]), (25.0, [36.0, 25.0, 30.0, 30.0])):
        description = along(net, 2, lowest_limit_m_s=lowest)
        assert [min(edge.lane_limits_m_s) for edge in description.plan().edges] == limits
        assert description.speed_limit_m_s == max(22.0, lowest)


def test_vehicles_are_placed_on_an_imported_road(tmp_path: Path) -> None:
    ego = PlacedVehicle("ego", 0, 1250.0, 20.0, 25.0)
    write_scenario(tmp_path / "placed", east(vehicles=(ego,)))
    assert load_scenario(tmp_path / "placed").description.vehicles == (ego,)
    with pytest.raises(ScenarioError, match="lane 0 at 1400 m, but must be on a lane open there"):
        east(vehicles=(PlacedVehicle("ego", 0, 1400.0, 20.0, 25.0),))


def test_in_plain_sumo_placed_vehicles_keep_each_limit_and_their_desired_speeds(
    tmp_path: Path,
) -> None:
    wanted = {"ego": 30.0, "slow": 24.0}
    placed = [PlacedVehicle(name, 0, 900 - v, 20.0, v) for name, v in wanted.items()]
    net = chain(tmp_path, Part(2, 36.0), Part(2, 22.0), Part(2, 34.0), Part(2, 34.0))
    write_scenario(tmp_path / "placed", along(net, 3, vehicles=placed, sideways_m_s2=1e4))
    seen = [vehicle.attrib for moment in states(tmp_path / "placed", 60) for vehicle in moment]
    for name, speed in wanted.items():
        own = [float(each["speed"]) for each in seen if each["id"] == name]
        assert max(own) == pytest.approx(speed, abs=0.1)
    slow = [float(each["speed"]) for each in seen if each["lane"].startswith("e1")]
    assert 21.0 < max(slow) <= 22.0


SIDE = '<node id="s" x="500" y="{y}"/><node id="t" x="500" y="{z}"/>'
ACROSS = (
    '<edge id="across" from="s" to="n1" priority="{p}"/>'
    '<edge id="away" from="n1" to="t" priority="{p}"/>'
)


def test_a_crossing_on_which_the_route_has_priority_is_driven_straight_on(tmp_path: Path) -> None:
    crossing = {"nodes": SIDE.format(y=-300, z=400), "edges": ACROSS.format(p=1)}
    description = along(chain(tmp_path, Part(2), Part(2), **crossing), 1)
    assert [edge.id for edge in description.plan().edges] == ["e0", "e1", "e1.beyond"]
    assert lanes_of(description) == []


def refused(capsys: Capsys, folder: Path, net: Path, *words: str, ends: str = "e0 e1") -> str:
    """The sentence with which the command line refuses a network."""
    first, last = ends.split()
    given = ["--net", str(net), f"--from-edge={first}", f"--to-edge={last}", *words]
    line = refused_scenario(capsys, folder, "--kind", "imported", *given)
    assert str(net) in line or words
    return line


@pytest.mark.parametrize(
    ("parts", "given", "reason"),
    [
        ([Part(2), Part(2, width_m=3.2)], {}, r"'e0_0' is 3.5 m wide and lane 'e1_0' 3.2 m, but"),
        ([Part(2, width_m=1.9)] * 2, {}, r"has lane_width_m 1.9, but must have 2 to 10: change"),
        ([Part(2, 101.0)] * 2, {}, r"has speed_limit_m_s 101, but must have 1 to 100"),
        ([Part(11)] * 2, {}, r"has lanes 11, but must have 1 to 10"),
        (
            [Part(3), Part(3, lane='<lane index="1" disallow="passenger"/>')],
            {},
            r"lane 'e1_1' is closed to passenger cars and lies between lanes that are open: change",
        ),
        (
            [Part(3), Part(3)],
            {"ways": ["e0 0 e1 0", "e0 2 e1 2"]},
            r"between lanes of edge 'e0' that lead on to edge 'e1' lies one that does not: connect",
        ),
        (
            [Part(1), Part(2), Part(1)],
            {"ways": ["e0 0 e1 0", "e1 1 e2 0"]},
            r"no lane that leads along all of it, only up to the end of edge 'e1' at 10\d\d m: end",
        ),
        (
            [Part(2), Part(2)],
            {"kind": "traffic_light", "nodes": SIDE.format(y=-300, z=400)}
            | {"edges": ACROSS.format(p=1)},
            r"junction 'n1' at the end of edge 'e0' has traffic lights that stop the route",
        ),
        (
            [Part(2), Part(2)],
            {"nodes": SIDE.format(y=-300, z=400), "edges": ACROSS.format(p=12)},
            r"gives way at junction 'n1' at the end of edge 'e0', but traffic from elsewhere is",
        ),
    ],
)
def test_a_road_that_cannot_be_driven_is_refused_in_one_sentence(
    parts: list[Part], given: dict[str, Any], reason: str, tmp_path: Path, capsys: Capsys
) -> None:
    net = chain(tmp_path, *parts, **given)
    line = refused(capsys, tmp_path, net, ends=f"e0 e{len(parts) - 1}")
    assert re.search(reason, line)


def test_one_lane_that_leads_along_all_of_the_route_is_enough(tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2), Part(1), Part(2), ways=["e0 0 e1 0", "e1 0 e2 0"])
    assert along(net, 2).plan().start.lanes == (0,)


ALONG = " ".join(EAST)


@pytest.mark.parametrize(
    ("ends", "words", "reason"),
    [
        (
            *("264306385 264308367", ""),
            r"no edge '264308367' \(did you mean '26430837\d'\?\): name an",
        ),
        (":9671124_0 264308376", "", r"there is no edge ':9671124_0'"),
        ("264308376 264306385", "", r"no way leads cars from edge '264308376' to edge '264306385'"),
        ("264306385 264308373", "", r"name two edges of one carriageway, the first one first"),
        ("24498409 264308376", "", r"no lane that leads along all of it"),  # from the on-ramp
        ("264308375 4054057", "", r"the route is 563 m long, but must be 600 to 50000 m: name"),
        (ALONG, "--vehicle-width-m 3.3", r"must be at most lane_width_m, 3.2"),
        (ALONG, "--flow-per-h 2500", r"flow_per_h is 2500.0, but must be"),
        (
            *(ALONG, "--flow-per-h 2400 --vehicle-length-m 9"),
            r"flow_per_h is 2400, but at 20 m/s a lane takes at most 2149: lower it",
        ),
        (ALONG, "--lanes 2", r"kind imported has no --lanes: leave it out"),
        (ALONG, "--lane-width-m 4", r"imported has no --lane-width-m"),
    ],
)
def test_a_route_that_is_not_there_and_settings_that_do_not_fit_are_refused(
    ends: str, words: str, reason: str, tmp_path: Path, capsys: Capsys
) -> None:
    line = refused(capsys, tmp_path, A10, *words.split(), ends=ends)
    assert re.search(reason, line)


def test_a_road_that_is_too_slow_for_the_flow_is_refused(tmp_path: Path) -> None:
    slow = chain(tmp_path, Part(2), Part(2, 5.0))
    # 5 m and 2.5 m and 1.1 s at 5 m/s: 13 m for each vehicle
    with pytest.raises(ScenarioError, match=r"at 5 m/s a lane takes at most 1384: lower it"):
        along(slow, 1, flow_per_h=1400.0)
    assert along(slow, 1, flow_per_h=1384.0).flow_per_h == 1384.0


BOMB = '<!DOCTYPE net [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
LENGTH = 'length="1194.87"'


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("(.{20000}).*", r"\1", r"is damaged or cut short .*: name a network file that netedit"),
        ("<net ", BOMB + "<net ", r"it declares a document type"),
        (".*", "<osm/>", r"it is no network of SUMO, but has an element <osm>: name a"),
        ("<location", "<net/><location", r"has an element <net>"),
        ("<location", "<a>" * 9 + "</a>" * 9 + "<location", r"9? ?deep"),
        (LENGTH, 'length="nan"', r"has length 'nan': name a"),
        (LENGTH, 'length="-5"', r"has length '-5'"),
        (LENGTH, 'length="x"', r"float: 'x'"),
        (
            *(LENGTH, 'length="1180.00"'),
            r"lanes of edge '264306385' are 1180 to 1194.87 m long, but must be equally long",
        ),
        (
            *('<lane id="264306385_0".*?>', '<lane id="264306385_0" index="0"/>'),
            r"its <lane> lacks or misstates 'speed'",
        ),
        (
            *("330.80,3159.89", "9e9,3159.89"),
            r"shape of edge '264306385' has a coordinate beyond 10000 km: write the network again",
        ),
        ('<lane id="264306385_2"[^>]* shape="', r"\g<0>nan,0 ", r"a lane has the point 'nan,0'"),
        ('encoding="UTF-8"', 'encoding="klingon"', r"that Python does not know .*klingon"),
        ('via=":2699976596_0_2"', 'via=":nowhere_0"', r"lacks or misstates .*nowhere"),
        ('version="1.20"', "", r"its <net> lacks or misstates 'version'"),
    ],
)
def test_a_file_that_is_no_sound_network_is_refused_in_one_sentence(
    old: str, new: str, reason: str, tmp_path: Path, capsys: Capsys
) -> None:
    spoilt, count = re.subn(old, new, A10.read_text(encoding="utf-8"), count=1, flags=re.DOTALL)
    assert count
    (tmp_path / "own.net.xml").write_text(spoilt, encoding="utf-8")
    line = refused(capsys, tmp_path, tmp_path / "own.net.xml", ends=ALONG)
    assert re.search(reason, line)


def test_absurd_routes_and_names_are_refused(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    net = chain(tmp_path, Part(2), Part(2), Part(2))
    net.write_text(net.read_text().replace('"e0"', '"e 0"').replace('"e0_', '"e 0_'))
    given = ["--kind", "imported", "--net", str(net), "--from-edge", "e 0", "--to-edge", "e2"]
    line = refused_scenario(capsys, tmp_path, *given)
    assert "netconvert cannot build this road: Error: Invalid edge id" in line
    monkeypatch.setattr(route, "MOST_EDGES", 4)
    line = refused(capsys, tmp_path, A10, ends=ALONG)
    assert "the route has 5 edges, but may have 4: join them by netconvert" in line


def test_files_that_are_no_text_of_xml_are_refused(tmp_path: Path, capsys: Capsys) -> None:
    net = tmp_path / "own.net.xml"
    assert f"{net} is missing: name a network file" in refused(capsys, tmp_path, net)
    net.write_bytes(gzip.compress(A10.read_bytes()))
    assert f"{net} is compressed: unpack it with gunzip" in refused(capsys, tmp_path, net)
    with net.open("wb") as file:
        file.truncate(64_000_001)
    line = refused(capsys, tmp_path, net)
    assert f"{net} is larger than 64 MB: cut out the part with your route by netconvert" in line
    assert "is no regular file" in refused(capsys, tmp_path, tmp_path)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"net": ""}, r"net is '', but a scenario of the kind imported needs net, the path of a"),
        ({"from_edge": ""}, r"from_edge is ''"),
        ({"to_edge": 264308376}, r"to_edge is 264308376, but"),
        ({"lowest_limit_m_s": 0.5}, r"lowest_limit_m_s is 0.5, but must be a number from 1 to 100"),
    ],
)
def test_missing_and_wrong_settings_are_refused(changed: dict[str, Any], reason: str) -> None:
    with pytest.raises(ScenarioError, match=reason):
        east(**changed)


MORE = '<edge id="x" from="n0" to="n1"><lane id="x_0" index="0" speed="9" length="9"/></edge>'


@pytest.mark.parametrize(
    ("name", "old", "new", "reason"),
    [
        (
            *("scenario.toml", 'net = "highway.net.xml"', f'net = "{A10}"'),
            r"net of the scenario is .*a10.net.xml, but must be",
        ),
        ("scenario.toml", EAST[0], "5", r"there is no edge '5'"),
        (
            *("highway.net.xml", "</net>", f"{MORE}</net>"),
            r"has other lanes than described, one is 'x_0'",
        ),
        (
            *("highway.net.xml", 'id="264308375_0"', 'id="264308375_0" disallow="bus"'),
            r"has disallow 'bus' on lane '264308375_0', not None",
        ),
        (
            *("highway.net.xml", "</net>", '<tlLogic id="x"/></net>'),
            r"it has an element <tlLogic>, which no scenario needs",
        ),
    ],
)
def test_the_folder_of_another_person_is_checked_before_sumo_opens_it(
    name: str, old: str, new: str, reason: str, a10: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(a10, tmp_path / "road"))
    (folder / "SHA256SUMS").unlink()
    replace_in(folder / name, old, new)
    with pytest.raises(ScenarioError, match=reason):
        load_scenario(folder)


def test_the_network_of_a_written_scenario_is_made_by_writing_the_scenario_again(
    a10: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(a10, tmp_path / "road"))
    net = folder / "highway.net.xml"
    again = "write the scenario again with: drl-av scenario DIR"
    net.write_text(net.read_text()[:2000])
    with pytest.raises(ScenarioError, match=rf"highway.net.xml is damaged or cut .*: {again}"):
        load_scenario(folder)
    net.unlink()
    with pytest.raises(ScenarioError, match=f"highway.net.xml is missing: {again}"):
        load_scenario(folder)
    with pytest.raises(ScenarioError, match=r"highway.net.xml is missing: name a network file"):
        east(net=str(net))
