"""Starts that ``strict`` cannot protect, what it reads from the vehicle types, and speed limits."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from runs import replace_in
from worlds import CENTER, LEFT, ROAD, Car, ahead, behind, scene

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import LaneChange
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ConfigError, ScenarioError
from drl_av.road.road import OPEN_LAP_M, Road, SpeedLimit
from drl_av.safety import named_check
from drl_av.safety.strict import Strict
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.loop import ScenarioDescription
from drl_av.scenarios.road_description import PlacedVehicle

STRICT = Config().updated("safety", check="strict")


@pytest.mark.parametrize(
    ("car", "speed_m_s", "unsafe"),
    [
        (behind(5.0, speed_m_s=38.0), 1.0, True),
        (behind(5.0, LEFT, speed_m_s=38.0), 1.0, False),  # in another lane
        # 38 m/s: 0.5 s to respond, in which it gains 1 m/s, then 39^2 / 8 m: some 200 m
        (behind(190.0, speed_m_s=38.0), 1.0, True),
        (behind(215.0, speed_m_s=38.0), 1.0, False),
        (behind(20.0, speed_m_s=25.0), 25.0, False),
        (behind(40.0, speed_m_s=30.0), 25.0, False),  # 56.5 m, if the ego braked hard at once
        (ahead(5.0, speed_m_s=0.0), 20.0, True),
        (ahead(5.0, speed_m_s=20.0), 20.0, False),
        (Car(2.0, speed_m_s=20.0), 20.0, True),  # in the ego's body, ahead of its centre
        (Car(-2.0, speed_m_s=20.0), 20.0, True),  # and behind it
        (Car(-2.0, LEFT, speed_m_s=20.0), 20.0, False),  # beside it in another lane
    ],
)
def test_a_start_is_unsafe_ahead_beside_and_behind(
    car: Car, speed_m_s: float, unsafe: bool
) -> None:
    road = ROAD.__class__(2000.0, ROAD.lane_width_m, ROAD.open_lanes)
    world = scene(car, s_m=500.0, speed_m_s=speed_m_s, road=road)
    check = named_check(STRICT, road=road)
    assert isinstance(check, Strict)
    assert check.start_is_safe(world) is not unsafe


def test_the_follower_of_an_unsafe_start_hits_the_ego_in_sumo(tmp_path: Path) -> None:
    ego = PlacedVehicle("ego", 1, 100.0, 1.0, 30.0)
    fast = PlacedVehicle("fast", 1, 90.0, 38.0, 38.0)
    write_scenario(tmp_path / "road", ScenarioDescription(vehicles=(ego, fast)))
    with closing(HighwayEnv(tmp_path / "road", config=STRICT)) as env:
        assert env.reset(seed=0)[1]["unsafe_start"] is True
        assert env.step(0)[4]["collision"]


def spoilt(folder: Path, old: str, new: str) -> Path:
    write_scenario(folder, ScenarioDescription())
    replace_in(folder / "vehicle_types.add.xml", old, new)
    (folder / "SHA256SUMS").unlink()
    return folder


def test_strict_reads_the_accel_of_the_traffic_that_drives(tmp_path: Path) -> None:
    folder = spoilt(tmp_path / "road", 'accel="1.5"', 'accel="10"')
    with pytest.raises(
        ConfigError,
        match=r"accel of the vehicle type traffic must be at most strict.acceleration_m_s2, 2, and "
        r"not 10, because bound 4 fails",
    ):
        HighwayEnv(folder, safety_check="strict")
    with closing(HighwayEnv(folder, safety_check="paper")) as env:
        env.reset(seed=0)


@pytest.mark.parametrize("check", ["permit_all", "paper", "strict"])
@pytest.mark.parametrize("old", ['minGap="2.5"', 'accel="1.5"', 'lcKeepRight="0"', 'decel="4"'])
@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_number_of_a_vehicle_type_that_is_none_is_refused_under_every_check(
    check: str, old: str, value: str, tmp_path: Path
) -> None:
    key = old.partition("=")[0]
    folder = spoilt(tmp_path / "road", old, f'{key}="{value}"')
    with pytest.raises(ScenarioError, match=rf"has {key} '{value}', but must have a"):
        HighwayEnv(folder, safety_check=check)


LIMIT = SpeedLimit(400.0, 500.0, 8.0)
FREE = Road(OPEN_LAP_M, 3.8, (True, True, True), 2000.0)
LIMITED = replace(FREE, speed_limits=((LIMIT,),) * 3)


def changes_left(
    road: Road, gap_m: float, how: Longitudinal, before_m: float, change: LaneChange | None = None
) -> bool:
    """Whether strict lets an ego of 25 m/s move in front of a vehicle of 25 m/s.

    The ego's front is so far before the limit, and the ego is 1 s on the way if it changes lanes.
    """
    place = {"s_m": 397.5 - before_m, "y_m": CENTER + 0.76 * (change is not None)}
    world = scene(behind(gap_m, LEFT, 25.0), **place, speed_m_s=25.0, road=road, lane_change=change)
    lateral = Lateral.LEFT if change is None else Lateral.KEEP
    return named_check(STRICT, road=road)(world, Action(lateral, how)).action.lateral is lateral


# a second later it may drive 21 m/s or, 131 m before the limit, 23.3 m/s
@pytest.mark.parametrize(
    ("before_m", "slowest"), [(122.5, Longitudinal.HARD_BRAKE), (156.0, Longitudinal.BRAKE)]
)
@pytest.mark.parametrize("change", [None, LaneChange(1, 2)])
def test_a_change_of_lanes_expects_that_a_speed_limit_slows_the_ego_down(
    before_m: float, slowest: Longitudinal, change: LaneChange | None
) -> None:
    found = {
        (road is LIMITED, how): [
            changes_left(road, float(gap_m), how, before_m, change) for gap_m in range(1, 90)
        ]
        for road in (FREE, LIMITED)
        for how in (Longitudinal.MAINTAIN, slowest)
    }
    assert found[True, Longitudinal.MAINTAIN] == found[False, slowest]
    assert sum(found[False, Longitudinal.MAINTAIN]) > sum(found[True, Longitudinal.MAINTAIN]) > 0
