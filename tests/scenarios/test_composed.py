"""Several stories in one scenario: their vehicles on one road, around one ego."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from drives import KEEP
from runs import error_message

from drl_av.cli import main
from drl_av.cli.scenario import composed
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ScenarioError
from drl_av.scenarios.folder import find_scenario, read_description
from drl_av.scenarios.highways import StraightDescription
from drl_av.scenarios.road_description import PlacedVehicle

EGO = PlacedVehicle("ego", 1, 300.0, 25.0, 30.0)


def story(*vehicles: PlacedVehicle, **road: float) -> StraightDescription:
    return StraightDescription(vehicles=(EGO, *vehicles), **road)  # type: ignore[arg-type]


def car(name: str, lane: int, position_m: float, speed_m_s: float = 20.0) -> PlacedVehicle:
    return PlacedVehicle(name, lane, position_m, speed_m_s, speed_m_s)


def test_all_vehicles_are_placed_around_one_ego_and_a_taken_name_gets_a_number() -> None:
    first = story(car("slow", 1, 400.0), car("left", 2, 300.0))
    second = story(car("slow", 0, 400.0), car("right", 0, 300.0))
    third = story(car("slow", 2, 400.0))
    found = composed({"first": first, "second": second, "third": third})
    assert [(each.id, each.lane, each.position_m) for each in found.vehicles] == [
        ("ego", 1, 300.0),
        ("slow", 1, 400.0),
        ("left", 2, 300.0),
        ("slow_2", 0, 400.0),
        ("right", 0, 300.0),
        ("slow_3", 2, 400.0),
    ]
    assert found == replace(first, vehicles=found.vehicles)


def test_vehicles_alike_at_one_place_are_one_and_5_m_further_on_they_are_two() -> None:
    first = story(car("left", 2, 300.0))
    near = composed({"first": first, "second": story(car("beside", 2, 304.9))})
    assert near == first
    far = composed({"first": first, "second": story(car("beside", 2, 305.0))})
    assert [each.id for each in far.vehicles] == ["ego", "left", "beside"]


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (
            story(car("fast", 2, 302.0, 30.0)),
            r"first and second place two different vehicles at one place, 'left' \(lane 2, 300 m, "
            r"20 m/s\) and 'fast' \(lane 2, 302 m, 30 m/s\): move one",
        ),
        (
            story(replace(car("left", 2, 300.0), lane_changes=((1.0, 1),))),
            "two different vehicles at one place, 'left'",
        ),
        (story(length_m=3000.0), r"length_m is 2000.0 in first and 3000.0 in second, .* one road"),
        (
            StraightDescription(vehicles=(replace(EGO, lane=0),)),
            r"ego of first and second .* \(lane 1, 300 m, 25 m/s, and lane 0, 300 m, 25 m/s\)",
        ),
        (
            StraightDescription(vehicles=(car("ahead", 1, 303.0),)),
            r"'ego' \(.*\) and 'ahead' \(",
        ),
        (StraightDescription(), "second places no vehicles, .*: leave it out"),
    ],
)
def test_what_contradicts_itself_is_refused(second: StraightDescription, message: str) -> None:
    first = story(car("left", 2, 300.0))
    with pytest.raises(ScenarioError, match=message):
        composed({"first": first, "second": second})


def test_a_vehicle_that_drives_like_the_ego_at_its_place_is_not_the_ego() -> None:
    double = replace(EGO, id="double")
    with pytest.raises(ScenarioError, match=r"'ego' .* and 'double'"):
        composed({"first": story(), "second": StraightDescription(vehicles=(double,))})


def test_both_stories_happen_in_sumo(tmp_path: Path) -> None:
    text = (find_scenario("stalled_vehicle") / "scenario.toml").read_text()
    farther = tmp_path / "farther.toml"
    farther.write_text(text.replace("position_m = 480.0", "position_m = 600.0"))
    words = ["--from", str(farther), "--from", "cut_in", "--length-m", "1500"]
    assert main(["scenario", str(tmp_path / "both"), *words]) == 0
    found = read_description(tmp_path / "both" / "scenario.toml")
    assert found.length_m == 1500.0
    # the vehicle to the left of the ego, 3 m apart in the two, is one
    names = ["ego", "stalled", "left", "right", "cutter", "slow"]
    assert [each.id for each in found.vehicles] == names
    with closing(HighwayEnv(tmp_path / "both", safety_check="strict")) as env:
        assert env.reset(seed=0)[1]["unsafe_start"] is False
        for _ in range(25):
            _, _, terminated, _, _ = env.step(KEEP)
            assert not terminated
        shot = env.scene.snapshot
        s_m, y_m = (dict(zip(shot.ids, v, strict=True)) for v in (shot.s_m, shot.y_m))
    # the cutter has come between the ego and the stalled vehicle, and all three stand
    assert env.road.lane_of(float(y_m["cutter"])) == 1
    assert s_m["ego"] < s_m["cutter"] < s_m["stalled"]
    assert s_m["stalled"] - s_m["ego"] < 30.0


def test_stories_on_different_roads_are_refused_by_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for other, said in (
        ("barricade", "cut_in is a scenario of the kind straight and barricade of the kind loop"),
        ("two_into_one_lane", "The ego of cut_in and two_into_one_lane starts differently"),
    ):
        assert main(["scenario", str(tmp_path / "x"), "--from", "cut_in", "--from", other]) == 1
        assert said in error_message(capsys)
    assert not (tmp_path / "x").exists()


def test_a_story_with_itself_is_the_story(tmp_path: Path) -> None:
    again = tmp_path / "again.toml"
    again.write_text((find_scenario("cut_in") / "scenario.toml").read_text())
    assert main(["scenario", str(tmp_path / "one"), "--from", "cut_in", "--from", str(again)]) == 0
    one = read_description(tmp_path / "one" / "scenario.toml")
    assert one == read_description(find_scenario("cut_in") / "scenario.toml")
