"""The check ``paper``: the action executed instead of a proposal, and the rule that fired."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles.plan import next_lane_change
from worlds import (
    ALONE,
    BARRICADED_ROAD,
    BOXED_IN,
    CENTER,
    LEFT,
    RIGHT,
    SLOW_LEADER,
    Car,
    ahead,
    behind,
    changing,
    scene,
    scenes,
)

from drl_av.config import Config, SafetyConfig
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.affordances import Neighbor
from drl_av.driving.scene import Scene
from drl_av.safety import named_check
from drl_av.safety.check import Rule, Verdict, permit_all
from drl_av.safety.paper import closing_speed, gap_condition, paper, safe_action, time_to_collision

CONFIG = SafetyConfig()
KEEP, TO_RIGHT, TO_LEFT = Lateral.KEEP, Lateral.RIGHT, Lateral.LEFT
MAINTAIN, ACCELERATE = Longitudinal.MAINTAIN, Longitudinal.ACCELERATE
BRAKE, HARD_BRAKE = Longitudinal.BRAKE, Longitudinal.HARD_BRAKE
PROPOSALS = st.sampled_from(ACTIONS)


def checked(world: Scene, lateral: Lateral = KEEP, how: Longitudinal = ACCELERATE) -> Verdict:
    return paper(world, Action(lateral, how), CONFIG)


def closing(gap_m: float, closing_m_s: float) -> Scene:
    """The ego at 20 m/s behind a vehicle that is so much slower."""
    return scene(ahead(gap_m, speed_m_s=20.0 - closing_m_s))


# Equations 2 and 3


@pytest.mark.parametrize(
    ("gap", "closing_m_s", "holds"),
    [
        (30.0, 5.0, False),  # 30 - 3 * 5 is 15, not more than 15
        (30.01, 5.0, True),
        (15.0, 0.0, False),
        (15.01, 0.0, True),
        (0.5, -5.0, True),  # 0.5 + 15: the gap opens fast enough
        (0.0, -5.0, False),
        (100.0, 30.0, False),
    ],
)
def test_gap_condition_is_equation_2(gap: float, closing_m_s: float, holds: bool) -> None:
    assert gap_condition(gap, closing_m_s, CONFIG) is holds


@pytest.mark.parametrize(
    ("ttc_s", "action"),
    [
        *((0.0, HARD_BRAKE), (2.0, HARD_BRAKE), (2.001, BRAKE)),
        *((3.0, BRAKE), (3.001, MAINTAIN), (math.inf, MAINTAIN)),
    ],
)
def test_safe_action_is_equation_3(ttc_s: float, action: Longitudinal) -> None:
    assert safe_action(ttc_s, CONFIG) == action


def test_time_to_collision_is_infinite_unless_the_gap_closes() -> None:
    assert time_to_collision(20.0, 5.0) == 4.0
    assert time_to_collision(20.0, 0.0) == math.inf
    assert time_to_collision(20.0, -5.0) == math.inf
    assert time_to_collision(0.0, 5.0) == 0.0
    assert closing_speed(Neighbor(1, 20.0, -5.0, 0.0, 0.0)) == 5.0


# Rule 1: in the lane


@pytest.mark.parametrize(
    ("gap", "executed"),
    [
        (5.0, HARD_BRAKE),
        (10.0, HARD_BRAKE),  # T_C is exactly T_HB
        (10.1, BRAKE),
        (15.0, BRAKE),  # T_C is exactly T_B
        (15.1, MAINTAIN),
        (30.0, MAINTAIN),  # 30 - 15 is not more than 15
    ],
)
def test_acceleration_towards_a_vehicle_5_m_s_slower_is_replaced(
    gap: float, executed: Longitudinal
) -> None:
    assert checked(closing(gap, 5.0)) == Verdict(Action(KEEP, executed), Rule.IN_LANE)


def test_acceleration_is_permitted_as_soon_as_the_gap_condition_holds() -> None:
    assert checked(closing(30.1, 5.0)) == Verdict(Action(KEEP, ACCELERATE), Rule.NONE)
    # and not for a slow approach alone: T_C is 1 m / 0.5 m/s
    assert checked(closing(1.0, 0.5)) == Verdict(Action(KEEP, HARD_BRAKE), Rule.IN_LANE)


@pytest.mark.parametrize("faster", [0.0, 0.5, 4.0])
def test_tailgating_one_who_is_no_slower_is_permitted(faster: float) -> None:
    # at 2 m the condition is broken, but the ego is not the faster one
    assert checked(closing(2.0, -faster)) == Verdict(Action(KEEP, ACCELERATE), Rule.NONE)


def test_the_paper_answers_maintain_however_fast_the_gap_closes_above_3_s() -> None:
    # why the paper's rule is not collision-free: 61 m at 20 m/s is 3.05 s
    standing = scene(ahead(61.0, speed_m_s=0.0))
    assert checked(standing, how=ACCELERATE).action.longitudinal is MAINTAIN


@pytest.mark.parametrize(
    ("gap", "proposed", "executed", "fired"),
    [
        (20.0, BRAKE, BRAKE, False),  # maintain would do
        (20.0, HARD_BRAKE, HARD_BRAKE, False),
        (20.0, MAINTAIN, MAINTAIN, False),
        (20.0, ACCELERATE, MAINTAIN, True),
        (12.0, HARD_BRAKE, HARD_BRAKE, False),  # brake would do
        (12.0, BRAKE, BRAKE, False),
        (12.0, MAINTAIN, BRAKE, True),
        (8.0, BRAKE, HARD_BRAKE, True),
        (8.0, MAINTAIN, HARD_BRAKE, True),
        (8.0, HARD_BRAKE, HARD_BRAKE, False),
    ],
)
def test_a_proposal_that_brakes_at_least_as_hard_is_kept_and_fires_nothing(
    gap: float, proposed: Longitudinal, executed: Longitudinal, fired: bool
) -> None:
    verdict = checked(closing(gap, 5.0), how=proposed)
    assert verdict.action.longitudinal is executed
    assert (verdict.rule is Rule.IN_LANE) is fired


def test_vehicles_of_other_lanes_and_behind_do_not_make_the_ego_brake() -> None:
    world = scene(ahead(1, LEFT, 0.0), ahead(1, RIGHT, 0.0), behind(1, CENTER, 39.0))
    assert checked(world) == Verdict(Action(KEEP, ACCELERATE), Rule.NONE)


def test_a_vehicle_that_is_cutting_in_counts_as_soon_as_its_body_is_in_the_lane() -> None:
    assert checked(scene(ahead(8, LEFT - 1.0, 15.0))).rule is Rule.NONE  # 0.0 m over the line
    assert checked(scene(ahead(8, LEFT - 1.01, 15.0))).action.longitudinal is HARD_BRAKE


# Rule 2: off the road


@pytest.mark.parametrize(
    ("world", "lateral", "fires"),
    [
        (scene(y_m=RIGHT), TO_RIGHT, True),
        (scene(y_m=RIGHT), TO_LEFT, False),
        (scene(y_m=LEFT), TO_LEFT, True),
        (scene(y_m=LEFT), TO_RIGHT, False),
        (scene(y_m=CENTER), TO_RIGHT, False),
        (scene(y_m=CENTER, road=BARRICADED_ROAD), TO_RIGHT, True),
        (scene(y_m=CENTER, road=BARRICADED_ROAD), TO_LEFT, False),
    ],
)
def test_no_lane_change_leads_off_the_open_lanes(
    world: Scene, lateral: Lateral, fires: bool
) -> None:
    verdict = checked(world, lateral)
    assert verdict.rule is (Rule.OFF_ROAD if fires else Rule.NONE)
    assert verdict.action == Action(KEEP if fires else lateral, ACCELERATE)


@pytest.mark.parametrize("proposed", [KEEP, TO_RIGHT])
def test_a_lane_change_into_a_lane_that_has_ended_is_aborted(proposed: Lateral) -> None:
    # to keep the lane would continue the lane change: off the road
    beside_the_gore = changing(origin=1, target=0, seconds=1, road=BARRICADED_ROAD)
    verdict = checked(beside_the_gore, proposed)
    assert verdict == Verdict(Action(TO_LEFT, ACCELERATE), Rule.OFF_ROAD)
    assert checked(beside_the_gore, TO_LEFT) == Verdict(Action(TO_LEFT, ACCELERATE), Rule.NONE)


def test_a_way_back_from_beside_the_edge_is_no_way_off_the_road() -> None:
    # 2 s out of the right lane, right again: an abort, though there is no lane right of 0
    verdict = checked(changing(origin=0, target=1, seconds=2), TO_RIGHT)
    assert verdict == Verdict(Action(TO_RIGHT, ACCELERATE), Rule.NONE)


def test_keeping_on_to_the_last_lane_is_no_way_off_the_road_after_its_line_is_crossed() -> None:
    # 4 s towards lane 2, whose left is nothing: "left" goes on to 2, it does not start for 3
    verdict = checked(changing(origin=1, target=2, seconds=4), TO_LEFT)
    assert verdict == Verdict(Action(TO_LEFT, ACCELERATE), Rule.NONE)


# Rule 3: lane changes


@pytest.mark.parametrize(
    ("others", "permitted"),
    [
        ((), True),
        ((ahead(15.1, LEFT), behind(15.1, LEFT), ahead(15.1)), True),
        ((ahead(15.0, LEFT),), False),
        ((behind(15.0, LEFT),), False),
        ((ahead(15.0),), False),  # the vehicle ahead in the own lane counts too
        ((behind(1.0),), True),  # the one behind in the own lane does not
        ((ahead(1.0, RIGHT), behind(1.0, RIGHT)), True),  # nor do those of the other side
        ((ahead(30.0, LEFT, 15.0),), False),  # slower ahead: 30 - 15 = 15
        ((ahead(30.1, LEFT, 15.0),), True),
        ((behind(30.0, LEFT, 25.0),), False),  # faster behind: 30 - 15 = 15
        ((behind(30.1, LEFT, 25.0),), True),
        ((behind(3.0, LEFT, 15.0),), True),  # slower behind falls back: 3 + 15 = 18
        ((ahead(3.0, LEFT, 25.0),), True),
        ((Car(0.0, LEFT),), False),  # alongside
        ((Car(-1.0, LEFT),), False),
    ],
)
@pytest.mark.parametrize("mirrored", [False, True], ids=["to the left", "to the right"])
def test_a_lane_change_is_started_only_where_three_gaps_hold(
    others: tuple[Car, ...], permitted: bool, mirrored: bool
) -> None:
    side = TO_RIGHT if mirrored else TO_LEFT
    if mirrored:
        others = tuple(car._replace(y_m=7.6 - car.y_m) for car in others)
    verdict = checked(scene(*others), side, BRAKE)
    assert verdict.action == Action(side if permitted else KEEP, BRAKE)
    assert verdict.rule is (Rule.NONE if permitted else Rule.LANE_CHANGE)


@pytest.mark.parametrize("proposed", [KEEP, TO_LEFT])
def test_a_running_lane_change_continues_while_its_gaps_hold(proposed: Lateral) -> None:
    world = changing(ahead(16, LEFT), behind(16, LEFT), origin=1, target=2, seconds=2)
    verdict = checked(world, proposed)
    assert verdict == Verdict(Action(proposed, ACCELERATE), Rule.NONE)


@pytest.mark.parametrize("proposed", [KEEP, TO_LEFT])
@pytest.mark.parametrize(
    "other", [ahead(10, LEFT), behind(10, LEFT), ahead(10, CENTER)], ids=["front", "rear", "own"]
)
def test_a_running_lane_change_is_aborted_as_soon_as_a_gap_breaks(
    proposed: Lateral, other: Car
) -> None:
    verdict = checked(changing(other, origin=1, target=2, seconds=2), proposed, BRAKE)
    assert verdict == Verdict(Action(TO_RIGHT, BRAKE), Rule.LANE_CHANGE)


def test_past_the_line_a_lane_change_is_aborted_where_the_way_back_is_clear() -> None:
    # 3 s: the ego's centre is in the left lane, one is close behind it there
    world = changing(behind(5, LEFT), origin=1, target=2, seconds=3)
    assert checked(world, TO_LEFT).action.lateral is TO_RIGHT


def test_past_the_line_there_is_no_way_back_to_a_lane_that_is_closed() -> None:
    world = changing(behind(5, CENTER), origin=0, target=1, seconds=3, road=BARRICADED_ROAD)
    assert checked(world) == Verdict(Action(KEEP, ACCELERATE), Rule.NONE)


def test_the_ego_that_wants_back_is_sent_on_where_the_way_back_is_not_clear() -> None:
    world = changing(behind(5, CENTER), origin=1, target=2, seconds=3)
    verdict = checked(world, TO_RIGHT)
    assert verdict == Verdict(Action(TO_LEFT, ACCELERATE), Rule.LANE_CHANGE)


@pytest.mark.parametrize("proposed", Lateral)
@pytest.mark.parametrize(("seconds", "ends_in"), [(1, 1), (2, 1), (3, 2), (4, 2)])
def test_stuck_between_two_broken_sides_it_ends_in_the_lane_its_centre_is_in(
    proposed: Lateral, seconds: int, ends_in: int
) -> None:
    world = changing(behind(5, LEFT), behind(5, CENTER), origin=1, target=2, seconds=seconds)
    executed = checked(world, proposed).action.lateral
    heading = next_lane_change(world.lane_change, world.affordances.lane, executed)
    assert heading.target == ends_in


def test_an_abort_that_breaks_a_gap_is_not_swapped_to_and_fro_for_ever() -> None:
    # on its way back from the left lane, where one is close behind: it does not turn again
    world = changing(behind(5, LEFT), origin=2, target=1, seconds=3)
    assert checked(world, KEEP) == Verdict(Action(KEEP, ACCELERATE), Rule.NONE)


def test_both_rules_can_fire_at_once_and_both_are_reported() -> None:
    verdict = checked(BOXED_IN, TO_LEFT)
    assert verdict == Verdict(Action(KEEP, MAINTAIN), Rule.IN_LANE | Rule.LANE_CHANGE)
    assert str(verdict.rule) == "in_lane+lane_change"
    assert str(checked(SLOW_LEADER).rule) == "in_lane"
    assert str(checked(scene(y_m=LEFT), TO_LEFT).rule) == "off_road"
    assert str(checked(ALONE).rule) == "none"


# The rules as the paper prints them


PRINTED = SafetyConfig(printed_rule_1=True, printed_rule_3=True)


@pytest.mark.parametrize(
    ("gap", "proposed", "executed"),
    [
        (15.0, HARD_BRAKE, BRAKE),  # T_C is 3 s, for which eq. 4 demands brake
        (30.0, BRAKE, MAINTAIN),
        (30.1, BRAKE, BRAKE),  # eq. 3 holds
        (10.0, HARD_BRAKE, HARD_BRAKE),
    ],
)
def test_as_printed_rule_1_also_replaces_a_harder_brake(
    gap: float, proposed: Longitudinal, executed: Longitudinal
) -> None:
    verdict = paper(closing(gap, 5.0), Action(KEEP, proposed), PRINTED)
    assert verdict.action == Action(KEEP, executed)
    assert verdict.rule is (Rule.NONE if executed == proposed else Rule.IN_LANE)
    assert paper(closing(gap, 5.0), Action(KEEP, proposed), CONFIG).rule is Rule.NONE


def test_as_printed_rule_3_turns_the_ego_round_each_second_where_neither_side_is_clear() -> None:
    others = (behind(5, LEFT), behind(5, CENTER))
    there = changing(*others, origin=1, target=2, seconds=3)
    back = changing(*others, origin=2, target=1, seconds=2)
    for world, way in ((there, TO_RIGHT), (back, TO_LEFT)):
        verdict = paper(world, Action(KEEP, ACCELERATE), PRINTED)
        assert verdict == Verdict(Action(way, ACCELERATE), Rule.LANE_CHANGE)
    # ours: on to the left lane, in which the centre is after 3 s
    assert checked(there).rule is Rule.NONE


# What holds in every scene


@given(scenes(), PROPOSALS)
def test_a_rule_is_reported_exactly_where_the_action_was_changed(
    world: Scene, proposed: Action
) -> None:
    verdict = paper(world, proposed, CONFIG)
    before = next_lane_change(world.lane_change, world.affordances.lane, proposed.lateral)
    after = next_lane_change(world.lane_change, world.affordances.lane, verdict.action.lateral)
    assert bool(verdict.rule & Rule.IN_LANE) is (
        verdict.action.longitudinal is not proposed.longitudinal
    )
    assert bool(verdict.rule & (Rule.OFF_ROAD | Rule.LANE_CHANGE)) is (before != after)


@given(scenes(), PROPOSALS)
def test_a_checked_action_passes_the_check(world: Scene, proposed: Action) -> None:
    executed = paper(world, proposed, CONFIG).action
    assert paper(world, executed, CONFIG) == Verdict(executed, Rule.NONE)


@given(scenes(), PROPOSALS)
def test_the_check_never_accelerates_nor_starts_a_lane_change_that_was_not_proposed(
    world: Scene, proposed: Action
) -> None:
    executed = paper(world, proposed, CONFIG).action
    if proposed.longitudinal is not ACCELERATE:
        assert executed.longitudinal is not ACCELERATE
    if world.lane_change is None:
        assert executed.lateral in (KEEP, proposed.lateral)


@given(scenes(), PROPOSALS)
def test_permit_all_never_changes_anything(world: Scene, proposed: Action) -> None:
    assert permit_all(world, proposed) == Verdict(proposed, Rule.NONE)


def test_checks_are_found_by_the_name_in_the_config() -> None:
    config = Config()
    assert named_check(config.updated("safety", check="permit_all")) is permit_all
    hasty = config.updated("safety", minimum_gap_m=0.0, minimum_ttc_s=1.0)
    proposal = Action(KEEP, ACCELERATE)
    assert named_check(config)(SLOW_LEADER, proposal).rule is Rule.IN_LANE
    assert named_check(hasty)(SLOW_LEADER, proposal).rule is Rule.NONE
