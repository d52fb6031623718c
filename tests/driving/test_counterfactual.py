"""What the ego would see now, had it decided otherwise."""

from itertools import pairwise

import numpy as np
import pytest
from worlds import CENTER, LEAVE, LEFT, LONG_ROAD, RIGHT, ROAD, ahead, behind, changing, scene

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.affordances import INDICATORS, Affordances
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.learning.experience import Motion, affordances_after, motion
from drl_av.road.road import Barrier, MandatoryChange

CONFIG = Config()
MAINTAIN = Action(Lateral.KEEP, Longitudinal.MAINTAIN)
ACCELERATE = Action(Lateral.KEEP, Longitudinal.ACCELERATE)
HARD_BRAKE = Action(Lateral.KEEP, Longitudinal.HARD_BRAKE)
TO_LEFT = Action(Lateral.LEFT, Longitudinal.MAINTAIN)


def had_it(other: Action, now: Scene, before: Scene | None = None) -> Affordances | None:
    """What it would see in ``now``, had it not maintained its 20 m/s in the centre lane."""
    before = before or scene()
    made = motion(before, MAINTAIN, CONFIG)
    return affordances_after(motion(before, other, CONFIG), made, now.affordances, ROAD)


def test_two_steps_at_21_and_22_m_s_take_the_ego_21_and_a_half_metres() -> None:
    # not 21: SUMO's semi-implicit Euler moves by the speed at the end of each half second
    assert motion(scene(), ACCELERATE, CONFIG) == pytest.approx(Motion(21.5, 22.0, CENTER, 0.0))
    assert motion(scene(), TO_LEFT, CONFIG) == pytest.approx(Motion(20.0, 20.0, 4.56, 0.76))


def test_had_it_accelerated_the_vehicle_ahead_is_1_m_50_nearer_and_the_one_behind_as_much_further():
    now = scene(ahead(30, speed_m_s=17.0), behind(10, LEFT, 25.0), ahead(100, RIGHT, 21.0))
    affordances = had_it(ACCELERATE, now)
    assert affordances is not None
    assert affordances.ego_speed_m_s == pytest.approx(22.0)
    assert affordances.own_front is not None
    assert affordances.own_front[1:] == pytest.approx((28.5, -5.0, 0.0, 0.0))
    assert affordances.left_rear is not None
    assert affordances.left_rear[1:] == pytest.approx((11.5, 3.0, 3.8, 0.0))
    assert affordances.right_front is not None
    assert affordances.right_front[1:] == pytest.approx((98.5, -1.0, -3.8, 0.0))
    assert (affordances.own_rear, affordances.left_front, affordances.right_rear) == (
        None,
        None,
        None,
    )


def test_had_it_accelerated_what_lies_ahead_on_the_road_would_be_nearer_too() -> None:
    now = scene()
    ahead_m = (Barrier(100.0, 0.0, 3.8), Barrier(40.0, 3.8, 7.6))
    seen = now.affordances._replace(barriers=ahead_m, mandatory=MandatoryChange(1, 60.0))
    for other, places, within_m in (
        (ACCELERATE, (98.5, 38.5), 58.5),
        (HARD_BRAKE, (103.0, 43.0), 63.0),  # two steps at 18 and 16 m/s take it 17 m
        (MAINTAIN, (100.0, 40.0), 60.0),
    ):
        affordances = had_it(other, now._replace(affordances=seen))
        assert affordances is not None
        assert [barrier.s_m for barrier in affordances.barriers] == pytest.approx(places)
        assert affordances.mandatory.within_m == pytest.approx(within_m)


def test_had_it_begun_a_lane_change_all_others_are_0_76_m_further_right() -> None:
    affordances = had_it(TO_LEFT, scene(ahead(30, LEFT), behind(12, RIGHT)))
    assert affordances is not None
    assert (affordances.ego_y_m, affordances.ego_lateral_speed_m_s) == pytest.approx((4.56, 0.76))
    assert affordances.left_front is not None
    assert affordances.left_front[1:] == pytest.approx((30.0, 0.0, 3.04, -0.76))
    assert affordances.right_rear is not None
    assert affordances.right_rear[1:] == pytest.approx((12.0, 0.0, -4.56, -0.76))


