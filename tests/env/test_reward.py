"""The three terms of the reward, as printed, and what they are measured against."""

import dataclasses
import math
from math import exp

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from reward_terms import Desired, desired, rewards
from worlds import (
    ALONE,
    BARRICADED_ROAD,
    CENTER,
    LANE_M,
    LEAVE,
    LEFT,
    MERGE,
    RIGHT,
    Car,
    ahead,
    behind,
    scene,
    scenes,
)

from drl_av.config import RewardConfig, SafetyConfig
from drl_av.driving.affordances import NO_VEHICLE, Indicators, has_lane
from drl_av.driving.scene import Scene
from drl_av.env.reward import (
    gap_reward,
    lane_speed,
    lateral_reward,
    safe_gap,
    speed_reward,
    tolerated_speed,
)

TRAFFIC = RewardConfig(catch_up_time_s=8.0, worthwhile_gain_m_s=1.0, speed_tolerance_m_s=0.0)
FIXED = RewardConfig(desired="fixed")
TOLERANT = RewardConfig(speed_tolerance_m_s=1.0)
SAFETY = SafetyConfig()
MINIMUM_GAP_M = SAFETY.minimum_gap_m
SPEEDS = st.floats(0, 60)


BEST_LANE = dataclasses.replace(TRAFFIC, desired="best-lane")


def wanted_by(world: Scene, config: RewardConfig = TRAFFIC) -> tuple[float, float]:
    """The desired speed and lateral position of the ego in the traffic."""
    return tuple(desired(world.indicators, config, SAFETY))


@pytest.mark.parametrize(
    ("s_m", "lane", "desired_lane"),
    [
        (338.0, 2, 2),  # two lane changes within 809.5 m: not within 400 m for each
        (348.0, 2, 1),  # one of the two is due from 800 m on, within 799.5 m
        (748.0, 2, 0),  # both within 399.5 m
        (348.0, 1, 1),  # one within 799.5 m
        (748.0, 1, 0),  # one within 399.5 m, though the lane to the right begins at 900 m
        (1148.0, 1, 1),  # missed
        (1000.0, 0, 0),
    ],
)
def test_y_des_is_the_lane_of_the_exit_within_400_m_for_each_lane_change(
    s_m: float, lane: int, desired_lane: int
) -> None:
    world = scene(s_m=s_m, y_m=lane * LANE_M, road=LEAVE)
    assert wanted_by(world)[1] == pytest.approx(desired_lane * LANE_M)


def test_no_lane_is_desired_for_its_speed_where_the_way_demands_a_lane_change() -> None:
    # one at 10 m/s ahead, the lane to the left free, a vehicle beside it to the right
    slow, beside = ahead(50.0, CENTER, 10.0), Car(0.0, RIGHT)
    assert wanted_by(scene(slow, beside, s_m=700.0, road=LEAVE))[1] == LEFT  # within 447.5 m
    assert wanted_by(scene(slow, beside, s_m=1000.0, road=LEAVE))[1] == RIGHT


def test_v_des_is_the_speed_that_the_next_lane_of_the_way_allows() -> None:
    # 10 m/s ahead, with 15 m of spare room: 10 + (30 - 15) / 8; 12 m/s ahead to the right, where
    # d_safe is 1.3 * 12 m: 12 + (19.6 - 15.6) / 8; to the left all is free
    own, right = ahead(30.0, CENTER, 10.0), ahead(19.6, RIGHT, 12.0)
    assert wanted_by(scene(own, right, s_m=1000.0, road=LEAVE))[0] == pytest.approx(12.5)
    assert wanted_by(scene(own, right, s_m=700.0, road=LEAVE))[0] == pytest.approx(11.875)
    # at 800 m the lane to the right is not there yet
    assert wanted_by(scene(own, right, s_m=800.0, road=LEAVE))[0] == pytest.approx(11.875)


def test_on_the_acceleration_lane_the_lane_that_it_joins_is_desired_and_its_speed() -> None:
    # 185.5 m before its end, the acceleration lane alone would allow (185.5 - 15) / 8 m/s
    car = ahead(31.0, LANE_M, 20.0)  # d_safe is 26 m: 20 + 5 / 8
    beside = scene(car, s_m=612.0, y_m=RIGHT, road=MERGE)
    assert wanted_by(beside) == pytest.approx((20.625, LANE_M))
    on_ramp = scene(car, s_m=500.0, y_m=RIGHT, road=MERGE)  # divided up to 550 m
    assert wanted_by(on_ramp) == pytest.approx((30.0, LANE_M))
    blocked = scene(behind(5.0, LANE_M), s_m=612.0, y_m=RIGHT, road=MERGE)
    assert wanted_by(blocked) == pytest.approx((30.0, LANE_M))


