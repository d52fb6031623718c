"""The checks before the end of a lane.

The ego at 20 m/s reaches 76.5 m if it accelerates and 65 m if it maintains its speed
(``test_strict.py``), and must stay 0.5 m short of the end: under ``strict``, and under ``paper``,
whose own rules would let it drive on until 40 m are left.
"""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from worlds import CENTER, EXIT, LANE_M, MERGE, NARROWING, RIGHT, Car, scene

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.maneuver import plan
from drl_av.driving.scene import LaneChange, Scene
from drl_av.road.road import Road, holds
from drl_av.safety import named_check
from drl_av.safety.check import Rule, WholeCheck
from drl_av.safety.paper import Paper
from drl_av.safety.strict import Strict
from drl_av.scenarios.highways import RampToRampDescription

CONFIG = Config()
STRICT = Strict(CONFIG.strict, CONFIG.ego, CONFIG.simulation)
PAPER = named_check(CONFIG, road=MERGE)
BOTH = pytest.mark.parametrize("check", [STRICT, PAPER], ids=["strict", "paper"])
ACCELERATE, MAINTAIN = Longitudinal.ACCELERATE, Longitudinal.MAINTAIN

WAY = RampToRampDescription().plan().road
"""An acceleration lane that ends at 750 m, and an off-ramp that parts at 1,750 m."""


def before_the_end(gap_m: float, speed_m_s: float = 20.0, *cars: Car) -> Scene:
    """The ego on the acceleration lane, which ends at 800 m."""
    return scene(*cars, s_m=800.0 - gap_m - 2.5, y_m=RIGHT, speed_m_s=speed_m_s, road=MERGE)


@BOTH
@pytest.mark.parametrize(
    ("gap_m", "how"),
    [(77.1, ACCELERATE), (76.9, MAINTAIN), (65.4, Longitudinal.BRAKE), (45.0, Longitudinal(3))],
)
def test_each_check_keeps_the_ego_able_to_stop_before_the_lane_ends(
    check: WholeCheck, gap_m: float, how: Longitudinal
) -> None:
    verdict = check(before_the_end(gap_m), Action(Lateral.KEEP, ACCELERATE))
    assert verdict.action == Action(Lateral.KEEP, how)
    assert bool(verdict.rule) is (how is not ACCELERATE)


@BOTH
def test_the_ego_may_leave_the_lane_while_it_could_still_stop_in_it(check: WholeCheck) -> None:
    left = Action(Lateral.LEFT, MAINTAIN)
    assert check(before_the_end(66.0), left).rule is Rule.NONE
    assert check(before_the_end(65.0), left).action != left


@BOTH
def test_each_check_stops_before_the_end_of_a_lane_on_the_left_too(check: WholeCheck) -> None:
    for gap_m, how in ((77.1, ACCELERATE), (76.9, MAINTAIN)):
        near = scene(s_m=900.0 - gap_m - 2.5, y_m=4 * LANE_M, road=NARROWING)
        assert check(near, Action(Lateral.KEEP, ACCELERATE)).action.longitudinal is how
        assert check(near, Action(Lateral.RIGHT, how)).rule is Rule.NONE


@BOTH
def test_no_lane_change_is_permitted_that_the_gore_would_cut_off(check: WholeCheck) -> None:
    right = Action(Lateral.RIGHT, MAINTAIN)
    far, near = (scene(s_m=1150.0 - gap, y_m=LANE_M, road=EXIT) for gap in (69.0, 67.0))
    assert check(far, right).rule is Rule.NONE
    assert check(near, right).rule is Rule.LANE_CHANGE
    assert check(near, Action(Lateral.KEEP, MAINTAIN)).rule is Rule.NONE  # straight on is free


def test_no_check_lets_the_ego_cross_the_divider_of_the_ramp() -> None:
    on_the_ramp = scene(s_m=500.0, y_m=RIGHT, road=MERGE)
    for check in (PAPER, STRICT):
        assert check(on_the_ramp, Action(Lateral.LEFT, MAINTAIN)).rule is Rule.OFF_ROAD


def test_rule_1_alone_would_brake_too_late_for_the_end_of_a_lane() -> None:
    # closing 29 m/s: T_C is 3 s at 87 m, but the ego needs 29 * 29 / (2 * 4) = 105 m
    near = before_the_end(100.0, speed_m_s=29.0)
    keep = Action(Lateral.KEEP, MAINTAIN)
    assert Paper(CONFIG.safety)(near, keep).rule is Rule.NONE
    assert PAPER(near, keep).action.longitudinal is Longitudinal.HARD_BRAKE


