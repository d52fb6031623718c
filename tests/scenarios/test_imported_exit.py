"""Roads from a user's network that the route leaves by a lane which begins on the way."""

import math
import re
from collections.abc import Sequence
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest
from nets import LEAVING_WAYS, TWO_LANES, TWO_LANES_WAYS, along, converted, east, leaving, ways_of
from plain_sumo import trips
from runs import Capsys, files_of, refused_scenario, replace_in
from worlds import scene

from drl_av.cli import main
from drl_av.errors import ScenarioError
from drl_av.road.road import (
    OPEN_LAP_M,
    PartialLane,
    Road,
    holds,
    is_beside,
    is_open_at,
    mandatory_change,
)
from drl_av.scenarios.folder import load_scenario, write_scenario
from drl_av.scenarios.imported.description import ImportedDescription
from drl_av.scenarios.layout import along as along_line
from drl_av.scenarios.open_road import BEYOND_M

BEGINS_M, EXIT_M = 1004.0, 1280.65
"""Where the exit's lane begins and parts: SUMO's lengths of e0 and e1 and of the lanes after them.

e0 has 996 m and 8 m in the junction after it, e1 273.06 m and 3.59 m.
"""


def off(net: Path, to_edge: str = "away", **changed: object) -> ImportedDescription:
    """The route that leaves the motorway."""
    return along(net, 0, to_edge=to_edge, **changed)


