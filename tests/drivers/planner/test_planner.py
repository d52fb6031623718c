"""The driver ``planner`` in scenes by hand, and in SUMO."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import pytest
from worlds import (
    ALONE,
    EXIT,
    LANE_M,
    LEFT,
    MERGE,
    RIGHT,
    SLOW_LEADER,
    Car,
    ahead,
    behind,
    changing,
    scene,
)

from drl_av.config import Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.planner.driver import PlannerDriver
from drl_av.drivers.registry import rule_driver
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.safety import named_check

CONFIG = Config()
BOXED_SEED, VEHICLES = 820_008, 10
"""An episode in which ``gap-mobil`` stays behind slow vehicles."""


@pytest.fixture(scope="module", params=["paper", "strict"])
def env(request: pytest.FixtureRequest) -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(safety_check=request.param)) as made:
        yield made


def act(world: Scene, driver: Driver | None = None) -> Action:
    return (driver or PlannerDriver(CONFIG)).act(world, None)


def behind_a_row(gap_m: float, speed_m_s: float) -> Scene:
    """Return a scene at 20 m/s with a vehicle in each lane, all as far ahead and as fast."""
    return scene(*(ahead(gap_m, lane_m, speed_m_s) for lane_m in (RIGHT, 3.8, LEFT)))


def test_it_accelerates_alone_and_overtakes_a_slow_vehicle() -> None:
    assert act(ALONE) == Action(Lateral.KEEP, Longitudinal.ACCELERATE)
    leader = scene(ahead(60.0, speed_m_s=15.0), Car(0.0, RIGHT, 15.0))
    assert act(leader).lateral is Lateral.LEFT


@pytest.mark.parametrize(
    ("gap_m", "leader", "longitudinal"),
    [
        # at 20 m/s behind 23 m/s the time-gap law with 1.4 s is (0.4 (gap - 30.5) + 3) / 1.4
        (26.6, 23.0, Longitudinal.ACCELERATE),  # 1.03
        (26.4, 23.0, Longitudinal.MAINTAIN),  # 0.97
        # behind 20 m/s it is 0.4 (gap - 22.5) with 1 s
        (20.1, 20.0, Longitudinal.MAINTAIN),  # -0.96
        (19.9, 20.0, Longitudinal.BRAKE),  # -1.04
        (14.9, 20.0, Longitudinal.HARD_BRAKE),  # -3.04
    ],
)
def test_between_two_headways_it_keeps_its_speed(
    gap_m: float, leader: float, longitudinal: Longitudinal
) -> None:
    assert act(behind_a_row(gap_m, leader)) == Action(Lateral.KEEP, longitudinal)


@pytest.mark.parametrize(
    ("check", "gap_m", "longitudinal"),
    [
        # at 22 m/s the gap is 1 m smaller a second later and 21 m smaller 10 s after that; the law
        # with 1 s is then 0.4 (gap - 21 - 24.5) - 2
        ("paper", 48.1, Longitudinal.ACCELERATE),  # -0.96
        ("paper", 47.9, Longitudinal.MAINTAIN),  # -1.04
        # strict requires gap - 21 - 0.5 + 45 to be more than 22 + 55: the stopping distances of
        # both, in SUMO steps of 0.5 s, after a second at 22 m/s
        ("strict", 53.6, Longitudinal.ACCELERATE),
        ("strict", 53.4, Longitudinal.MAINTAIN),
    ],
)
def test_it_accelerates_only_if_it_need_not_brake_for_ten_seconds(
    check: str, gap_m: float, longitudinal: Longitudinal
) -> None:
    driver = PlannerDriver(CONFIG.updated("safety", check=check))
    assert act(behind_a_row(gap_m, 20.0), driver) == Action(Lateral.KEEP, longitudinal)


def test_on_the_acceleration_lane_it_accelerates_towards_the_end_of_the_lane() -> None:
    # at 22 m/s the end, 350 m ahead, demands braking within ten seconds
    assert act(scene(s_m=450.0, y_m=RIGHT, road=MERGE)).longitudinal is Longitudinal.ACCELERATE


def test_it_brakes_early_enough_for_a_vehicle_that_stands() -> None:
    # 30 m/s: 900 / (2 * (gap - 2.5 - 30)) is 0.7 * 2 at 354 m and 0.7 * 4 at 193 m
    walls = [[ahead(gap, lane_m, 0.0) for lane_m in (RIGHT, 3.8, LEFT)] for gap in (190.0, 200.0)]
    assert act(scene(*walls[0], speed_m_s=30.0)).longitudinal is Longitudinal.HARD_BRAKE
    assert act(scene(*walls[1], speed_m_s=30.0)).longitudinal is Longitudinal.BRAKE


def test_it_lets_a_lane_change_go_on() -> None:
    world = changing(ahead(60.0, speed_m_s=15.0), origin=1, target=2, seconds=2)
    assert act(world).lateral is Lateral.KEEP


def test_it_leaves_a_ramp_where_the_lanes_are_joined_and_not_before() -> None:
    divided, joined = (scene(s_m=s_m, y_m=RIGHT, road=MERGE) for s_m in (530.0, 570.0))
    assert act(divided).lateral is Lateral.KEEP
    assert act(joined).lateral is Lateral.LEFT


def test_under_strict_it_completes_a_change_ahead_of_a_vehicle_that_must_stay_behind() -> None:
    # 3 s into the change the body is in the way of the one behind; eq. 3 forbids to go on
    close = changing(behind(5.0, LEFT, 20.0), origin=1, target=2, seconds=3)
    strict = PlannerDriver(CONFIG.updated("safety", check="strict"))
    assert act(close, strict).lateral is Lateral.KEEP
    assert act(close).lateral is Lateral.RIGHT


def test_it_drives_on_to_the_exit_and_changes_where_its_lane_has_begun() -> None:
    # the lane of the exit begins at 900 m, and can be entered up to 1,150 m
    road = replace(EXIT, exit_m=1150.0)
    early, before, beside = (scene(s_m=s, y_m=LANE_M, road=road) for s in (600.0, 880.0, 910.0))
    assert act(early) == act(before) == Action(Lateral.KEEP, Longitudinal.ACCELERATE)
    assert act(beside).lateral is Lateral.RIGHT


def test_on_its_way_it_takes_the_gap_that_braking_opens() -> None:
    # at 20 m/s the ego stops in 20 + 45 m if it maintains, in 19 + 36 m if it brakes; the vehicle
    # ahead, at 18 m/s, leaves 25 + 36 m; both less what half of a SUMO step adds
    gap = Car(30.0, LANE_M, 18.0), Car(-40.0, LANE_M, 14.0)
    world = scene(*gap, s_m=687.5, y_m=RIGHT, speed_m_s=20.0, road=MERGE)
    strict = CONFIG.updated("safety", check="strict")
    assert act(world, PlannerDriver(strict)) == Action(Lateral.LEFT, Longitudinal.BRAKE)
    maintaining = Action(Lateral.LEFT, Longitudinal.MAINTAIN)
    assert named_check(strict)(world, maintaining).action.lateral is Lateral.KEEP


def test_asked_again_in_the_same_scene_it_answers_the_same() -> None:
    driver = PlannerDriver(CONFIG)
    driver.start(0)
    assert act(SLOW_LEADER, driver) == act(SLOW_LEADER, driver)


def test_where_it_must_not_pass_on_the_right_it_stays_behind_the_left_lane() -> None:
    banned = rule_driver("planner", Config().updated("ego", overtake_right=False))
    for gap_m, speed, longitudinal in (
        (25.0, 20.0, Longitudinal.MAINTAIN),
        (19.0, 20.0, Longitudinal.BRAKE),
        (25.0, 16.0, Longitudinal.ACCELERATE),  # below 60 km/h the ban does not hold
    ):
        banned.start(0)
        assert act(scene(ahead(gap_m, LEFT, speed)), banned).longitudinal is longitudinal
    boxed = scene(ahead(60.0, speed_m_s=18.0), Car(0.0, LEFT, 18.0))
    banned.start(0)
    assert act(boxed, banned).lateral is Lateral.KEEP
    assert act(boxed).lateral is Lateral.RIGHT


def test_under_either_check_it_gets_out_of_the_box_and_twice_by_the_same_way(
    env: HighwayEnv,
) -> None:
    planner, rule = rule_driver("planner", env.config), rule_driver("gap-mobil", env.config)
    driven = drive(env, planner, "planner", BOXED_SEED, VEHICLES)
    assert driven.mean_speed_m_s > drive(env, rule, "", BOXED_SEED, VEHICLES).mean_speed_m_s + 0.5
    assert not driven.collided
    assert driven.safety_triggers <= 4
    assert drive(env, planner, "planner", BOXED_SEED, VEHICLES) == driven
