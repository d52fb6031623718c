"""The check ``strict``: stopping distances worked by hand, and the promise that its argument makes.

In steps of half a second a vehicle at 20 m/s that brakes at 4 m/s^2 has 18, 16, ... 2, 0 m/s and
rolls 45 m. The ego at 20 m/s ``reaches``, by a decision of one second and braking hard after it,

    accelerate   10.5 + 11 m, then 55 m from 22 m/s: 76.5 m
    maintain       10 + 10 m, then 45 m from 20 m/s: 65 m
    brake         9.5 +  9 m, then 36 m from 18 m/s: 54.5 m
    hard brake      9 +  8 m, then 28 m from 16 m/s: 45 m

and has to stay 0.5 m short of where the vehicle ahead comes to rest if that brakes now.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, event, example, given, settings
from hypothesis import strategies as st
from oracles.plan import next_lane_change
from worlds import (
    ALONE,
    BARRICADED_ROAD,
    CENTER,
    LANE_M,
    LEFT,
    LONG_ROAD,
    RIGHT,
    Car,
    ahead,
    behind,
    changing,
    scene,
)

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal, ego_numbers
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.road.road import Road, is_open
from drl_av.safety import named_check
from drl_av.safety.check import Rule, Verdict
from drl_av.safety.reachability import cut_in_gap, lateral_extent, reach, stays_behind
from drl_av.safety.strict import Strict, covered, fallback_lanes, seconds_to_line
from studies.options import FOLDER, Options
from studies.study import FileStudy
from verification.adversary import NONE, ROAD, Mover, Orders, World

CONFIG = Config().updated("safety", check="strict")
STRICT = Strict(CONFIG.strict, CONFIG.ego, CONFIG.simulation)
KEEP, TO_RIGHT, TO_LEFT = Lateral.KEEP, Lateral.RIGHT, Lateral.LEFT
MAINTAIN, ACCELERATE = Longitudinal.MAINTAIN, Longitudinal.ACCELERATE
BRAKE, HARD_BRAKE = Longitudinal.BRAKE, Longitudinal.HARD_BRAKE


def checked(world: Scene, lateral: Lateral = KEEP, how: Longitudinal = ACCELERATE) -> Verdict:
    return STRICT(world, Action(lateral, how))


def refused(instead: Lateral = KEEP, how: Longitudinal = MAINTAIN) -> Verdict:
    return Verdict(Action(instead, how), Rule.LANE_CHANGE)


def granted(lateral: Lateral, how: Longitudinal = MAINTAIN) -> Verdict:
    return Verdict(Action(lateral, how), Rule.NONE)


@pytest.mark.parametrize(
    ("how", "reach_m"), [(ACCELERATE, 76.5), (MAINTAIN, 65.0), (BRAKE, 54.5), (HARD_BRAKE, 45.0)]
)
def test_the_reaches_at_20_m_s_are_those_worked_by_hand(how: Longitudinal, reach_m: float) -> None:
    rate = how.acceleration_m_s2(CONFIG.ego)
    assert reach(20.0, rate, CONFIG.ego, CONFIG.simulation) == pytest.approx(reach_m)


# In the lane


@pytest.mark.parametrize(
    ("ahead_m_s", "gap", "executed"),
    [
        # at 20 m/s it rolls 45 m: 76.5 + 0.5 - 45 is 32, and 20.5, 10 and 0.5 likewise
        *((20.0, 32.01, ACCELERATE), (20.0, 31.99, MAINTAIN), (20.0, 20.51, MAINTAIN)),
        *((20.0, 20.49, BRAKE), (20.0, 10.01, BRAKE), (20.0, 9.99, HARD_BRAKE)),
        # at 10 m/s it rolls 8 + 6 + 4 + 2 m for half a second each, 10 m
        *((10.0, 67.01, ACCELERATE), (10.0, 66.99, MAINTAIN)),
        *((10.0, 45.01, BRAKE), (10.0, 44.99, HARD_BRAKE)),
        # it stands
        *((0.0, 77.01, ACCELERATE), (0.0, 76.99, MAINTAIN), (0.0, 65.51, MAINTAIN)),
        *((0.0, 65.49, BRAKE), (0.0, 55.01, BRAKE), (0.0, 54.99, HARD_BRAKE)),
        # at 30 m/s it rolls 105 m, more than any reach: even 0.51 m would do
        (30.0, 0.51, ACCELERATE),
    ],
)
def test_acceleration_is_weakened_as_far_as_stopping_behind_the_vehicle_ahead_asks(
    ahead_m_s: float, gap: float, executed: Longitudinal
) -> None:
    rule = Rule.NONE if executed is ACCELERATE else Rule.IN_LANE
    world = scene(ahead(gap, speed_m_s=ahead_m_s))
    assert checked(world) == Verdict(Action(KEEP, executed), rule)


@pytest.mark.parametrize("how", Longitudinal)
def test_a_proposal_is_never_made_faster(how: Longitudinal) -> None:
    assert checked(ALONE, KEEP, how) == granted(KEEP, how)
    close = scene(ahead(20.49))
    safe = {ACCELERATE: BRAKE, MAINTAIN: BRAKE}.get(how, how)
    assert checked(close, KEEP, how).action.longitudinal is safe


def test_at_its_highest_speed_the_ego_may_ask_for_more_and_gets_no_more() -> None:
    # at 30 m/s either action rolls 30 m and then 105 m; behind one as fast that leaves 30.5 m
    for gap, rule in ((30.51, Rule.NONE), (30.49, Rule.IN_LANE)):
        world = scene(ahead(gap, speed_m_s=30.0), speed_m_s=30.0)
        assert checked(world, KEEP, ACCELERATE).rule is rule
        assert checked(world, KEEP, MAINTAIN).rule is rule


def test_on_a_short_loop_one_counts_as_ahead_and_as_behind() -> None:
    # 200 m round: 105 m from bumper to bumper, and 85 m the other way, which is nearer. At 30 m/s
    # the ego reaches 27 + 78 m even by braking hard, and may reach 104.5
    loop = Road(200.0, LANE_M, (True, True, True))
    world = scene(ahead(105.0, speed_m_s=0.0), speed_m_s=30.0, road=loop)
    assert checked(world).action.longitudinal == HARD_BRAKE
    # at 20 m/s maintain reaches 65 m, less than the one 105 m ahead rolls on; it is also 85 m
    # behind, where 63.5 m would do, and 60 m would not
    for gap, verdict in ((85.0, granted(TO_LEFT)), (60.0, refused())):
        assert checked(scene(behind(gap, LEFT, 30.0), road=loop), TO_LEFT, MAINTAIN) == verdict


def test_the_vehicle_ahead_across_the_seam_of_the_loop_counts() -> None:
    for s_m in (100.0, 498.0):
        assert checked(scene(ahead(31.99), s_m=s_m)).action.longitudinal is MAINTAIN
        assert checked(scene(ahead(32.01), s_m=s_m)).action.longitudinal is ACCELERATE


@pytest.mark.parametrize(
    ("other", "counts"),
    [
        (ahead(20.0, LEFT), False),
        (ahead(20.0, LEFT - 0.06, v_y=-0.76), True),  # it has just begun to move in
        (ahead(20.0, LEFT - 0.04, v_y=-0.76), False),  # it wavers about its centre
        (ahead(20.0, LEFT - 0.38, v_y=-0.76), True),
        (ahead(20.0, LEFT - 0.38, v_y=0.0), False),  # beside the middle, but not on the move
        (ahead(20.0, LEFT - 0.38, v_y=-0.02), True),
        (ahead(20.0, LEFT - 0.38, v_y=0.76), False),  # on its way back
        (ahead(20.0, LEFT - 0.99, v_y=0.0), False),  # 5.71 is its right side, the line is at 5.7
        (ahead(20.0, LEFT - 1.02, v_y=0.0), True),  # 2 cm over the line
        (ahead(20.0, RIGHT + 1.02, v_y=0.0), True),
        (ahead(20.0, LEFT - 1.02, v_y=0.76), True),  # still there, though it leaves
        (ahead(20.0, RIGHT + 0.06, v_y=0.76), True),
        (behind(1.0), False),
        (Car(0.0, LEFT), False),
    ],
)
def test_who_is_in_the_ego_s_lane_or_on_the_way_there_counts(other: Car, counts: bool) -> None:
    # at 20 m and 20 m/s it leaves room for braking only
    executed = checked(scene(other)).action.longitudinal
    assert executed is (BRAKE if counts else ACCELERATE)


def test_a_body_over_the_line_has_two_lanes_full_of_vehicles_ahead() -> None:
    # 2 s into a change to the left the left side is at 6.22 m, over the line at 5.7 m
    for y_m in (CENTER, LEFT):
        world = changing(ahead(20.0, y_m), origin=1, target=2, seconds=2)
        assert checked(world).action.longitudinal is BRAKE
    world = changing(ahead(20.0, LEFT), origin=1, target=2, seconds=1)
    assert checked(world, TO_RIGHT) == granted(TO_RIGHT, ACCELERATE)


@pytest.mark.parametrize("how", Longitudinal)
def test_where_nothing_is_permitted_the_ego_brakes_hard(how: Longitudinal) -> None:
    assert not STRICT.fallback_is_free(scene(ahead(0.49)))
    assert STRICT.fallback_is_free(scene(ahead(0.51)))
    rule = Rule.NONE if how is HARD_BRAKE else Rule.IN_LANE
    assert checked(scene(ahead(0.49)), KEEP, how) == Verdict(Action(KEEP, HARD_BRAKE), rule)


def test_a_fast_one_that_moves_in_from_beside_makes_the_ego_brake_hard() -> None:
    # though it would come to rest far ahead
    world = scene(Car(2.0, LEFT - 0.38, 30.0, -0.76))
    assert checked(world) == Verdict(Action(KEEP, HARD_BRAKE), Rule.IN_LANE)


# Lane changes


@pytest.mark.parametrize(
    ("y_m", "road"), [(RIGHT, LONG_ROAD), (CENTER, BARRICADED_ROAD)], ids=["edge", "barricade"]
)
def test_no_lane_change_off_the_road(y_m: float, road: Road) -> None:
    world = scene(y_m=y_m, road=road)
    assert checked(world, TO_RIGHT) == Verdict(Action(KEEP, ACCELERATE), Rule.OFF_ROAD)
    assert checked(world, TO_LEFT) == granted(TO_LEFT, ACCELERATE)
    close = scene(ahead(20.0, y_m), y_m=y_m, road=road)
    both = Rule.OFF_ROAD | Rule.IN_LANE
    assert checked(close, TO_RIGHT) == Verdict(Action(KEEP, BRAKE), both)


@pytest.mark.parametrize(("side", "y_m"), [(TO_RIGHT, RIGHT), (TO_LEFT, LEFT)])
def test_a_lane_change_needs_room_to_stop_behind_the_one_ahead_there(
    side: Lateral, y_m: float
) -> None:
    # at 10 m/s it rolls 10 m: maintain needs 65 + 0.5 - 10 m
    assert checked(scene(ahead(55.49, y_m, 10.0)), side, MAINTAIN) == refused()
    assert checked(scene(ahead(55.51, y_m, 10.0)), side, MAINTAIN) == granted(side)


def test_a_lane_change_free_at_a_milder_speed_alone_is_refused_and_not_slowed() -> None:
    # one 60 m ahead on the left at 10 m/s rolls 10 m: 69.5 m, of which accelerate reaches 76.5
    world = scene(ahead(60.0, LEFT, 10.0))
    assert checked(world, TO_LEFT, ACCELERATE) == refused(how=ACCELERATE)
    assert checked(world, TO_LEFT, MAINTAIN) == granted(TO_LEFT)


@pytest.mark.parametrize("offset_m", [-4.99, -2.0, 0.0, 2.0, 4.99])
def test_one_beside_refuses_the_lane_change(offset_m: float) -> None:
    assert checked(scene(Car(offset_m, LEFT)), TO_LEFT, MAINTAIN) == refused()
    assert checked(scene(Car(offset_m, LEFT)), TO_RIGHT, MAINTAIN) == granted(TO_RIGHT)


@pytest.mark.parametrize(("how", "gap"), [(MAINTAIN, 63.5), (ACCELERATE, 52.0), (BRAKE, 74.0)])
def test_a_fast_one_behind_must_come_to_rest_behind_the_ego(how: Longitudinal, gap: float) -> None:
    # at 30 m/s it rolls 15.5 m while it accelerates for half a second, then, at 31 m/s,
    # 29 + 27 + ... + 1 m/s for half a second each, 112.5 m: 128 m; the ego comes 65, 76.5 or 54.5 m
    assert checked(scene(behind(gap + 0.01, LEFT, 30.0)), TO_LEFT, how) == granted(TO_LEFT, how)
    assert checked(scene(behind(gap - 0.01, LEFT, 30.0)), TO_LEFT, how) == refused(how=how)


def test_one_behind_sees_the_ego_only_when_its_body_is_over_the_line() -> None:
    # 1 s into the change the left side is 0.24 m from the line, which takes 0.32 s, so one SUMO
    # step: it accelerates for a second, 31.5 m, then rolls 120 m from 32 m/s; 151.5 + 0.5 - 65
    far = changing(behind(87.01, LEFT, 30.0), origin=1, target=2, seconds=1)
    near = changing(behind(86.99, LEFT, 30.0), origin=1, target=2, seconds=1)
    assert checked(far, KEEP, MAINTAIN) == granted(KEEP)
    assert checked(near, KEEP, MAINTAIN) == refused(TO_RIGHT)


def test_the_body_is_over_the_line_by_a_centimetre() -> None:
    # 7.6 s a lane change are 0.25 m a step: from 0.5 m two steps lead to the line, three over it
    config = CONFIG.updated("ego", lane_change_duration_s=7.6)
    # where the number of steps is whole, rounding may add one: 0.49 m
    for distance_m, seconds in ((0.5, 0.0), (0.49, 1.5), (0.48, 1.0), (0.0, 0.5), (-0.02, 0.0)):
        found = seconds_to_line(distance_m, LANE_M, ego_numbers(config.ego, config.simulation))
        assert found == pytest.approx(seconds, abs=1e-9)


def test_one_behind_that_accelerates_less_than_the_ego_must_not_come_to_it_in_between() -> None:
    # the ego at 10.04 m/s covers 5.52 and 6.02 m a step; one at 10.33 m/s that accelerates with
    # 1.5 m/s^2 covers 5.54 and 5.915 m, and stops 0.62 m before the place where the ego stops
    strict = replace(CONFIG.strict, acceleration_m_s2=1.5)
    covered_m = covered(10.04, ego_numbers(CONFIG.ego, CONFIG.simulation))[ACCELERATE]
    assert covered_m[:2] == pytest.approx([5.52, 11.54])
    for gap_m, crosses_s, stays in ((0.03, 0.5, True), (0.01, 0.5, False), (0.01, 0.0, True)):
        assert stays_behind(gap_m, False, 10.33, crosses_s, covered_m, strict, 0.5) is stays


def test_one_behind_in_the_ego_s_own_lane_is_held_there_and_forbids_nothing() -> None:
    # 10 m behind at 30 m/s; were it not held it would have to be 63.5 m behind
    assert checked(scene(behind(10.0, CENTER, 30.0)), TO_LEFT, MAINTAIN) == granted(TO_LEFT)
    # over the line, too, it may come past the ego on the left, and in the next lane anyway
    for y_m in (CENTER + 1.5, LEFT):
        assert checked(scene(behind(10.0, y_m, 30.0)), TO_LEFT, MAINTAIN) == refused()
    # and past an ego that is over the line as little as that: at 5.32 m, it at 7.6 m
    near, far = (
        changing(behind(gap, LEFT, 30.0), origin=1, target=2, seconds=2) for gap in (63.49, 63.51)
    )
    assert checked(near, KEEP, MAINTAIN) == refused(TO_RIGHT)
    assert checked(far, KEEP, MAINTAIN) == granted(KEEP)


def test_one_that_may_move_into_the_same_lane_counts_as_soon_as_it_moves() -> None:
    # the ego from the right lane, the other from the left one, beside it, 1 s under way
    still = changing(Car(0.0, LEFT), origin=0, target=1, seconds=1)
    assert checked(still, KEEP, MAINTAIN) == granted(KEEP)
    moving = changing(Car(0.0, LEFT - 0.76, 20.0, -0.76), origin=0, target=1, seconds=1)
    assert checked(moving, KEEP, MAINTAIN) == refused(TO_RIGHT)
    leaving = changing(Car(0.0, LEFT - 0.76, 20.0, 0.76), origin=0, target=1, seconds=1)
    assert checked(leaving, KEEP, MAINTAIN) == granted(KEEP)


def test_two_that_enter_one_lane_from_both_sides_turn_the_ego_back() -> None:
    # begun together, seen at 1 s: both have come 0.76 m and the ego's body is in its lane still
    first = changing(Car(0.0, LEFT - 0.76, 20.0, -0.76), origin=0, target=1, seconds=1)
    assert checked(first, TO_LEFT, MAINTAIN) == refused(TO_RIGHT)
    # begun after the ego, seen at 2 s: its body is over the line but not its centre, and whatever
    # the other one does now, it may be where the body is; so the ego brakes, too
    second = changing(Car(0.0, LEFT - 0.76, 20.0, -0.76), origin=0, target=1, seconds=2)
    both = Rule.IN_LANE | Rule.LANE_CHANGE
    assert checked(second, TO_LEFT, MAINTAIN) == Verdict(Action(TO_RIGHT, HARD_BRAKE), both)


def test_one_quick_enough_to_come_over_the_line_within_a_decision_counts_before_it_moves() -> None:
    # the ego's way ends at 8.5 m; one at 1.5 m/s comes from 10 m. The line is at 9.5 m
    road = replace(LONG_ROAD, open_lanes=(True,) * 4)
    quick = Strict(replace(CONFIG.strict, lateral_speed_m_s=1.5), CONFIG.ego, CONFIG.simulation)
    proposed = Action(TO_LEFT, MAINTAIN)
    for right_side_m, verdict in ((9.99, refused()), (10.01, granted(TO_LEFT))):
        world = scene(Car(0.0, right_side_m + 0.9), road=road)
        assert quick(world, proposed) == verdict
        assert STRICT(world, proposed) == granted(TO_LEFT)


def test_the_way_out_of_a_lane_change_leads_to_the_lane_that_the_centre_is_in() -> None:
    # 2 s on it is at 5.32 m, in the centre lane; 3 s on at 6.08 m, in the left one
    beside_left, beside_right = Car(0.0, LEFT), Car(0.0, CENTER)
    back = changing(beside_left, origin=1, target=2, seconds=2)
    both = Rule.IN_LANE | Rule.LANE_CHANGE
    assert checked(back, KEEP, MAINTAIN) == Verdict(Action(TO_RIGHT, HARD_BRAKE), both)
    on = changing(beside_right, origin=1, target=2, seconds=3)
    assert checked(on, TO_RIGHT, MAINTAIN) == Verdict(Action(TO_LEFT, HARD_BRAKE), both)
    assert checked(on, KEEP, HARD_BRAKE) == granted(KEEP, HARD_BRAKE)


def test_a_lane_change_asked_for_too_close_to_the_vehicle_ahead_is_braked_and_turned_back() -> None:
    world = changing(ahead(0.3), origin=1, target=2, seconds=1)
    both = Rule.IN_LANE | Rule.LANE_CHANGE
    assert checked(world, KEEP, ACCELERATE) == Verdict(Action(TO_RIGHT, HARD_BRAKE), both)


def test_bounds_and_traffic_may_be_moved_together() -> None:
    quick = CONFIG.updated("traffic", acceleration_max_m_s2=3.0)
    named_check(quick.updated("strict", acceleration_m_s2=3.0))
    for cell in FileStudy(FOLDER / "strict.toml").plan(Options()).cells:
        named_check(cell.config)


def test_a_steered_lane_change_is_none_of_its_business() -> None:
    with pytest.raises(ConfigError, match="take that, or the check paper"):
        named_check(CONFIG.updated("ego", lateral_plant="steering"))


@pytest.mark.parametrize("reference", ["idm", "acc"])
def test_those_behind_count_on_no_more_than_the_hardest_braking_of_a_model(reference: str) -> None:
    config = CONFIG.updated("ego", longitudinal_reference=reference)
    followed, others = named_check(config), (10.0, config.strict)
    gaps = (
        cut_in_gap(20.0, rate, *others, ego, config.simulation)
        for rate, ego in ((0.0, config.ego), (2.0, CONFIG.ego))
    )
    assert [*map(float, gaps)] == [67.0, 67.0]  # 76.5 + 0.5 - 10: it may accelerate at any time
    # one behind at 30 m/s rolls 128 m; by maintain the ego comes 65 m, braking hard 45 m
    for gap, verdict in ((83.51, granted(TO_LEFT)), (83.49, refused())):
        world = scene(behind(gap, LEFT, 30.0))
        assert followed(world, Action(TO_LEFT, MAINTAIN)) == verdict
        assert checked(world, TO_LEFT, MAINTAIN) == granted(TO_LEFT)
    # those ahead see the ego come as far as maintain may take it: 65 + 0.5 - 45
    assert followed(scene(ahead(20.51)), Action(KEEP, MAINTAIN)) == granted(KEEP)
    assert followed(scene(ahead(20.49)), Action(KEEP, MAINTAIN)).action.longitudinal == BRAKE


# The promise


def standing(gap_m: float) -> World:
    """Both stand, and the other one is about to move into the ego's lane."""
    return World(
        x_m=np.array([[5000.0, 5005.0 + gap_m]]),
        y_m=np.array([[0.0, 3.04]]),
        speed_m_s=np.zeros((1, 2)),
        lateral_m_s=np.zeros((1, 2)),
        origin=np.array([NONE]),
        target=np.array([NONE]),
        lane_s=np.full((1, 3), np.inf),
    )


