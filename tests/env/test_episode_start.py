"""The traffic that an episode starts with."""

from contextlib import closing
from itertools import islice
from typing import Any

import numpy as np
import pytest
from drives import KEEP, LEFT, RIGHT, Place, start
from worlds import CENTER

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.env.episode_start import TRAINING_SEED_RANGE, traffic_seed
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import ConfigError
from drl_av.scenarios.folder import PlacedVehicle


@pytest.mark.parametrize("vehicles", [1, 30])
@pytest.mark.parametrize("seed", range(3))
def test_every_vehicle_is_on_the_road_from_the_first_decision(
    env: HighwayEnv, vehicles: int, seed: int
) -> None:
    info = start(env, vehicles, seed)
    sumo = env.simulation._sumo
    assert info["vehicles"] == vehicles
    for _ in range(3):
        shot = env.scene.snapshot
        assert shot.ids == ("ego", *(f"vehicle{i}" for i in range(1, vehicles + 1)))
        assert set(shot.ids) <= set(sumo.vehicle.getIDList())
        assert all(sumo.vehicle.getRoadID(name) for name in shot.ids)
        assert ((shot.s_m >= 0) & (shot.s_m < 500)).all()
        assert ((shot.y_m > -1) & (shot.y_m < 8.6)).all()
        assert ((shot.speed_m_s >= 0) & (shot.speed_m_s < 40)).all()
        env.step(KEEP)


def test_without_the_option_the_number_of_vehicles_is_drawn_from_the_config() -> None:
    config = Config().updated("traffic", vehicles_min=2, vehicles_max=4)
    with HighwayEnv(config=config) as made:
        numbers = {made.reset(seed=seed)[1]["vehicles"] for seed in range(30)}
        assert numbers == {2, 3, 4}
        assert made.reset(seed=7)[1]["vehicles"] == made.reset(seed=7)[1]["vehicles"]


def test_an_unseeded_reset_never_draws_a_seed_of_evaluation(env: HighwayEnv) -> None:
    env.reset(seed=5)
    seeds = [env.reset()[1]["seed"] for _ in range(10)]
    assert len(set(seeds)) == 10
    assert all(TRAINING_SEED_RANGE[0] <= seed < TRAINING_SEED_RANGE[1] for seed in seeds)
    env.reset(seed=5)
    assert [env.reset()[1]["seed"] for _ in range(10)] == seeds


def test_a_client_s_small_seed_is_that_of_no_episode_of_evaluation(env: HighwayEnv) -> None:
    observation, info = env.reset(seed=0)
    assert TRAINING_SEED_RANGE[0] <= info["seed"] < TRAINING_SEED_RANGE[1]
    for seed in (0, info["seed"]):  # which is that of the same traffic
        again, same = env.reset(seed=seed)
        assert np.array_equal(again, observation)
        assert (same["seed"], same["vehicles"]) == (info["seed"], info["vehicles"])
    assert env.reset(seed=1)[1]["seed"] != info["seed"]
    named = {"vehicles": info["vehicles"]}
    evaluated, info = env.reset(seed=0, options=named)
    assert (info["seed"], info["vehicles"]) == (0, named["vehicles"])
    assert not np.array_equal(evaluated, observation)
    assert env.reset(seed=TRAINING_SEED_RANGE[0], options={})[1]["seed"] == TRAINING_SEED_RANGE[0]
    assert env.reset(seed=999_999)[1]["seed"] >= TRAINING_SEED_RANGE[0]


def test_no_vehicle_enters_a_barricaded_lane(barricaded: HighwayEnv) -> None:
    for seed in range(3):
        start(barricaded, 30, seed)
        for decision in range(60):
            info = barricaded.step((LEFT, RIGHT, KEEP)[decision % 3])[4]
            assert not info["collision"]
            assert (barricaded.scene.snapshot.y_m - 0.9 > 1.9 - 1e-6).all()
            if barricaded.scene.affordances.lane == 1:
                right = info["indicators"][8:16]
                offset_m = -info["indicators"][25]
                assert right == pytest.approx([0, 0, offset_m, 0] * 2, abs=1e-9)


def test_placed_vehicles_start_exactly_where_the_scenario_has_them(place: Place) -> None:
    made = place(
        PlacedVehicle("fast", 0, 3.0, 31.0, 32.0),  # its body lies across the seam
        PlacedVehicle("ego", 1, 126.0, 22.0, 30.0),  # and the ego's across two edges
        PlacedVehicle("slow", 1, 160.0, 12.5, 14.0),
        PlacedVehicle("far", 2, 499.5, 20.0, 25.0),
    )
    for seed in (0, 1):
        _, info = made.reset(seed=seed)
        shot = made.scene.snapshot
        assert info["vehicles"] == 3
        assert shot.ids == ("ego", "fast", "slow", "far")
        assert shot.s_m == pytest.approx([123.5, 0.5, 157.5, 497.0])
        assert shot.y_m == pytest.approx([CENTER, 0.0, CENTER, 7.6])
        assert shot.speed_m_s == pytest.approx([22.0, 31.0, 12.5, 20.0])
        assert not shot.lateral_speed_m_s.any()
        front = made.scene.affordances.own_front
        assert (front.gap_m, front.relative_speed_m_s) == pytest.approx((29.0, -9.5))


def test_a_scenario_that_places_its_vehicles_takes_no_other_number(place: Place) -> None:
    made = place(PlacedVehicle("ego", 1, 20.0, 20.0, 30.0), PlacedVehicle("a", 0, 9.0, 20.0, 30.0))
    assert start(made, 1)["vehicles"] == 1
    with pytest.raises(
        ConfigError, match=r"vehicles is 2, but the scenario places exactly 1 vehicle:"
    ):
        start(made, 2)


@pytest.mark.parametrize("decisions", [150, 198])
def test_no_vehicle_brakes_behind_a_lane_change_of_the_episode_before(decisions: int) -> None:
    """SUMO would keep the space that vehicles beside standing ones reserved for their changes."""
    config = Config().updated("safety", check="strict").with_traffic("hazards")
    speeds = []
    with closing(HighwayEnv(config=config)) as fresh, closing(HighwayEnv(config=config)) as used:
        driver = rule_driver("gap-mobil", config)
        for decision in islice(rollout(used, driver, 970_002, 20), decisions):
            assert not decision.terminated
        for env in (fresh, used):
            env.reset(seed=970_003, options={"vehicles": 20})
            env.step(KEEP)
            speeds.append(env.scene.snapshot.speed_m_s)
    np.testing.assert_array_equal(*speeds)


class Bounds:
    """A generator whose numbers are the least or the greatest that it may draw."""

    def __init__(self, least: bool) -> None:
        self._least = least

    def integers(self, low: int, high: int | None = None) -> int:
        low, high = (0, low) if high is None else (low, high)
        return low if self._least else high - 1


@pytest.mark.parametrize("seed", [7, None])
def test_the_seeds_of_training_begin_where_those_of_evaluations_end(seed: int | None) -> None:
    for least, wanted in ((True, 1_000_000), (False, 2**31 - 1)):
        bounds: Any = Bounds(least)
        assert traffic_seed(seed, {}, bounds) == wanted
