"""Forecasts worked out by hand, and the ways out of a box that the planner finds."""

import numpy as np
import pytest
from worlds import LEFT, RIGHT, Car, ahead, behind, scene

from drl_av.config import Config
from drl_av.drivers.planner.forecast import Forecaster, PlanCosts
from drl_av.drivers.planner.limits import limits_of
from drl_av.drivers.planner.low_level_controller import Ego, LowLevelController
from drl_av.drivers.planner.others import IntArray, others_of
from drl_av.drivers.planner.parameter_estimator import ParameterEstimator
from drl_av.drivers.planner.plans import PLANS, Intent, usable_plans
from drl_av.driving.scene import Scene
from drl_av.road.road import FloatArray, MandatoryChange

CONFIG = Config()
KEEP, LEFTWARD = np.full((1, 20), Intent.KEEP), np.full((1, 20), Intent.LEFT)


def forecaster(world: Scene) -> Forecaster:
    others = others_of(world.snapshot, world.affordances, 3)
    chooser = LowLevelController(np.array([True] * 3), CONFIG.ego, limits_of(CONFIG))
    watcher = ParameterEstimator(others)
    watcher.desired_m_s = others.speed_m_s  # no vehicle wants to be faster than it is
    return Forecaster(others, watcher, 500.0, chooser, CONFIG.ego, world.affordances.mandatory)


def ego(n: int, speed: float, lane_number: int) -> Ego:
    lane = np.full(n, lane_number)
    return Ego(np.zeros(n), np.full(n, speed), lane, lane, np.zeros(n, dtype=np.intp))


def scores(
    world: Scene, plans: IntArray, sign: int = 0, prices: PlanCosts | None = None
) -> FloatArray:
    seen = world.affordances
    egos = ego(len(plans), seen.ego_speed_m_s, seen.lane)
    return forecaster(world).scores(egos, sign, plans, prices or PlanCosts())


def test_alone_it_drives_577_5_m_in_20_s_and_300_m_after_them() -> None:
    # speeds 20, 22, ..., 30: 21.5 + 23.5 + 25.5 + 27.5 + 29.5 + 15 * 30; then 10 s at 30 m/s
    assert scores(scene(), KEEP) == pytest.approx([877.5])
    assert scores(scene(), KEEP, sign=-1) == pytest.approx([877.5 - 4.0])  # it was braking


def test_a_lane_change_has_its_price_and_the_road_its_edge() -> None:
    # the second change begins after the first; there is no third lane to the left
    assert scores(scene(), LEFTWARD) == pytest.approx([877.5 - 4.0])


def price_of_way(lanes: int, within_m: float, plans: IntArray, **prices: float) -> float:
    """What mandatory lane changes cost, on lane 1; after 20 s the ego has driven 577.5 m."""
    world = scene()
    way = MandatoryChange(lanes, within_m)
    demanded = world._replace(affordances=world.affordances._replace(mandatory=way))
    found = scores(world, plans) - scores(demanded, plans, prices=PlanCosts(**prices))
    return float(found[0])


def test_each_mandatory_lane_change_that_a_plan_leaves_has_a_price() -> None:
    def price(lanes: int, within_m: float, plans: IntArray) -> float:
        return price_of_way(lanes, within_m, plans, late_change=0.0, missed_change=400.0)

    # a lane change costs 400 m, and nothing where 400 m are left
    assert price(1, 977.5, KEEP) == pytest.approx(0.0)
    assert price(1, 777.5, KEEP) == pytest.approx(200.0)
    assert price(2, 777.5, KEEP) == pytest.approx(600.0)
    assert price(2, 777.5, LEFTWARD) == pytest.approx(200.0)  # it has made one of the two
    assert price(1, 577.5, LEFTWARD) == 0.0
    assert price(-1, 577.5, LEFTWARD) == pytest.approx(800.0)  # it has gone the wrong way
    assert price(-1, 100.0, KEEP) == pytest.approx(400.0)  # too late


def test_each_second_before_an_urgent_lane_change_has_a_price() -> None:
    def price(lanes: int, within_m: float, plans: IntArray) -> float:
        return price_of_way(lanes, within_m, plans, late_change=10.0, missed_change=0.0)

    assert price(1, 0.0, KEEP) == pytest.approx(200.0)
    assert price(1, 0.0, LEFTWARD) == pytest.approx(20.0)  # its centre is over the line after 3 s
    assert price(1, 10_000.0, KEEP) == 0.0


def test_a_vehicle_that_the_ego_cuts_off_is_forecast_to_brake_for_it() -> None:
    world = scene(ahead(60.0, speed_m_s=10.0), behind(25.0, LEFT, 22.0))
    dear, free = (scores(world, LEFTWARD, prices=PlanCosts(forced_braking=f)) for f in (100.0, 0.0))
    assert dear[0] < free[0] - 10.0
    far = scene(ahead(60.0, speed_m_s=10.0), behind(90.0, LEFT, 22.0))
    dear, free = (scores(far, LEFTWARD, prices=PlanCosts(forced_braking=f)) for f in (100.0, 0.0))
    assert dear == pytest.approx(free)


def best(world: Scene) -> list[int]:
    plan: IntArray = PLANS[scores(world, PLANS).argmax()]
    return plan[[0, 3, 10]].tolist()


def test_it_keeps_its_lane_behind_a_vehicle_as_fast_as_all_others() -> None:
    world = scene(ahead(30.0), ahead(30.0, LEFT), ahead(30.0, RIGHT))
    assert scores(world, PLANS).max() < scores(world, KEEP)[0] + PlanCosts().change_of_plan


def test_boxed_in_it_brakes_changes_behind_its_neighbour_and_goes_round() -> None:
    # on the right, 20 m/s behind 20 m/s and beside 20 m/s; the left lane is free
    box = scene(ahead(25.0, RIGHT), Car(0.0), y_m=RIGHT)
    stays = scores(box, KEEP)[0]
    assert stays == pytest.approx(20 * 20 + 10 * 20, abs=2.0)
    assert scores(box, PLANS).max() > stays + 40.0
    assert best(box)[0] in (Intent.BRAKE, Intent.LEFT_YIELDING)
    assert best(box)[1:] == [Intent.LEFT_YIELDING, Intent.LEFT]


def test_the_plans_have_no_lane_change_off_the_road() -> None:
    at_the_left = usable_plans(False, has_right=True, has_left=False)
    assert not np.isin(at_the_left[:, 0], (Intent.LEFT, Intent.LEFT_YIELDING)).any()
    assert np.isin(at_the_left[:, 0], (Intent.RIGHT, Intent.RIGHT_YIELDING)).any()
    assert len(usable_plans(True, False, False)) == len(PLANS)  # so that it may abort