def from_both_sides() -> World:
    """Both stand and are to move into the middle lane: the ego from the left, then the other."""
    world = standing(0.5)
    world.y_m, world.lateral_m_s = np.array([[6.84, 0.0]]), np.array([[-0.76, -0.76]])
    world.origin, world.target = np.array([2]), np.array([1])
    return world


def lanes_of(scene: Scene, row: int) -> set[int]:
    """Those that its body is over, and the one that it moves towards."""
    shot = scene.snapshot
    place = (values[row] for values in (shot.y_m, shot.lateral_speed_m_s, shot.width_m))
    right_m, left_m = lateral_extent(*place, LANE_M)
    return {lane for lane in range(3) if right_m < lane * LANE_M < left_m}


@st.composite
def pursuits(draw: st.DrawFn) -> World:
    """The ego, which may be in a lane change, and one vehicle ahead anywhere across the road."""
    lane, seconds = draw(st.integers(0, 2)), draw(st.integers(0, 4))
    target = draw(st.sampled_from([t for t in (lane - 1, lane + 1) if 0 <= t <= 2]))
    sign = target - lane if seconds else 0
    speed, other = draw(st.floats(0, 30)), draw(st.floats(0, 40))
    side = draw(st.sampled_from([-1, 0, 1]))
    places = st.sampled_from([k * 0.38 for k in range(21)])
    return World(
        x_m=np.array([[5000.0, 5005.0 + draw(st.floats(0.01, 150.0))]]),
        y_m=np.array([[lane * LANE_M + sign * 0.76 * seconds, draw(places)]]),
        speed_m_s=np.array([[speed, other]]),
        lateral_m_s=np.array([[0.76 * sign, 0.76 * side]]),
        origin=np.array([lane if seconds else NONE]),
        target=np.array([target if seconds else NONE]),
        lane_s=np.full((1, 3), np.inf),
    )


