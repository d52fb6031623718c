"""MOBIL's two criteria, with accelerations worked out by hand."""

import math

import pytest
from worlds import BARRICADED_ROAD, LEFT, RIGHT, Car, ahead, behind, scene

from drl_av.config import Config, MobilConfig
from drl_av.drivers.rule_based import MobilDriver, mandatory_bias, mobil_gain
from drl_av.driving.actions import Lateral
from drl_av.driving.affordances import CHANGES, WITHIN
from drl_av.driving.car_following import idm_acceleration
from drl_av.driving.scene import Scene

CONFIG = Config()


def driver(**mobil: float) -> MobilDriver:
    return MobilDriver(CONFIG.safety, CONFIG.ego, MobilConfig(**mobil))


def test_idm_on_a_free_road_at_half_the_desired_speed() -> None:
    # a (1 - (15/30)^4) = 1.5 * (1 - 1/16) = 1.40625
    assert idm_acceleration(15, 30, math.inf, 0, MobilConfig()) == pytest.approx(1.40625)


def test_idm_behind_a_slower_vehicle() -> None:
    # s* = 2.5 + 20 * 1.1 + 20 * 5 / (2 sqrt(1.5 * 2)) = 24.5 + 28.867513 = 53.367513
    # a = 1.5 * (1 - (20/30)^4 - (53.367513/40)^2) = 1.5 * (1 - 0.197531 - 1.780057)
    found = idm_acceleration(20, 30, 40, 5, MobilConfig())
    assert found == pytest.approx(1.5 * (1 - 16 / 81 - (53.367513 / 40) ** 2), abs=1e-6)
    assert found == pytest.approx(-1.466382, abs=1e-4)


def gain(world: Scene, sign: int, **mobil: float) -> float:
    """The gain of a lane change, m/s^2."""
    values, codes, *_ = world.indicators
    length_m, most_m_s = float(world.snapshot.length_m[0]), CONFIG.ego.max_speed_m_s
    return mobil_gain(values, codes, sign, length_m, most_m_s, MobilConfig(**mobil))


def act(world, **mobil: float) -> Lateral:
    return driver(**mobil).act(world, None).lateral


def test_free_lane_at_the_left_draws_the_ego_from_behind_a_slow_leader() -> None:
    world = scene(ahead(40, speed_m_s=15), ahead(40, RIGHT, speed_m_s=15))
    # own lane: -1.466; left: 1.5 * (1 - 16/81) = 1.2037; gain 2.67, no other vehicle is affected
    assert gain(world, 1) == pytest.approx(1.5 * 65 / 81 + 1.466382, abs=1e-4)
    assert gain(world, -1) == pytest.approx(0.0)
    assert act(world) is Lateral.LEFT


def test_follower_who_would_brake_harder_than_b_safe_forbids_the_change() -> None:
    # 10 m behind at 28 m/s: s* = 2.5 + 30.8 + 28 * 8 / 3.4641 = 97.96, so about -144 m/s2
    world = scene(ahead(40, speed_m_s=15), behind(10, LEFT, 28), ahead(40, RIGHT, 15))
    assert gain(world, 1) == -math.inf
    assert act(world) is Lateral.KEEP


def test_politeness_gives_up_a_gain_that_costs_the_new_follower_more() -> None:
    world = scene(ahead(80, speed_m_s=19), behind(30, LEFT, 20), ahead(80, RIGHT, 19))
    # the follower at 30 m, 20 m/s, not closing: s* = 24.5, a = 1.5 (65/81 - (24.5/30)^2) = 0.2033;
    # without the ego its road is free, 1.2037: it loses 1.0004
    # the ego: free 1.2037, now s* = 24.5 + 20/3.4641 = 30.2735: 1.5 (65/81 - (30.2735/80)^2)
    own = 1.5 * (30.2735 / 80) ** 2
    assert gain(world, 1, politeness=0.0) == pytest.approx(own, abs=1e-4)
    assert gain(world, 1, politeness=1.0) == pytest.approx(own - 1.000417, abs=1e-4)
    assert act(world, politeness=0.0) is Lateral.LEFT
    assert act(world, politeness=1.0) is Lateral.KEEP


def test_old_follower_is_glad_to_see_the_ego_go() -> None:
    world = scene(ahead(80, speed_m_s=19), behind(30), ahead(80, RIGHT, 19))
    alone = scene(ahead(80, speed_m_s=19), ahead(80, RIGHT, 19))
    # behind the ego at 30 m: 0.2033; behind its leader at 30 + 5 + 80 = 115 m, closing 1 m/s:
    # 1.5 (65/81 - (30.2735/115)^2) = 1.0997
    glad = gain(world, 1, politeness=1.0) - gain(alone, 1, politeness=1.0)
    assert glad == pytest.approx(1.0997 - 0.2033, abs=1e-3)


def test_gain_below_the_threshold_is_not_worth_a_lane_change() -> None:
    world = scene(ahead(200, speed_m_s=20), ahead(200, RIGHT, 20))
    # 1.5 (24.5/200)^2 = 0.0225, less than 0.1
    assert gain(world, 1) == pytest.approx(0.0225, abs=1e-4)
    assert act(world) is Lateral.KEEP
    assert act(world, threshold_m_s2=0.0) is Lateral.LEFT


def test_the_leftmost_lane_is_left_for_the_only_one_beside_it() -> None:
    assert act(scene(ahead(40, LEFT, speed_m_s=15), y_m=LEFT)) is Lateral.RIGHT


def test_a_barricaded_lane_is_never_entered_however_much_it_would_gain() -> None:
    slow = (ahead(40, speed_m_s=15), ahead(40, LEFT, speed_m_s=15))
    assert act(scene(*slow)) is Lateral.RIGHT
    assert act(scene(*slow, road=BARRICADED_ROAD)) is Lateral.KEEP


def test_bias_of_mandatory_lane_changes_grows_as_the_distance_shrinks() -> None:
    assert mandatory_bias(0, math.inf) == 0.0
    assert mandatory_bias(1, 1600.0) == pytest.approx(1.0)  # 4 m/s2 from 400 m on
    assert mandatory_bias(-2, 1600.0) == pytest.approx(-2.0)
    assert mandatory_bias(-2, 800.0) == mandatory_bias(-2, 0.0) == -4.0


def test_a_mandatory_change_beats_the_gain_of_the_other_lane_and_not_the_safety_criterion() -> None:
    # the left lane gains 2.67 m/s2, the right lane nothing; its exit is on the right
    slow = ahead(40, speed_m_s=15), ahead(40, RIGHT, speed_m_s=15)

    def lateral(*cars: Car) -> Lateral:
        world = scene(*cars)
        world.indicators.codes[CHANGES], world.indicators.values[WITHIN] = -1, 200.0
        return act(world)

    assert lateral(*slow) is Lateral.RIGHT
    assert lateral(*slow, behind(10, RIGHT, 28)) is Lateral.KEEP
