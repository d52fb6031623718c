"""The stories that ship with drl-av, in the real SUMO: what happens in each of them."""

from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from drives import HARD_BRAKE, KEEP, LEFT, RIGHT
from runs import Capsys, refused_scenario

from drl_av.cli import main
from drl_av.env.highway import HighwayEnv
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.folder import find_scenario, read_description

ACCELERATE = 1
ROADS = "barricade", "lane_drop", "two_into_one_lane"
STORIES = *ROADS, "cut_in", "fast_overtaker", "stalled_vehicle"


class Told(NamedTuple):
    """A story that has been driven."""

    shots: list[Snapshot]
    """The snapshot at the start and after each decision."""
    infos: list[dict[str, Any]]
    """The ``info`` of each decision."""


def tell(story: str, *actions: int, decisions: int, check: str = "permit_all") -> Told:
    """Drive a story by the numbers of actions, the last of which repeats."""
    calm = {"traffic": {"kind": "calm"}}
    with closing(HighwayEnv(story, check, calm)) as env:
        assert env.reset(seed=0)[1]["unsafe_start"] is False
        told = Told([env.scene.snapshot], [])
        for decision in range(decisions):
            _, _, terminated, truncated, info = env.step(actions[min(decision, len(actions) - 1)])
            told.shots.append(env.scene.snapshot)
            told.infos.append(info)
            if terminated or truncated:
                break
    return told


def of(told: Told, name: str, values: str) -> list[float]:
    """A value of a vehicle after each decision, the start first."""
    return [float(getattr(shot, values)[shot.ids.index(name)]) for shot in told.shots]


def ahead_m(told: Told, name: str) -> list[float]:
    """The distance from the ego's centre to that of another vehicle, ahead positive."""
    return [b - a for a, b in zip(of(told, "ego", "s_m"), of(told, name, "s_m"), strict=True)]


def rules(told: Told) -> list[str]:
    return [info["rule"] for info in told.infos]


def end(told: Told) -> str:
    """The collision with which the episode ended, or ""."""
    return str(told.infos[-1]["collision"])


def test_a_vehicle_stands_in_the_egos_lane_and_one_drives_beside_it() -> None:
    blind = tell("stalled_vehicle", KEEP, decisions=20)
    stalled_m = of(blind, "stalled", "s_m")
    assert stalled_m[-1] - stalled_m[0] < 1.0
    assert end(blind) == "ego hit the vehicle ahead"
    # 155 m at 25 m/s without the two half lengths of 5 m: 7 s
    assert 6.0 <= blind.shots[-1].time_s <= 8.0
    assert all(abs(gap_m - 3.0) < 1.0 for gap_m in ahead_m(blind, "left"))
    swerving = tell("stalled_vehicle", LEFT, decisions=10)
    assert end(swerving) == "ego moved into a vehicle beside it"
    seeing = tell("stalled_vehicle", KEEP, decisions=20, check="strict")
    assert end(seeing) == ""
    assert "in_lane" in rules(seeing)


def test_beside_a_barricade_only_the_left_is_open_and_a_vehicle_is_there() -> None:
    assert end(tell("barricade", RIGHT, decisions=3)) == "ego left the open lanes"
    assert end(tell("barricade", LEFT, decisions=8)) == "ego moved into a vehicle beside it"
    checked = tell("barricade", RIGHT, decisions=3, check="paper")
    assert rules(checked) == ["off_road"] * 3
    assert end(tell("barricade", KEEP, decisions=12)) == "ego hit the vehicle ahead"


def test_a_fast_vehicle_passes_the_ego_that_has_a_slow_one_ahead() -> None:
    waiting = tell("fast_overtaker", KEEP, decisions=11)
    gaps_m = ahead_m(waiting, "fast")
    assert gaps_m[0] == -120.0
    assert min(of(waiting, "fast", "speed_m_s")) > 37.0
    assert gaps_m[8] < 0 < gaps_m[10]  # 13 m/s faster: beside the ego after 9.2 s
    assert min(ahead_m(waiting, "slow")) < 20.0
    # out to the left in front of it: it must brake hard, which strict does not permit
    rude = tell("fast_overtaker", *[KEEP] * 5, LEFT, KEEP, decisions=14)
    assert min(of(rude, "fast", "speed_m_s")) < 30.0
    polite = tell("fast_overtaker", *[KEEP] * 5, LEFT, KEEP, decisions=7, check="strict")
    assert polite.infos[5]["rule"] == "lane_change"