@given(
    pursuits(), st.sampled_from(ACTIONS), st.floats(-4.0, 2.0), st.sampled_from([-1.0, 0.0, 1.0])
)
@example(standing(0.5), Action(KEEP, MAINTAIN), 0.0, -1.0)  # the clearance, and no more
@example(standing(0.51), Action(KEEP, MAINTAIN), 0.0, -1.0)
@example(from_both_sides(), Action(KEEP, MAINTAIN), 0.0, 1.0)
@settings(max_examples=300)
def test_a_free_way_out_is_free_again_at_the_next_decision_whatever_the_one_ahead_does(
    world: World, proposed: Action, acceleration: float, side: float
) -> None:
    before = world.scene(0)
    assume(STRICT.fallback_is_free(before))
    executed = STRICT(before, proposed).action
    orders = Orders(np.array([proposed.number]), np.array([[acceleration]]), np.array([[side]]))
    Mover(CONFIG).decision(world, np.array([executed.number]), orders)
    event(f"{executed}, proposal kept: {executed == proposed}")
    assert world.least_m.min() > 0
    after = world.scene(0)
    if not STRICT.fallback_is_free(after):  # the one exception: into one lane from both sides
        assert lanes_of(after, 0) & lanes_of(after, 1) - lanes_of(before, 1)
        assert executed.lateral != KEEP or before.lane_change is not None
        back = STRICT(after, proposed).action
        change = next_lane_change(after.lane_change, after.affordances.lane, back.lateral)
        lanes = (0, 0) if change is None else (change.origin, change.target)
        assert lanes == fallback_lanes(*after.lanes, after.affordances.lane)
        assert back.longitudinal == HARD_BRAKE
    changed = next_lane_change(before.lane_change, before.affordances.lane, executed.lateral)
    assert changed is None or is_open(changed.target, ROAD)