@pytest.mark.parametrize(
    ("speed", "wanted", "reward"),
    [
        (30, 30, 0.0),
        (27, 30, -0.593430),  # exp(-9/10) - 1; not exp(-3/10) - 1, not exp(-9/20) - 1
        (33, 30, -0.593430),  # too fast is as bad as too slow
        (20, 30, -0.999955),
    ],
)
def test_speed_reward_is_equation_6(speed: float, wanted: float, reward: float) -> None:
    assert speed_reward(speed, wanted) == pytest.approx(reward, abs=1e-6)


@pytest.mark.parametrize(
    ("lateral", "wanted", "reward"),
    [(3.8, 3.8, 0.0), (0.0, 3.8, -0.764018), (7.6, 3.8, -0.764018), (2.8, 3.8, -0.095163)],
)
def test_lateral_reward_is_equation_7(lateral: float, wanted: float, reward: float) -> None:
    assert lateral_reward(lateral, wanted) == pytest.approx(reward, abs=1e-6)


@pytest.mark.parametrize(
    ("gap", "safe", "reward"),
    [
        (20, 40, -0.632121),  # exp(-400/400) - 1: the exponent is divided by 10 d_safe, not 10
        (39, 40, -0.002497),
        (0, 40, -0.981684),
        (40, 40, 0.0),
        (60, 40, 0.0),  # one-sided: further away is no worse
    ],
)
def test_gap_reward_is_equation_8(gap: float, safe: float, reward: float) -> None:
    assert gap_reward(gap, safe) == pytest.approx(reward, abs=1e-6)


@pytest.mark.parametrize(
    ("speed", "gap"), [(20, 26.0), (30, 39.0), (11.6, 15.08), (11.5, 15.0), (0, 15.0)]
)
def test_safe_gap_is_1_3_s_of_headway_but_at_least_15_m(speed: float, gap: float) -> None:
    assert safe_gap(speed, 1.3, MINIMUM_GAP_M) == pytest.approx(gap)


@given(scenes(), st.sampled_from([TRAFFIC, FIXED, TOLERANT]))
def test_every_term_lies_between_minus_one_and_zero(world: Scene, config: RewardConfig) -> None:
    terms = rewards(world, config)
    assert all(-1 <= term <= 0 for term in (*terms, terms.total))
    assert terms.total == pytest.approx(sum(terms) / 3)


def test_terms_of_a_scene_read_the_vehicle_ahead_in_the_own_lane_only() -> None:
    # 20 m/s wants 26 m; 10 m behind a leader that is 6 m/s slower, others nearer
    world = scene(ahead(16, CENTER, 14.0), ahead(3, LEFT), behind(2, CENTER), y_m=CENTER - 0.76)
    terms = rewards(world, dataclasses.replace(FIXED, desired_speed_m_s=23.0))
    assert terms.r_v == pytest.approx(exp(-0.9) - 1)
    assert terms.r_y == pytest.approx(exp(-(0.76**2) / 10) - 1)
    assert terms.r_x == pytest.approx(exp(-100 / 260) - 1)
    assert rewards(scene(ahead(16, CENTER, 14.0)), FIXED).r_x == pytest.approx(terms.r_x)
    assert terms.total == pytest.approx((exp(-0.9) + exp(-0.05776) + exp(-100 / 260)) / 3 - 1)


def test_without_a_vehicle_ahead_the_gap_costs_nothing() -> None:
    assert rewards(ALONE, dataclasses.replace(FIXED, desired_speed_m_s=20.0)).total == 0


def test_fixed_desired_values_are_30_m_s_in_the_centre_lane_whatever_the_traffic() -> None:
    world = scene(ahead(16, CENTER, 14.0), y_m=RIGHT)
    assert desired(world.indicators, FIXED, SAFETY) == Desired(30.0, 3.8)


@pytest.mark.parametrize(
    ("gap", "leader", "speed"),
    [
        (26, 20, 20.0),  # at the safe gap of the leader's speed: no more than the leader
        (10, 20, 20.0),  # closer: no less either
        (50, 20, 23.0),  # 24 m to spare, in 8 s; with the ego's 22 m/s it would be 22.675
        (31, 10, 12.0),  # 15 m are kept at least: 16 m to spare, not 18
        (240, 20, 30.0),  # 46.75, were it not for the speed of a free road
        (26, 32, 30.0),
    ],
)
def test_attainable_speed_is_that_of_the_leader_and_what_closing_the_gap_adds(
    gap: float, leader: float, speed: float
) -> None:
    world = scene(ahead(gap, CENTER, leader), ahead(5, LEFT, 1.0), speed_m_s=22.0)
    values, codes, *_ = world.indicators
    assert lane_speed(values, codes, 0, TRAFFIC, SAFETY) == pytest.approx(speed)