def test_where_a_lane_drops_the_ego_must_find_a_gap() -> None:
    blind = tell("lane_drop", KEEP, decisions=20)
    assert end(blind) == "ego left the open lanes"
    assert 780.0 < of(blind, "ego", "s_m")[-1] < 800.0
    rude = tell("lane_drop", LEFT, decisions=5)  # out of 24 m/s, to let it in
    assert min(of(rude, "beside", "speed_m_s")) < 18.0
    polite = tell("lane_drop", LEFT, decisions=1, check="strict")
    assert "lane_change" in rules(polite)[0]
    stopped = tell("lane_drop", KEEP, decisions=20, check="strict")
    assert end(stopped) == ""
    assert max(of(stopped, "ego", "s_m")) < 800.0


def test_a_vehicle_cuts_in_ahead_of_the_ego_within_40_m_and_brakes() -> None:
    kept = tell("cut_in", KEEP, decisions=9)
    entered = next(k for k, y_m in enumerate(of(kept, "cutter", "y_m")) if y_m + 0.9 > 1.9)
    assert entered <= 2
    assert 5.0 < ahead_m(kept, "cutter")[entered] < 40.0
    assert of(kept, "cutter", "speed_m_s")[3] < 21.0  # the ego's 25, and at the start its own 30
    assert of(kept, "cutter", "y_m")[-1] == pytest.approx(3.8)
    hurried = tell("cut_in", ACCELERATE, decisions=9)
    assert end(hurried) == "ego hit the vehicle ahead"
    assert hurried.infos[-1]["collided_with"] == "cutter"
    for check in ("paper", "strict"):
        checked = tell("cut_in", ACCELERATE, decisions=9, check=check)
        assert end(checked) == ""
        assert "in_lane" in rules(checked)


def test_two_enter_the_middle_lane_from_its_two_sides() -> None:
    first = (KEEP, LEFT, KEEP)
    blind = tell("two_into_one_lane", *first, decisions=8)
    ego_y_m, other_y_m = of(blind, "ego", "y_m"), of(blind, "other", "y_m")
    assert (ego_y_m[1], other_y_m[1]) == pytest.approx((0.0, 7.6))
    assert (ego_y_m[2], other_y_m[2]) == pytest.approx((0.76, 6.84))  # both begin at once
    assert end(blind) == "ego moved into a vehicle beside it"
    assert blind.infos[-1]["collided_with"] == "other"
    for check in ("paper", "strict"):
        checked = tell("two_into_one_lane", *first, decisions=10, check=check)
        assert end(checked) == ""
        assert any("lane_change" in rule for rule in rules(checked))
        assert of(checked, "other", "y_m")[-1] == pytest.approx(3.8)
        assert of(checked, "ego", "y_m")[-1] == pytest.approx(0.0)


def test_hard_braking_alone_is_safe_in_each_story() -> None:
    for story in STORIES:
        assert end(tell(story, HARD_BRAKE, decisions=4)) == ""


def test_a_story_is_written_by_its_name_and_changed_by_options(
    tmp_path: Path, capsys: Capsys
) -> None:
    words = ["--from", "stalled_vehicle", "--length-m", "2000"]
    assert main(["scenario", str(tmp_path / "longer"), *words]) == 0
    longer: Any = read_description(tmp_path / "longer" / "scenario.toml")
    story: Any = read_description(find_scenario("stalled_vehicle") / "scenario.toml")
    assert (story.length_m, longer.length_m) == (1000.0, 2000.0)
    assert longer.vehicles == story.vehicles
    again = ["--from", str(tmp_path / "longer"), "--lanes", "4"]
    assert main(["scenario", str(tmp_path / "wider"), *again]) == 0
    with closing(HighwayEnv(tmp_path / "wider")) as env:
        assert len(env.road.open_lanes) == 4
    said = refused_scenario(capsys, tmp_path, "--from", "stalled_vehicl")
    assert "There is no scenario 'stalled_vehicl' (did you mean 'stalled_vehicle'?)" in said
    assert "none.toml is missing" in refused_scenario(capsys, tmp_path, "--from", "none.toml")
    twice = ("--from", "stalled_vehicle", "--from", "cut_in")
    assert "--from is given 2 times" in refused_scenario(capsys, tmp_path, *twice)
