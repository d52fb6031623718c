"""Open roads as scenario folders, with the real netconvert and the real SUMO."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from nets import ways_of
from plain_sumo import states, trips
from runs import Capsys, files_of, refused_scenario, replace_in

from drl_av.cli import main
from drl_av.config import Config
from drl_av.config.section import setting
from drl_av.errors import ScenarioError
from drl_av.road.road import PartialLane
from drl_av.scenarios import road_types
from drl_av.scenarios.folder import find_scenario, load_scenario, write_scenario
from drl_av.scenarios.highways import ExitDescription, MergeDescription, StraightDescription
from drl_av.scenarios.open_road import OpenDescription, OpenPlan
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.simulation.fleet import Fleet

Written = Callable[[str], Path]
OPEN_KINDS = ("straight", "merge", "exit", "ramp_to_ramp")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """The folder of a kind of scenario as the command line writes it."""
    home = tmp_path_factory.mktemp("kinds")

    def written(kind: str) -> Path:
        if not (home / kind).exists():
            assert main(["scenario", str(home / kind), "--kind", kind]) == 0
        return home / kind

    return written


def test_merge_has_a_ramp_an_acceleration_lane_of_250_m_and_three_lanes(folder: Written) -> None:
    layout = load_scenario(folder("merge")).layout
    assert layout.road.partial_lanes == (PartialLane(0, 395.0, 750.0, 500.0, 750.0),)
    assert layout.road.end_m == 1250.0
    assert layout.lane_positions["ramp_0"] == (0, 395.0)
    assert layout.lane_positions["before_0"] == (1, 0.0)  # lane 0 is the ramp
    assert layout.lane_positions["beside_0"] == (0, 500.0)
    assert layout.lane_positions["after_2"] == (3, 750.0)
    assert layout.routes["ramp"] == ("ramp", "beside", "after")
    ways = ways_of(folder("merge"))
    assert not [way for way in ways if way.startswith("beside 0 ")]
    assert ways > {"beside 1 after 0", "ramp 0 beside 0"}


def test_exit_has_a_deceleration_lane_of_250_m_that_becomes_the_off_ramp(folder: Written) -> None:
    layout = load_scenario(folder("exit")).layout
    road, start = layout.road, layout.start
    assert (start.ego_lane, start.ego_front_m) == (3, 300.0)  # 1 to 3 are the through lanes
    assert road.exit_m == 1300.0
    assert road.partial_lanes == (PartialLane(0, 1050.0, math.inf, 1050.0, 1300.0),)
    assert road.end_m == 1400.0
    assert layout.lane_positions["before_0"] == (1, 0.0)
    assert layout.lane_positions["exit_0"] == (0, 1050.0)
    assert layout.lane_positions["off_ramp_0"] == (0, 1300.0)
    assert layout.lane_positions["after_0"] == (1, 1300.0)
    ways = ways_of(folder("exit"))
    ends = [way for way in ways if way.startswith("exit 0 ") or way.split()[2] == "off_ramp"]
    assert ends == ["exit 0 off_ramp 0"]
    assert "exit 1 after 0" in ways


def test_ramp_to_ramp_has_both_ramps_1000_m_apart(folder: Written) -> None:
    layout = load_scenario(folder("ramp_to_ramp")).layout
    merge, leave = layout.road.partial_lanes
    assert merge == load_scenario(folder("merge")).layout.road.partial_lanes[0]
    assert leave == PartialLane(0, 1500.0, math.inf, 1500.0, 1750.0)
    assert (layout.road.exit_m, layout.road.end_m) == (1750.0, 1850.0)
    assert (layout.start.ego_lane, layout.start.ego_front_m) == (0, 400.0)


def test_straight_leads_the_ego_2_km_from_where_followers_in_range_are_on_the_road(
    folder: Written,
) -> None:
    layout = load_scenario(folder("straight")).layout
    assert layout.start.ego_front_m == 300.0
    assert layout.road.end_m == 2300.0
    assert layout.road.partial_lanes == ()
    assert not layout.road.is_loop


@pytest.mark.parametrize("kind", OPEN_KINDS)
def test_plain_sumo_opens_an_open_road_and_its_vehicles_drive_through(
    kind: str, folder: Written
) -> None:
    arrived = {trip["id"]: trip["arrivalLane"] for trip in trips(folder(kind), 400)}
    assert len(arrived) > 100
    ego_in = arrived.pop("ego")
    if kind in ("exit", "ramp_to_ramp"):  # the ego takes the exit, and no other vehicle does
        assert ego_in == "off_ramp_0"
        assert set(arrived.values()) == {"after_0", "after_1", "after_2"}


def test_vehicles_placed_on_an_open_road_are_its_demo_traffic_in_plain_sumo(tmp_path: Path) -> None:
    placed = (
        PlacedVehicle("ego", 0, 420.0, 45.0, 45.0),
        PlacedVehicle("slow", 2, 760.5, 12.0, 12.0),
        PlacedVehicle("eager", 0, 600.0, 30.0, 20.0),
    )
    write_scenario(tmp_path / "story", MergeDescription(vehicles=placed, speed_limit_m_s=60.0))
    first, *rest = states(tmp_path / "story", 100)
    shown = {v.attrib["id"]: [v.attrib[k] for k in ("lane", "pos", "speed")] for v in first}
    assert shown == {
        "ego": ["ramp_0", "25.00", "45.00"],  # the ramp begins at 395 m
        "slow": ["after_1", "10.50", "12.00"],
        "eager": ["beside_0", "100.00", "20.00"],  # at most its desired speed
    }
    assert {v.attrib["id"] for moment in rest for v in moment} == set(shown)


def test_the_inflow_of_plain_sumo_drives_as_fast_as_the_environment_s_traffic(
    tmp_path: Path,
) -> None:
    # the mean of 20 to 32 m/s, not the speed limit, at which they hit each other at the ramp
    dense = MergeDescription(lanes=2, flow_per_h=1200.0, ramp_m=50.0)
    write_scenario(tmp_path / "dense", dense)
    vehicles = [vehicle.attrib for moment in states(tmp_path / "dense", 400) for vehicle in moment]
    fastest = max(float(each["speed"]) for each in vehicles if each["id"] != "ego")
    assert fastest == pytest.approx(26.0, abs=0.01)


@pytest.mark.parametrize("kind", OPEN_KINDS)
def test_the_command_writes_a_kind_as_it_ships(kind: str, folder: Written) -> None:
    assert files_of(folder(kind)) == files_of(find_scenario(kind))
    assert (folder(kind) / "scenario.toml").read_text().startswith(f'kind = "{kind}"\n')


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('id="after_0"', 'id="after_9"', r"other lanes than described, .*after_"),
        ('id="after_1" index="1"', 'id="after_1" index="1000"', r"other lanes .*'after_1'"),
        ('id="after_1" index="1"', 'id="after_1" index="0"', r"other lanes .*'after_1'"),
        ('id="after_1" index="1"', 'id="after_0" index="0"', r"other lanes .*'after_0'"),
        ("</edge>", '<lane id="ramp_0" index="0"/></edge>', r"other lanes .*'ramp_0'"),
        ('fromLane="1" toLane="0"', 'fromLane="1" toLane="1"', r"leads its lanes on otherwise"),
        ('width="3.800000"', 'width="wide"', r"has width wide on lane"),
    ],
)
def test_a_network_that_is_not_the_described_road_is_refused(
    old: str, new: str, reason: str, folder: Written, tmp_path: Path
) -> None:
    write_scenario(tmp_path / "merge", load_scenario(folder("merge")).description)
    replace_in(tmp_path / "merge" / "highway.net.xml", old, new, count=-1)
    with pytest.raises(ScenarioError, match=reason):
        load_scenario(tmp_path / "merge")


@pytest.mark.parametrize(
    ("vehicle", "reason"),
    [
        (PlacedVehicle("slow", 0, 300.0, 10.0, 10.0), r"lane 0 at 300 m, but must be on a lane"),
        (PlacedVehicle("slow", 1, 1250.0, 10.0, 10.0), r"but must be .*, before 1250 m\."),
        (PlacedVehicle("slow", 1, 402.0, 50.0, 50.0), r"faster than .* speed_limit_m_s, 40"),
        (PlacedVehicle("ego", 1, 600.0, 10.0, 10.0), r"Two vehicles are called 'ego'"),
        (PlacedVehicle("slow", 0, 404.0, 10.0, 10.0), r"'ego' and 'slow' overlap on lane 0"),
        (PlacedVehicle("slow", 1, 4.9, 10.0, 10.0), r"at 4.9 m, but its rear, 5 m behind"),
        (PlacedVehicle("slow", 0, 399.0, 10.0, 10.0), r"its rear, 5 m behind, must be on"),
        ({"id": "slow"}, r"vehicles are .*, but must be a list of PlacedVehicle"),
    ],
)
def test_vehicles_are_placed_on_lanes_that_exist_there(vehicle: PlacedVehicle, reason: str) -> None:
    ego = PlacedVehicle("ego", 0, 400.0, 20.0, 30.0)
    with pytest.raises(ScenarioError, match=reason):
        MergeDescription(vehicles=(ego, vehicle))


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("roundabout", r"no kind of scenario 'roundabout'; the kinds are: loop, "),
        ("marge", r"did you mean 'merge'"),
        ("merge --circumference-m 500", r"merge has no --circumference-m: .* loop"),
        ("loop --ramp-m 100", r"kind loop has no --ramp-m: leave it out, or .* kind merge"),
        ("merge --acceleration-lane-m 10", r"acceleration_lane_m is 10.0, but"),
        ("straight --flow-per-h 9000", r"flow_per_h is 9000.0, but must be .*2400"),
        ("exit --approach-m 50", r"approach_m is 50.0, but must be .* from 100"),
        (
            "exit --approach-m 440",
            r"way to the exit is 440 m long, but 3 lane changes of 5 s at 30 m/s take 450 m: make "
            r"approach_m at least 450, or begin an imported route at least 10 m earlier\.",
        ),
        ("exit --lanes 9", r"1000 m long, .* 9 lane .* approach_m at least 1350"),
        (
            "ramp_to_ramp --approach-m 140 --deceleration-lane-m 60",
            r"way to the exit is 140 m long, but 1 lane change of 5 s at 30 m/s takes 150 m",
        ),
        (
            "ramp_to_ramp --deceleration-lane-m 995",
            r"deceleration_lane_m is 995, but must be at most approach_m - 10, 990",
        ),
        ("exit --ramp-m 90", r"no --ramp-m: .* kind merge, ramp_to_ramp"),
        ("straight --vehicle-width-m 4", r"must be at most lane_width_m, 3.8"),
    ],
)
def test_bad_arguments_are_one_sentence(
    words: str, reason: str, tmp_path: Path, capsys: Capsys
) -> None:
    assert re.search(reason, refused_scenario(capsys, tmp_path, "--kind", *words.split()))


def test_an_exit_of_450_m_can_be_reached_and_a_nearer_one_on_a_slower_road() -> None:
    assert ExitDescription(approach_m=450.0).plan().road.exit_m == 750.0
    slow = ExitDescription(approach_m=300.0, speed_limit_m_s=20.0)  # 3 lane changes, 5 s at 20 m/s
    assert slow.plan().road.exit_m == 600.0
    with pytest.raises(ScenarioError, match="take 300 m"):
        replace(slow, approach_m=299.0)


def test_settings_with_which_the_ego_cannot_reach_the_exit_are_refused() -> None:
    lazy = Config().with_traffic("calm").updated("simulation", scenario="exit")
    lazy = lazy.updated("ego", lane_change_duration_s=12.0)
    with pytest.raises(ScenarioError, match=r"3 lane changes of 12 s at 30 m/s take 1080 m"):
        Fleet(load_scenario(find_scenario("exit")), lazy)


@dataclass(frozen=True)
class TwoLaneDescription(OpenDescription):
    """A kind from outside the package: the straight road with a shoulder of its own length.

    shoulder_m: length of the shoulder (this test)
    """

    meaning = "a road of my own"
    shoulder_m: float = setting(400.0, low=100, high=900)

    def plan(self) -> OpenPlan:
        plan = StraightDescription(lanes=self.lanes, flow_per_h=self.flow_per_h).plan()
        return plan._replace(start=plan.start._replace(ego_front_m=self.shoulder_m))


def test_a_kind_from_outside_the_package_is_one_class_and_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setitem(road_types.ROAD_TYPES, "own", TwoLaneDescription)
    words = ["scenario", str(tmp_path / "own"), "--kind", "own", "--shoulder-m", "450"]
    assert main([*words, "--lanes", "2"]) == 0
    scenario = load_scenario(tmp_path / "own")
    assert scenario.description == TwoLaneDescription(lanes=2, shoulder_m=450.0)
    assert scenario.layout.start.ego_front_m == 450.0
    with pytest.raises(SystemExit):
        main(["scenario", "--help"])
    shown = " ".join(capsys.readouterr().out.split())
    assert "own: a road of my own" in shown
    assert "length of the shoulder (default: 400); kind own" in shown


def test_a_description_of_no_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"No kind of scenario is described by a TwoLaneDesc"):
        write_scenario(tmp_path / "none", TwoLaneDescription())