def test_had_it_taken_the_lane_change_back_it_is_1_52_m_further_right() -> None:
    before = changing(origin=1, target=2, seconds=1)
    now = scene(y_m=5.32, v_y=0.76)
    back = Action(Lateral.RIGHT, Longitudinal.MAINTAIN)
    affordances = had_it(back, now, before)
    assert affordances is not None
    assert (affordances.ego_y_m, affordances.ego_lateral_speed_m_s) == pytest.approx((3.8, 0.0))


def test_what_it_would_see_from_another_lane_is_not_known() -> None:
    before = changing(origin=1, target=2, seconds=2)
    now = scene(y_m=6.08, v_y=0.76)
    assert now.affordances.lane == 2
    assert had_it(Action(Lateral.RIGHT, Longitudinal.MAINTAIN), now, before) is None


def test_beside_a_vehicle_or_into_one_it_is_not_known_what_it_would_see() -> None:
    assert had_it(HARD_BRAKE, scene(ahead(0, LEFT))) is None
    assert had_it(HARD_BRAKE, scene(behind(3.0))) is None  # 3 m less of road
    assert had_it(HARD_BRAKE, scene(behind(3.1))) is not None


def test_had_it_driven_1_m_50_further_its_exit_is_as_much_nearer() -> None:
    seen = scene(s_m=645.0, y_m=CENTER, road=LEAVE).affordances
    assert seen.mandatory == (-1, 502.5)  # the ego's front is at 647.5 m, the exit at 1,150 m
    made, other = Motion(20.0, 20.0, CENTER, 0.0), Motion(21.5, 22.0, CENTER, 0.0)
    found = affordances_after(other, made, seen, LEAVE)
    assert found is not None
    assert found.mandatory == (-1, 501.0)


def test_it_is_not_known_what_it_would_see_where_its_exit_is_behind_it() -> None:
    seen = scene(s_m=1146.25, y_m=CENTER, road=LEAVE).affordances
    assert seen.mandatory == (-1, 1.25)
    made = Motion(20.0, 20.0, CENTER, 0.0)
    for other_m, known in ((21.0, True), (21.25, False), (22.0, False)):
        other = Motion(other_m, 22.0, CENTER, 0.0)
        assert (affordances_after(other, made, seen, LEAVE) is not None) == known


def test_a_vehicle_that_would_be_out_of_sight_is_not_seen() -> None:
    now = scene(ahead(249.0, speed_m_s=30.0), road=LONG_ROAD)
    for other, range_left in ((HARD_BRAKE, False), (ACCELERATE, True)):
        affordances = had_it(other, now)
        assert affordances is not None
        assert (affordances.own_front is not None) == range_left


def test_the_motion_that_was_made_leads_to_what_is_seen() -> None:
    now = scene(ahead(30, speed_m_s=17.0), behind(10, LEFT, 25.0), ahead(100, RIGHT, 21.0))
    assert had_it(MAINTAIN, now) == now.affordances


def test_in_sumo_the_ego_and_those_ahead_are_where_it_said() -> None:
    """Twins: one drives on as it did, the other decides otherwise once."""
    ahead_and_own = [i for i, name in enumerate(INDICATORS) if "rear" not in name]
    rear_gaps = [i for i, name in enumerate(INDICATORS) if name.endswith("rear_d_x")]
    known = 0
    with HighwayEnv(safety_check="permit_all", config=CONFIG) as env:
        for seed, (executed, other) in enumerate(
            pairwise(np.random.default_rng(0).permutation(12))
        ):
            env.reset(seed=seed, options={"vehicles": 15})
            for _ in range(3):
                env.step(0)
            before = env.scene
            env.step(int(executed))
            made = motion(before, ACTIONS[executed], CONFIG)
            said = affordances_after(
                motion(before, ACTIONS[other], CONFIG), made, env.scene.affordances, env.road
            )
            env.reset(seed=seed, options={"vehicles": 15})
            for _ in range(3):
                env.step(0)
            env.step(int(other))
            if said is None:
                continue
            known += 1
            predicted, true = said.vector(), env.scene.affordances.vector()
            assert predicted[ahead_and_own] == pytest.approx(true[ahead_and_own], abs=1e-6)
            assert predicted[rear_gaps] == pytest.approx(true[rear_gaps], abs=1.0)
    assert known > 5