@pytest.mark.parametrize(
    ("speed", "attainable", "wanted"),
    [
        (20.0, 20.0, 20.0),
        (21.0, 20.4, 21.0),  # 0.6 m/s off: no decision, of 2 m/s, brings it nearer
        (19.4, 20.4, 19.4),  # just within 1 m/s
        (19.0, 20.4, 19.4),  # 1.4 m/s off: the near edge, neither 20.4 nor 19
        (22.0, 20.4, 21.4),
        (29.5, 30.0, 30.0),  # a free road: 30 m/s is what the ego can reach exactly
        (30.0, 29.6, 30.0),
        (33.0, 29.6, 30.0),  # never above the speed of a free road
    ],
)
def test_behind_a_vehicle_the_ego_wants_its_own_speed_where_that_is_within_half_a_step(
    speed: float, attainable: float, wanted: float
) -> None:
    assert tolerated_speed(speed, attainable, TOLERANT) == pytest.approx(wanted)


@given(SPEEDS, st.floats(0, 30), st.floats(0, 10))
def test_the_speed_wanted_is_never_further_than_the_tolerance_from_what_the_lane_allows(
    speed: float, attainable: float, tolerance: float
) -> None:
    config = RewardConfig(speed_tolerance_m_s=tolerance)
    wanted = tolerated_speed(speed, attainable, config)
    assert abs(wanted - attainable) <= tolerance + 1e-9
    assert abs(speed - wanted) <= abs(speed - attainable)
    if speed <= 30 and attainable < 30 and abs(speed - attainable) < tolerance - 1e-9:
        assert wanted == speed


def test_alone_the_ego_wants_30_m_s_in_the_lane_where_it_is() -> None:
    for y_m in (RIGHT, CENTER, LEFT):
        assert wanted_by(scene(y_m=y_m)) == pytest.approx((30.0, y_m))


def test_off_the_centre_the_ego_wants_the_centre_of_its_lane() -> None:
    assert wanted_by(scene(y_m=CENTER + 0.76)) == pytest.approx((30.0, CENTER))


def in_three_lanes(right: float, own: float, left: float) -> Scene:
    """Leaders at those speeds, each at its safe gap: each lane allows its leader's speed."""
    return scene(*(ahead(1.3 * v, y, v) for y, v in ((RIGHT, right), (CENTER, own), (LEFT, left))))


@pytest.mark.parametrize(
    ("right", "own", "left", "lane"),
    [
        (12, 20, 15, CENTER),
        (12, 20, 20.9, CENTER),  # better, but not worth a lane change
        (12, 20, 21.1, LEFT),
        (25, 20, 22, RIGHT),  # both are better: the best
        (22, 20, 25, LEFT),
        (21.6, 20, 21.3, RIGHT),  # the best, though not by 1 m/s over the other
        (29.5, 29.2, 30, CENTER),
    ],
)
def test_the_best_lane_is_wanted_and_the_speed_of_the_own_one_until_the_ego_is_there(
    right: float, own: float, left: float, lane: float
) -> None:
    assert wanted_by(in_three_lanes(right, own, left)) == pytest.approx((own, lane))


@pytest.mark.parametrize(
    ("right", "own", "left", "speed", "lane"),
    [
        (12, 20, 15, 20, CENTER),
        (12, 20, 20.9, 20.9, CENTER),  # the speed of a lane that is not worth a lane change
        (25, 20, 22, 25, RIGHT),
    ],
)
def test_the_speed_of_the_best_lane_can_be_wanted_at_once(
    right: float, own: float, left: float, speed: float, lane: float
) -> None:
    found = wanted_by(in_three_lanes(right, own, left), BEST_LANE)
    assert found == pytest.approx((speed, lane))


def test_the_speed_of_the_best_lane_is_wanted_where_rule_3_bars_it_but_no_closed_one_s() -> None:
    # one alongside at the left, which is otherwise free; the right lane is free, or closed
    others = (ahead(26, CENTER, 20.0), behind(1, LEFT, 20.0))
    slow_right = scene(*others, ahead(26, RIGHT, 20.0))
    assert wanted_by(slow_right, BEST_LANE) == pytest.approx((30.0, CENTER))
    closed = scene(ahead(26, CENTER, 20.0), ahead(26, LEFT, 20.0), road=BARRICADED_ROAD)
    assert wanted_by(closed, BEST_LANE) == pytest.approx((20.0, CENTER))