@pytest.fixture(scope="module")
def net(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return leaving(tmp_path_factory.mktemp("leaving"))


@pytest.fixture(scope="module")
def folder(net: Path) -> Path:
    """The scenario's folder as the command line writes it."""
    words = ["--kind", "imported", "--net", str(net), "--from-edge", "e0", "--to-edge", "away"]
    assert main(["scenario", str(net.parent / "road"), *words]) == 0
    return net.parent / "road"


@pytest.fixture(scope="module")
def road(folder: Path) -> Road:
    return load_scenario(folder).road


def test_the_lane_of_the_exit_begins_on_the_way_and_parts_at_the_exit(folder: Path) -> None:
    layout = load_scenario(folder).layout
    road, start = layout.road, layout.start
    assert road.partial_lanes == (PartialLane(0, BEGINS_M, math.inf, BEGINS_M, EXIT_M),)
    assert (road.exit_m, road.exit_lane, road.end_m) == (EXIT_M, 0, EXIT_M + 100.0)
    assert layout.routes == {"through": ("e0", "e1", "e1.through"), "exit": ("e0", "e1", "off")}
    assert layout.lane_positions["e0_0"] == (1, 0.0)
    assert layout.lane_positions["e1_0"] == (0, BEGINS_M)
    assert layout.lane_positions["off_0"] == (0, EXIT_M)
    assert layout.lane_positions["e1.through_0"] == (1, EXIT_M)
    assert (start.lanes, start.ego_lane, start.ego_front_m) == ((1, 2, 3), None, 300.0)
    assert start.span_m == EXIT_M + 100.0 + BEYOND_M
    assert start.speed_limits == ((0.0, BEGINS_M, 40.0), (BEGINS_M, OPEN_LAP_M, 36.0))
    # the exit's lane begins beside e1 and leads to off
    assert road.speed_limits[0] == ((BEGINS_M, EXIT_M, 36.0), (EXIT_M, OPEN_LAP_M, 32.0))
    assert road.speed_limits[3] == start.speed_limits
    # the lowest limit is that of off, 32 m/s; no vehicle drives on away, where 10 m/s are allowed
    assert load_scenario(folder).description.speed_limit_m_s == 32.0


@pytest.mark.parametrize(
    ("lane", "s_m", "change", "there", "beside"),
    [
        (3, 300.0, (-3, 980.65), False, False),
        (1, 900.0, (-1, 380.65), False, False),  # beside the lane to come, which it cannot enter
        (1, 1003.9, (-1, 276.75), False, False),
        (1, 1004.0, (-1, 276.65), True, True),
        (2, 1100.0, (-2, 180.65), True, True),
        (1, 1280.6, (-1, 0.05), True, True),
        (1, 1280.65, (0, math.inf), True, False),  # the off-ramp has parted: a missed exit
        (0, 1100.0, (0, math.inf), True, True),
    ],
)
def test_the_way_leads_beside_the_lane_to_come_and_then_into_it(
    lane: int, s_m: float, change: tuple[int, float], there: bool, beside: bool, road: Road
) -> None:
    assert mandatory_change(lane, s_m, road) == (change[0], pytest.approx(change[1]))
    assert is_open_at(0, s_m, road) is there
    assert is_beside(1, 0, s_m, road) is beside


@pytest.mark.parametrize(
    ("s_m", "there"),
    [(900.0, False), (1003.9, False), (1004.1, True), (1278.1, True), (1279, False)],
)
def test_the_ego_sees_no_lane_to_its_right_before_it_begins_and_after_it_has_parted(
    s_m: float, there: bool, road: Road
) -> None:
    found = scene(s_m=s_m, y_m=3.5, road=road)  # its front is 2.5 m ahead
    assert found.affordances.right_lane is there
    gaps_m = found.indicators.values[[8, 12]].tolist()
    assert gaps_m == ([250.0, 250.0] if there else [0.0, 0.0])  # a lane that is absent is a wall


def test_a_body_is_not_held_by_the_lane_before_it_begins(road: Road) -> None:
    # 0.9 m to each side of 2 m: 0.65 m over the line between the lanes at 1.75 m
    assert [holds(2.0, 1.8, s_m, road) for s_m in (1003.9, 1004.1, 1280.6, 1280.7)] == [
        *(False, True, True, False)
    ]


def test_what_is_written_reads_back_to_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    scenario = load_scenario(folder)
    assert scenario.as_written
    write_scenario(tmp_path / "again", scenario.description)
    assert files_of(tmp_path / "again") == files_of(folder)
    # of the edges after the exit the folder has the first one
    assert 'to_edge = "off"' in (folder / "scenario.toml").read_text()
    assert ways_of(folder) == {
        *LEAVING_WAYS[:4],
        *("e1 1 e1.through 0", "e1 2 e1.through 1", "e1 3 e1.through 2"),
    }


def test_in_plain_sumo_the_ego_leaves_and_all_others_go_straight_on(folder: Path) -> None:
    ended = {trip["id"]: trip["arrivalLane"] for trip in trips(folder, 300)}
    assert ended.pop("ego") == "off_0"
    assert set(ended.values()) == {f"e1.through_{lane}" for lane in range(3)}


def test_a_route_straight_on_passes_the_lane_of_the_exit(net: Path) -> None:
    description = off(net, "e2")
    road = description.plan().road
    end_m = pytest.approx(1004.0 + 273.06 + 3.61)  # straight through the junction
    assert road.partial_lanes == (PartialLane(0, BEGINS_M, end_m, BEGINS_M, end_m),)
    assert (road.exit_m, description.to_edge) == (math.inf, "e2")
    assert mandatory_change(1, 900.0, road) == (0, math.inf)
    assert mandatory_change(0, 1100.0, road) == (1, pytest.approx(180.67))
    assert not any("off" in route for route in description.plan().routes.values())


def test_the_exits_of_a_motorway_from_openstreetmap_are_driven() -> None:
    # the lane of 137.39 m and the junction of 3.16 m after it, which begins at 1,203.07 m
    road = east(to_edge="151495034").plan().road
    exit_m = pytest.approx(1343.62)
    assert road.partial_lanes == (PartialLane(0, 1203.07, math.inf, 1203.07, exit_m),)
    assert road.exit_m == exit_m


def test_an_exit_may_have_two_lanes_of_which_the_ego_takes_the_nearer_one(tmp_path: Path) -> None:
    description = off(leaving(tmp_path, ways=TWO_LANES_WAYS, lanes=TWO_LANES))
    plan = description.plan()
    road, exit_m = plan.road, plan.road.exit_m
    begins_m = description.route.sections[0].end_m
    assert road.partial_lanes == (
        PartialLane(0, begins_m, math.inf, begins_m, math.inf),  # joined to lane 1 for ever
        PartialLane(1, begins_m, math.inf, begins_m, exit_m),
    )
    assert (road.exit_lane, plan.start.lanes) == (1, (2, 3, 4))
    assert [mandatory_change(lane, 1100.0, road)[0] for lane in range(5)] == [0, 0, -1, -2, -3]
    write_scenario(tmp_path / "road", description)
    assert load_scenario(tmp_path / "road").road == road


def test_the_curve_of_an_off_ramp_limits_the_lanes_that_lead_to_it_alone(tmp_path: Path) -> None:
    # off turns by 45 degrees: chords of 36 m give 36 m / (pi / 4) = 46 m, and sqrt(5.5 x 46) = 16
    description = off(leaving(tmp_path, aside_m=-250.0))
    road = description.plan().road
    exit_lane, *through = road.speed_limits
    assert {lane[-1] for lane in through} == {(BEGINS_M, OPEN_LAP_M, 36.0)}
    limits = [limit for *_, limit in exit_lane]
    assert limits == sorted(limits, reverse=True)
    assert (limits[0], limits[-1]) == (36.0, pytest.approx(16.0, rel=0.05))
    assert exit_lane[-1].begin_m < road.exit_m
    assert "limits 16.14 to 40 m/s" in description.summary
    write_scenario(tmp_path / "road", description)
    assert load_scenario(tmp_path / "road").road == road


def test_each_edge_counts_on_which_the_ego_drives_behind_the_exit(tmp_path: Path) -> None:
    # off ends 20 m behind the exit, and away, with 10 m/s, goes on: the way has 100 m there
    description = off(leaving(tmp_path, aside_m=-5.0, ramp_m=20.0))
    exit_lane, *_ = description.plan().road.speed_limits
    assert exit_lane[-1] == (description.way.exit_m, OPEN_LAP_M, 10.0)
    assert "limits 10 to 40 m/s" in description.summary


def test_another_network_has_its_own_curves(folder: Path, tmp_path: Path) -> None:
    bent = leaving(tmp_path, aside_m=-250.0)
    words = ["scenario", str(tmp_path / "bent"), "--from", str(folder), "--net", str(bent)]
    assert main(words) == 0
    assert load_scenario(tmp_path / "bent").road == off(bent).plan().road


def test_a_bend_up_to_the_exit_limits_the_lanes_that_go_straight_on(tmp_path: Path) -> None:
    # e1 is a quarter of a circle of 100 m, and e2 goes straight on: sqrt(5.5 x 100) = 23.5 m/s
    places = [(800 + 100 * sin(pi * k / 40), 100 * (1 - cos(pi * k / 40))) for k in range(21)]
    shape = " ".join(f"{x_m:.2f},{y_m:.2f}" for x_m, y_m in places)
    nodes = '<node id="n0" x="0" y="0"/><node id="n1" x="800" y="0"/>'
    nodes += '<node id="n2" x="900" y="100"/><node id="n3" x="900" y="700"/>'
    nodes += '<node id="r1" x="950" y="400"/>'
    form = '<edge id="{}" from="{}" to="{}" numLanes="{}" speed="36" priority="9" {}/>'
    roads = (
        *(("e0", "n0", "n1", 3, ""), ("e1", "n1", "n2", 4, f'shape="{shape}"')),
        *(("e2", "n2", "n3", 3, ""), ("off", "n2", "r1", 1, "")),
    )
    edges = "".join(form.format(*each) for each in roads)
    own = converted(tmp_path, nodes, edges, LEAVING_WAYS[:7])
    plan = off(own, "off").plan()
    # also inside the junction behind e1, and on the road that is added there
    for lane in plan.road.speed_limits[1:]:
        assert lane[-1].begin_m < plan.road.exit_m - 50.0
        assert lane[-1].limit_m_s == pytest.approx(23.5, rel=0.05)


def test_a_slow_off_ramp_does_not_limit_the_flow_that_goes_straight_on(tmp_path: Path) -> None:
    own = leaving(tmp_path)
    replace_in(own, 'speed="32.00"', 'speed="5.00"', -1)
    # on off, at 5 m/s: 3600 x 5 / (5 + 2.5 + 1.1 x 5) = 1384; the others drive at 20 m/s or more:
    # 3600 x 20 / (5 + 2.5 + 1.1 x 20) = 2440
    description = off(own, flow_per_h=2400.0)
    assert (description.speed_limit_m_s, description.flow_per_h) == (5.0, 2400.0)
    with pytest.raises(ScenarioError, match=r"at 20 m/s a lane takes at most 2149: lower it"):
        off(own, flow_per_h=2400.0, vehicle_length_m=9.0)


LEFT_WAYS = (
    *("e0 0 e1 0", "e0 1 e1 1", "e0 2 e1 2", "e1 3 off 0"),
    *("e1 0 e2 0", "e1 1 e2 1", "e1 2 e2 2", "off 0 away 0"),
)
ENDING_WAYS = ("e0 0 e1 1", "e0 1 e1 2", "e0 2 e1 3", "e1 0 off 0", "off 0 away 0")


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (
            {"ways": LEFT_WAYS, "aside_m": 90.0},
            r"own.net.xml: the route leaves edge 'e1' for edge 'off' by a lane with other lanes to "
            r"its right, but an exit must be on the right: choose another route\.",
        ),
        (
            {"beside_m": 20.0},
            r"leaves edge 'e1' for edge 'off' by a lane of 4\d m, but it must have 50 m: lengthen",
        ),
        (
            {"before_m": 400.0, "beside_m": 150.0},  # 3 lane changes of 5 s at 30 m/s
            r"way to the exit is 280\.\d+ m long, but 3 lane changes .* take 450 m: .*, or begin "
            r"an imported route at least 170 m earlier\.",
        ),
        (
            {"ways": ENDING_WAYS},
            r"has no lane that leads along all of it, only up to the end of edge 'e1'",
        ),  # no exit
    ],
)
def test_an_exit_that_cannot_be_driven_is_refused_in_one_sentence(
    given: dict[str, Any], reason: str, tmp_path: Path, capsys: Capsys
) -> None:
    own = leaving(tmp_path, **given)
    words = ["--kind", "imported", "--net", str(own), "--from-edge", "e0", "--to-edge", "away"]
    assert re.search(reason, refused_scenario(capsys, tmp_path, *words))


@pytest.mark.parametrize(
    ("length_m", "line"),
    [
        *((3.0, [(0, 0), (3, 0)]), (4.0, [(0, 0), (4, 0)])),
        *((6.0, [(0, 0), (4, 0), (4, 2)]), (8.0, [(0, 0), (4, 0), (4, 3), (4, 4)])),
    ],
)
def test_a_line_is_cut_or_goes_straight_on(length_m: float, line: Sequence[Any]) -> None:
    assert along_line([(0, 0), (4, 0), (4, 0), (4, 3)], length_m) == (*line,)
