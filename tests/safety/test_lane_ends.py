"""The checks before the end of a lane: it is a vehicle that stands there.

Under ``strict`` the ego at 20 m/s reaches 76.5 m if it accelerates and 65 m if it maintains its
speed (``test_strict.py``), and must stay 0.5 m short of the end.
"""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from worlds import CENTER, EXIT, LANE_M, MERGE, NARROWING, RIGHT, Car, scene

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.maneuver import plan
from drl_av.driving.scene import LaneChange, Scene
from drl_av.road.road import Road
from drl_av.safety import named_check
from drl_av.safety.check import Rule
from drl_av.safety.strict import Strict
from drl_av.scenarios.highways import RampToRampDescription

CONFIG = Config()
STRICT = Strict(CONFIG.strict, CONFIG.ego, CONFIG.simulation)
PAPER = named_check(CONFIG)
ACCELERATE, MAINTAIN = Longitudinal.ACCELERATE, Longitudinal.MAINTAIN

WAY = RampToRampDescription().plan().road
"""An acceleration lane that ends at 750 m, and an off-ramp that parts at 1,750 m."""


def before_the_end(gap_m: float, speed_m_s: float = 20.0) -> Scene:
    """The ego on the acceleration lane, which ends at 800 m."""
    return scene(s_m=800.0 - gap_m - 2.5, y_m=RIGHT, speed_m_s=speed_m_s, road=MERGE)


@pytest.mark.parametrize(
    ("gap_m", "how"),
    [(77.1, ACCELERATE), (76.9, MAINTAIN), (65.4, Longitudinal.BRAKE), (45.0, Longitudinal(3))],
)
def test_strict_keeps_the_ego_able_to_stop_before_the_lane_ends(
    gap_m: float, how: Longitudinal
) -> None:
    verdict = STRICT(before_the_end(gap_m), Action(Lateral.KEEP, ACCELERATE))
    assert verdict.action == Action(Lateral.KEEP, how)


def test_strict_lets_the_ego_leave_the_lane_while_it_could_still_stop_in_it() -> None:
    left = Action(Lateral.LEFT, MAINTAIN)
    assert STRICT(before_the_end(66.0), left).rule is Rule.NONE
    assert STRICT(before_the_end(65.0), left).action != left


def test_strict_stops_before_the_end_of_a_lane_on_the_left_too() -> None:
    for gap_m, how in ((77.1, ACCELERATE), (76.9, MAINTAIN)):
        near = scene(s_m=900.0 - gap_m - 2.5, y_m=4 * LANE_M, road=NARROWING)
        assert STRICT(near, Action(Lateral.KEEP, ACCELERATE)).action.longitudinal is how
        assert STRICT(near, Action(Lateral.RIGHT, how)).rule is Rule.NONE


def test_strict_forbids_a_lane_change_that_the_gore_would_cut_off() -> None:
    right = Action(Lateral.RIGHT, MAINTAIN)
    far, near = (scene(s_m=1150.0 - gap, y_m=LANE_M, road=EXIT) for gap in (69.0, 67.0))
    assert STRICT(far, right).rule is Rule.NONE
    assert STRICT(near, right).rule is Rule.LANE_CHANGE
    assert STRICT(near, Action(Lateral.KEEP, MAINTAIN)).rule is Rule.NONE  # straight on is free


def test_no_check_lets_the_ego_cross_the_divider_of_the_ramp() -> None:
    on_the_ramp = scene(s_m=500.0, y_m=RIGHT, road=MERGE)
    for check in (PAPER, STRICT):
        assert check(on_the_ramp, Action(Lateral.LEFT, MAINTAIN)).rule is Rule.OFF_ROAD


def test_rule_1_brakes_before_the_end_of_the_lane() -> None:
    # closing 20 m/s: T_C is 2 s at 40 m, and 3 s at 60 m
    for gap_m, how in ((39.0, Longitudinal.HARD_BRAKE), (59.0, Longitudinal.BRAKE)):
        verdict = PAPER(before_the_end(gap_m), Action(Lateral.KEEP, ACCELERATE))
        assert verdict.action.longitudinal is how
        assert verdict.rule is Rule.IN_LANE


def test_rule_3_forbids_a_change_to_a_lane_that_ends_soon() -> None:
    beside = scene(s_m=730.0, y_m=LANE_M, road=MERGE)  # 67.5 m, below 15 + 3 * 20
    assert PAPER(beside, Action(Lateral.RIGHT, MAINTAIN)).rule is Rule.LANE_CHANGE
    farther = scene(s_m=700.0, y_m=LANE_M, road=MERGE)
    assert PAPER(farther, Action(Lateral.RIGHT, MAINTAIN)).rule is Rule.NONE


@given(st.data())
def test_under_strict_no_actions_take_the_ego_off_a_road_whose_lanes_end(
    data: st.DataObject,
) -> None:
    road, start_m, lane = data.draw(
        st.sampled_from(
            [
                *((MERGE, 420.0, 0), (MERGE, 600.0, 1), (EXIT, 880.0, 1), (EXIT, 920.0, 0)),
                *((EXIT, 1040.0, 1), (EXIT, 1100.0, 0), (WAY, 620.0, 0), (WAY, 1430.0, 1)),
                *((NARROWING, 650.0, 0), (NARROWING, 700.0, 1), (NARROWING, 750.0, 4)),
                *((NARROWING, 950.0, 3), (NARROWING, 780.0, 2)),
            ]
        )
    )
    speed = data.draw(st.floats(0, 30))
    s_m, y_m, v_y, change = start_m, lane * LANE_M, 0.0, None
    assume(STRICT.fallback_is_free(_alone(road, s_m, y_m, speed, v_y, change)))
    for _ in range(25):
        now = _alone(road, s_m, y_m, speed, v_y, change)
        action = STRICT(now, data.draw(st.sampled_from(ACTIONS))).action
        commands, change = plan(now, action, CONFIG.ego, CONFIG.simulation)
        for command in commands:
            s_m += command.speed_m_s * CONFIG.simulation.step_length_s
            assert road.holds(command.y_m, 1.8, s_m + 2.5)
        speed, y_m, v_y = commands[-1]


def _alone(
    road: Road, s_m: float, y_m: float, speed: float, v_y: float, change: LaneChange | None
) -> Scene:
    far_ahead = Car(1000.0, CENTER, 30.0)
    return scene(
        far_ahead, s_m=s_m, y_m=y_m, speed_m_s=speed, v_y=v_y, road=road, lane_change=change
    )