def test_the_tolerance_is_for_the_speed_and_never_for_the_lane() -> None:
    # 20.4 m/s allowed ahead, 23.3 at the left: 2.9 more, too little for 3 m/s, though from 20
    # m/s, which is near enough to 20.4, it would be 3.3
    world = in_three_lanes(12, 20.4, 23.3)
    assert wanted_by(world, TOLERANT) == pytest.approx((20.0, CENTER))


def test_past_the_line_the_speed_of_the_new_lane_is_wanted() -> None:
    others = (ahead(20, RIGHT, 10.0), ahead(26, CENTER, 20.0), ahead(32.5, LEFT, 25.0))
    before, past = (scene(*others, y_m=CENTER + 0.76 * k, v_y=0.76) for k in (2, 3))
    assert wanted_by(before) == pytest.approx((20.0, LEFT))
    assert wanted_by(past) == pytest.approx((25.0, LEFT))


def test_a_lane_that_is_none_is_not_wanted_however_free() -> None:
    # 20 m behind a leader at 12 m/s: 15.6 m are safe, 4.4 m in 8 s are 0.55 m/s
    free_at_the_right = (ahead(20, CENTER, 12.0), ahead(20, LEFT, 12.0))
    assert wanted_by(scene(*free_at_the_right, speed_m_s=12.0)) == pytest.approx((12.55, RIGHT))
    barricaded = scene(*free_at_the_right, speed_m_s=12.0, road=BARRICADED_ROAD)
    assert wanted_by(barricaded) == pytest.approx((12.55, CENTER))
    at_the_left_edge = scene(*free_at_the_right, speed_m_s=12.0, y_m=LEFT)
    assert wanted_by(at_the_left_edge) == pytest.approx((12.55, LEFT))


@pytest.mark.parametrize(
    ("rear_m", "rear", "front_m", "lane"),
    [
        (22, 22, 30, LEFT),  # 22 - 3 * 2 = 16 m, and 15 are the least
        (20, 22, 30, CENTER),  # 14 m
        (20, 20, 30, LEFT),  # as near, but not closing
        (22, 22, 15, CENTER),  # too near to the vehicle ahead to leave its lane
    ],
)
def test_a_lane_that_rule_3_bars_is_not_wanted(
    rear_m: float, rear: float, front_m: float, lane: float
) -> None:
    world = scene(ahead(front_m, CENTER, 20.0), behind(rear_m, LEFT, rear), ahead(5, RIGHT))
    assert wanted_by(world)[1] == pytest.approx(lane)


def seen_again(vector: np.ndarray) -> Indicators:
    """What the ego saw, read back from the 27 indicators alone."""
    slots = vector[:24].reshape(6, 4)
    lane = math.floor(vector[25] / LANE_M + 0.5)
    missing = ~slots[:, [0, 1, 3]].any(axis=1)
    rows = np.where(missing | (slots[:, 0] >= 250), NO_VEHICLE, 0)
    lanes = [not all(missing[first : first + 2]) for first in (2, 4)]
    values, codes = np.append(vector, (math.inf, math.inf, 0.0)), np.array([*rows, lane, *lanes, 0])
    return Indicators(values, codes, (0.0, LANE_M, np.empty((0, 3))), 250.0, np.empty((0, 4)))


@given(scenes(), st.sampled_from([TRAFFIC, TOLERANT]))
def test_desired_values_are_a_function_of_the_observation_alone(
    world: Scene, config: RewardConfig
) -> None:
    again = seen_again(world.indicators.values[:27])
    for sign in (1, -1):
        assume(has_lane(again.codes, sign) == has_lane(world.indicators.codes, sign))
    # one alongside at the ego's own velocity looks like a wall
    for neighbor in world.affordances[:6]:
        assume(neighbor is None or any((neighbor[1], neighbor[2], neighbor[4])))
    assert tuple(desired(again, config, SAFETY)) == pytest.approx(wanted_by(world, config))


def test_desired_lane_is_within_reach_of_one_lane_change() -> None:
    # the left lane is free, two lanes over: from the right one the ego cannot see it
    slow = (ahead(20, RIGHT, 10.0), ahead(25, CENTER, 10.0))
    world = scene(*slow, y_m=RIGHT, speed_m_s=10.0)
    assert wanted_by(world)[1] == pytest.approx(RIGHT)


@pytest.mark.parametrize(("aside_m", "y_m"), [(0.3, LEFT), (0.0, LEFT), (-0.3, RIGHT)])
def test_of_two_lanes_that_are_as_good_the_nearer_one_is_desired(
    aside_m: float, y_m: float
) -> None:
    blocked = scene(ahead(60.0, speed_m_s=10.0), y_m=CENTER + aside_m)
    assert wanted_by(blocked, RewardConfig())[1] == y_m