def test_an_ego_that_stands_at_the_end_of_its_lane_may_leave_it_under_paper() -> None:
    # rule 3 would want 15 m ahead in its own lane, if the end were a vehicle
    left = Action(Lateral.LEFT, Longitudinal.BRAKE)
    assert Paper(CONFIG.safety)(before_the_end(5.0, 0.0), left).rule is Rule.LANE_CHANGE
    assert PAPER(before_the_end(5.0, 0.0), left) == (left, Rule.NONE)
    other = before_the_end(5.0, 0.0, Car(10.0, LANE_M, 0.0))
    assert PAPER(other, left).rule is Rule.LANE_CHANGE


def test_a_vehicle_before_the_end_of_the_lane_is_braked_for_by_rule_1() -> None:
    # 39 m at 20 m/s are 1.95 s, although 200 m are left to the end
    near = before_the_end(200.0, 20.0, Car(44.0, RIGHT, 0.0))
    assert PAPER(near, Action(Lateral.KEEP, ACCELERATE)).action.longitudinal is Longitudinal(3)


def test_a_lane_change_out_of_a_lane_that_ends_is_not_turned_back_into_it_too_late() -> None:
    # its centre is across, but the vehicle behind is too near; to stop it needs 105.5 m
    change = LaneChange(0, 1)
    for gap_m, side in ((105.6, Lateral.RIGHT), (105.4, Lateral.LEFT)):
        place = {"s_m": 800.0 - gap_m - 2.5, "y_m": LANE_M / 2 + 0.1, "road": MERGE}
        ego = {"speed_m_s": 30.0, "v_y": 0.76, "lane_change": change}
        now = scene(Car(-12.0, LANE_M, 30.0), **place, **ego)
        verdict = PAPER(now, Action(Lateral.LEFT, Longitudinal.HARD_BRAKE))
        assert verdict.action.lateral is side
        assert verdict.rule is (Rule.NONE if side is Lateral.LEFT else Rule.LANE_CHANGE)


def test_rule_3_forbids_a_change_to_a_lane_that_ends_soon() -> None:
    beside = scene(s_m=730.0, y_m=LANE_M, road=MERGE)  # 67.5 m, below 15 + 3 * 20
    assert PAPER(beside, Action(Lateral.RIGHT, MAINTAIN)).rule is Rule.LANE_CHANGE
    farther = scene(s_m=700.0, y_m=LANE_M, road=MERGE)
    assert PAPER(farther, Action(Lateral.RIGHT, MAINTAIN)).rule is Rule.NONE


STARTS = [
    *((MERGE, 420.0, 0), (MERGE, 600.0, 1), (EXIT, 880.0, 1), (EXIT, 920.0, 0)),
    *((EXIT, 1040.0, 1), (EXIT, 1100.0, 0), (WAY, 620.0, 0), (WAY, 1430.0, 1)),
    *((NARROWING, 650.0, 0), (NARROWING, 700.0, 1), (NARROWING, 750.0, 4)),
    *((NARROWING, 950.0, 3), (NARROWING, 780.0, 2)),
]
"""Roads, places on them and lanes."""


@BOTH
@given(data=st.data())
def test_no_actions_take_the_ego_off_a_road_whose_lanes_end(
    check: WholeCheck, data: st.DataObject
) -> None:
    road, s_m, lane = data.draw(st.sampled_from(STARTS))
    speed = data.draw(st.floats(0, 30))
    y_m, v_y, change = lane * LANE_M, 0.0, None
    assume(STRICT.fallback_is_free(_alone(road, s_m, y_m, speed, v_y, change)))
    for _ in range(25):
        now = _alone(road, s_m, y_m, speed, v_y, change)
        action = check(now, data.draw(st.sampled_from(ACTIONS))).action
        commands, change = plan(now, action, CONFIG.ego, CONFIG.simulation)
        for command in commands:
            s_m += command.speed_m_s * CONFIG.simulation.step_length_s
            assert holds(command.y_m, 1.8, s_m + 2.5, road)
        speed, y_m, v_y = commands[-1]


def _alone(
    road: Road, s_m: float, y_m: float, speed: float, v_y: float, change: LaneChange | None
) -> Scene:
    far_ahead = Car(1000.0, CENTER, 30.0)
    return scene(
        far_ahead, s_m=s_m, y_m=y_m, speed_m_s=speed, v_y=v_y, road=road, lane_change=change
    )
