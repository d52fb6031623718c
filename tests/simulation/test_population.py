"""Who is on the road at the start."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import BARRICADED_ROAD, LANE_M, LENGTH_M, LONG_ROAD, ROAD

from drl_av.config import Config, EgoConfig, TrafficConfig
from drl_av.errors import ConfigError, ScenarioError
from drl_av.road.road import Road, is_open
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.loop import ScenarioDescription
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.simulation.population import (
    DriverModel,
    Population,
    capacity,
    draw_driver_models,
    draw_population,
    placed_population,
    random_lane_changes,
    require_speed_limit,
    require_truck_width,
)

TRAFFIC, EGO = TrafficConfig(), EgoConfig()
OTHERS = Road(600.0, LANE_M, (True,) * 3), Road(150.0, LANE_M, (True,))
ROADS = st.sampled_from([ROAD, BARRICADED_ROAD, LONG_ROAD, *OTHERS])


def draw(
    vehicles: int, seed: int = 0, road: Road = ROAD, traffic: TrafficConfig = TRAFFIC
) -> Population:
    config = Config(traffic=traffic)
    return draw_population(np.random.default_rng(seed), vehicles, road, LENGTH_M, config)


def net_gap_m(population: Population, a: int, b: int, road: Road) -> float:
    """Worked out from the two ways round, without the ring's own arithmetic."""
    between_m = abs(population.front_m[a] - population.front_m[b])
    return float(min(between_m, road.lap_m - between_m) - LENGTH_M)


@given(ROADS, st.integers(0, 30), st.integers(0, 2**32))
def test_everyone_is_on_an_open_lane_with_the_start_gap_around_it(
    road: Road, vehicles: int, seed: int
) -> None:
    vehicles = min(vehicles, capacity(road, LENGTH_M, TRAFFIC.start_gap_m) - 1)
    population = draw(vehicles, seed, road)
    n = vehicles + 1
    assert population.ids == ("ego", *(f"vehicle{i}" for i in range(1, n)))
    assert all(is_open(lane, road) for lane in population.lane.tolist())
    assert ((population.front_m >= 0) & (population.front_m <= road.lap_m)).all()
    for a, b in itertools.combinations(range(n), 2):
        if population.lane[a] == population.lane[b]:
            assert net_gap_m(population, a, b, road) >= TRAFFIC.start_gap_m - 1e-9


@given(st.integers(0, 60), st.integers(0, 2**32))
def test_everyone_starts_within_250_m_of_the_ego_on_a_loop_of_2_km(n: int, seed: int) -> None:
    population = draw(n, seed, LONG_ROAD)
    offset_m = LONG_ROAD.ahead_m(float(population.front_m[0]), population.front_m)
    assert np.abs(offset_m).max() <= 250 + 1e-9


def test_starts_are_spread_over_the_whole_loop_and_over_both_sides_of_the_ego() -> None:
    populations = [draw(10, seed, LONG_ROAD) for seed in range(100)]
    ego_m = np.array([population.front_m[0] for population in populations])
    assert np.histogram(ego_m, bins=4, range=(0, 2000))[0].min() > 10
    offset_m = np.concatenate(
        [LONG_ROAD.ahead_m(float(p.front_m[0]), p.front_m[1:]) for p in populations]
    )
    assert 0.35 < (offset_m > 0).mean() < 0.65
    assert np.abs(offset_m).max() > 200


@given(ROADS, st.integers(0, 30), st.integers(0, 2**32))
def test_everyone_can_still_stop_behind_its_leader(road: Road, vehicles: int, seed: int) -> None:
    vehicles = min(vehicles, capacity(road, LENGTH_M, TRAFFIC.start_gap_m) - 1)
    population = draw(vehicles, seed, road)
    assert (population.speed_m_s >= 0).all()
    assert (population.speed_m_s <= population.desired_speed_m_s + 1e-9).all()
    for follower in range(vehicles + 1):
        members = np.flatnonzero(population.lane == population.lane[follower])
        others = members[members != follower]
        if not len(others):
            continue
        way_m = (population.front_m[others] - population.front_m[follower]) % road.lap_m
        leader, gap_m = others[way_m.argmin()], float(way_m.min()) - LENGTH_M
        # 2 m/s2 for both: what the follower needs, less what the leader still covers
        needed_m = (population.speed_m_s[follower] ** 2 - population.speed_m_s[leader] ** 2) / 4
        assert needed_m <= gap_m + 1e-6


def test_characters_are_drawn_for_each_from_the_ranges_of_the_config() -> None:
    population = draw(30, traffic=replace(TRAFFIC, speed_gain_max=2.0))
    for values, low, high in [
        (population.desired_speed_m_s[1:], 20, 32),
        (population.headway_s[1:], 0.8, 1.4),
        (population.acceleration_m_s2[1:], 1, 2),
        (population.speed_gain[1:], 0, 2),
    ]:
        assert low <= values.min() < values.max() <= high
        assert len(set(values.tolist())) == 30
    assert population.desired_speed_m_s[0] == 30.0


def test_a_seed_draws_the_same_population_and_another_seed_another() -> None:
    same, other = draw(30, 5), draw(30, 6)
    assert np.array_equal(draw(30, 5).front_m, same.front_m)
    assert np.array_equal(draw(30, 5).speed_m_s, same.speed_m_s)
    assert not np.array_equal(other.front_m, same.front_m)


def test_113_fit_beside_the_ego_on_the_default_loop_and_114_do_not() -> None:
    # 500 m hold 38 times 5 m of vehicle and 8 m of gap; three lanes; the ego takes one place
    assert capacity(ROAD, LENGTH_M, 8.0) == 3 * 38
    assert len(draw(113).ids) == 114
    with pytest.raises(ScenarioError, match=r"room for 113 vehicles .* 3 open lanes, not for 114"):
        draw(114)


def test_a_barricaded_lane_has_no_room_and_a_long_loop_only_that_near_the_ego() -> None:
    with pytest.raises(ScenarioError, match=r"room for 75 vehicles .* 2 open lanes, not for 76"):
        draw(76, road=BARRICADED_ROAD)
    assert capacity(LONG_ROAD, LENGTH_M, 8.0) == 3 * 38  # 250 m each way, not 2 km


@given(ROADS, st.integers(1, 500), st.integers(0, 100))
def test_too_many_are_refused_with_their_number_and_as_many_as_fit_are_not(
    road: Road, beyond: int, seed: int
) -> None:
    most = capacity(road, LENGTH_M, TRAFFIC.start_gap_m) - 1
    assert len(draw(most, seed, road).ids) == most + 1
    with pytest.raises(ScenarioError, match=rf"not for {most + beyond}: ") as caught:
        draw(most + beyond, seed, road)
    assert re.search(rf"\b{most}\b", str(caught.value))


def test_placed_vehicles_keep_their_places_with_the_ego_first() -> None:
    placed = (
        PlacedVehicle("slow", 2, 40.0, 10.0, 12.0),
        PlacedVehicle("ego", 1, 20.0, 25.0, 30.0),
        PlacedVehicle("fast", 0, 5.0, 30.0, 31.0),
    )
    population = placed_population(placed, TRAFFIC)
    assert population.ids == ("ego", "slow", "fast")
    assert population.lane.tolist() == [1, 2, 0]
    assert population.front_m.tolist() == [20.0, 40.0, 5.0]
    assert population.speed_m_s.tolist() == [25.0, 10.0, 30.0]
    assert population.desired_speed_m_s.tolist() == [30.0, 12.0, 31.0]
    assert population.headway_s.tolist() == pytest.approx([1.1] * 3)


def test_placed_vehicles_without_an_ego_are_neither_driven_nor_written(tmp_path: Path) -> None:
    alone = (PlacedVehicle("slow", 2, 40.0, 10.0, 12.0),)
    told = r'places 1 vehicle but not the ego: place one .* "ego"'
    with pytest.raises(ScenarioError, match=told):
        placed_population(alone, TRAFFIC)
    with pytest.raises(ScenarioError, match=told):
        write_scenario(tmp_path / "alone", ScenarioDescription(vehicles=alone))
    assert not (tmp_path / "alone").exists()


def shares(*of: float) -> TrafficConfig:
    """Traffic with these shares of the kinds of drivers, in the order of the names."""
    names = ("finite_state", "level_0", "level_1", "hard_braking", "level_2")
    return TrafficConfig(**{f"{name}_share": one for name, one in zip(names, of, strict=False)})


@pytest.mark.parametrize("kind", ["finite_state", "level_0", "level_1", "hard_braking", "level_2"])
@given(seed=st.integers(0, 2**40))
def test_a_share_of_1_is_every_vehicle_but_the_ego(kind: str, seed: int) -> None:
    mix = replace(shares(0, 0, 0), **{f"{kind}_share": 1.0})
    others = [DriverModel[kind.upper()]] * 30
    assert draw_driver_models(seed, 31, mix).tolist() == [DriverModel.SUMO, *others]


def test_kinds_come_in_their_shares_with_sumo_for_the_rest() -> None:
    mix = shares(0.2, 0.1, 0.2, 0.1, 0.1)
    kinds = np.concatenate([draw_driver_models(seed, 31, mix)[1:] for seed in range(300)])
    found = np.bincount(kinds, minlength=len(DriverModel)) / len(kinds)
    # 9,000 draws: a standard deviation of at most 0.0053
    np.testing.assert_allclose(found, [0.3, 0.2, 0.1, 0.2, 0.1, 0.1], atol=0.025)


@given(st.integers(0, 2**40))
def test_shares_that_sum_to_1_leave_no_vehicle_to_sumo(seed: int) -> None:
    assert (draw_driver_models(seed, 31, shares(0.3, 0.3, 0.4))[1:] != DriverModel.SUMO).all()


def test_shares_change_neither_places_nor_characters() -> None:
    first, mixed = draw(30), draw(30, traffic=shares(0.3, 0.3, 0.4))
    for name in ("lane", "front_m", "speed_m_s", "desired_speed_m_s", "headway_s"):
        assert np.array_equal(getattr(first, name), getattr(mixed, name))


WIDE = ScenarioDescription(lane_width_m=3.8)
UNUSUAL = TrafficConfig(
    standing_share=0.1,
    crawling_share=0.2,
    crawling_speed_max_m_s=5.0,
    fast_share=0.3,
    fast_speed_m_s=39.0,
    fast_speed_gain=7.0,
)


def test_some_vehicles_stand_crawl_or_overtake_fast_and_the_others_stay_as_they_are() -> None:
    pairs = [(draw(30, seed), draw(30, seed, traffic=UNUSUAL)) for seed in range(200)]
    usual, found = (
        np.array([p.desired_speed_m_s[1:] for p in side]) for side in zip(*pairs, strict=True)
    )
    standing, crawling, fast = found == 0.1, (found > 0.1) & (found <= 5.0), found == 39.0
    np.testing.assert_allclose(
        [standing.mean(), crawling.mean(), fast.mean()], [0.1, 0.2, 0.3], atol=0.02
    )
    # half of those that crawl do so above the middle between 0.1 and 5 m/s
    assert (found[crawling] > 2.55).mean() == pytest.approx(0.5, abs=0.06)
    rest = ~(standing | crawling | fast)
    assert np.array_equal(found[rest], usual[rest])
    gains = np.array([unusual.speed_gain[1:] for _, unusual in pairs])
    assert (gains[fast] == 7.0).all()
    assert (gains[~fast] == 0.0).all()
    for plain, unusual in pairs:
        assert unusual.desired_speed_m_s[0] == EGO.max_speed_m_s
        for name in ("lane", "front_m", "headway_s", "acceleration_m_s2"):
            assert np.array_equal(getattr(plain, name), getattr(unusual, name))


TRUCKS = TrafficConfig(
    truck_share=0.2,
    truck_length_m=16.0,
    truck_speed_min_m_s=22.0,
    truck_speed_max_m_s=24.0,
    truck_acceleration_m_s2=0.6,
)


def test_trucks_come_in_their_share_with_their_own_parameters_and_cars_stay_as_they_are() -> None:
    pairs = [(draw(15, seed), draw(15, seed, traffic=TRUCKS)) for seed in range(400)]
    is_truck = np.array([mixed.is_truck for _, mixed in pairs])
    assert not is_truck[:, 0].any()
    assert is_truck[:, 1:].mean() == pytest.approx(0.2, abs=0.02)
    for cars, mixed in pairs:
        truck = mixed.is_truck
        desired = mixed.desired_speed_m_s
        assert ((desired[truck] >= 22.0) & (desired[truck] <= 24.0)).all()
        assert (mixed.acceleration_m_s2[truck] == 0.6).all()
        assert not cars.is_truck.any()
        for name in ("desired_speed_m_s", "acceleration_m_s2", "headway_s"):
            assert np.array_equal(getattr(mixed, name)[~truck], getattr(cars, name)[~truck])


@given(st.integers(0, 30), st.integers(0, 2**32))
def test_trucks_too_have_the_start_gap_around_them(vehicles: int, seed: int) -> None:
    mixed = draw(vehicles, seed, traffic=TRUCKS)
    length_m = np.where(mixed.is_truck, 16.0, LENGTH_M)
    for a, b in itertools.permutations(range(vehicles + 1), 2):
        if mixed.lane[a] == mixed.lane[b]:
            # from a's front to b's rear, the way that a drives
            gap_m = (mixed.front_m[b] - length_m[b] - mixed.front_m[a]) % 500.0
            assert TRUCKS.start_gap_m - 1e-9 <= gap_m <= 500.0 - length_m[[a, b]].sum()


def test_a_road_has_room_for_so_many_trucks() -> None:
    assert TRUCKS.longest_m(LENGTH_M) == 16.0
    assert TRUCKS.longest_m(20.0) == 20.0
    assert TRAFFIC.longest_m(LENGTH_M) == LENGTH_M
    # 500 m take 20 trucks of 16 m and 8 m in front of them in each of three lanes
    draw(59, traffic=TRUCKS)
    with pytest.raises(ScenarioError, match=r"room for 59 vehicles besides the ego"):
        draw(60, traffic=TRUCKS)


def test_all_can_be_unusual_but_no_more_than_all() -> None:
    all_vehicles = draw(30, traffic=TrafficConfig(standing_share=0.5, crawling_share=0.5))
    assert all_vehicles.desired_speed_m_s[1:].max() <= 8.0
    with pytest.raises(ConfigError, match=r"^traffic: standing_share .* is 1.2, but must be"):
        TrafficConfig(standing_share=0.5, fast_share=0.7)


def test_shares_of_more_than_all_are_refused_and_of_all_are_not() -> None:
    assert sum(shares(0.7, 0.2, 0.1).shares) == pytest.approx(1.0)
    with pytest.raises(ConfigError, match=r"^traffic: finite_state_share .* is 1.1, but must be"):
        shares(0.5, 0.3, 0.3)


def test_trucks_wider_than_a_lane_are_refused_where_there_are_any() -> None:
    config = Config().updated("traffic", truck_width_m=3.9)
    require_truck_width(config, ScenarioDescription())
    require_truck_width(config.updated("traffic", truck_width_m=3.8, truck_share=1.0), WIDE)
    with pytest.raises(ConfigError, match=r"^traffic.truck_width_m is 3.9, but .* is 3.8: lower"):
        require_truck_width(config.updated("traffic", truck_share=0.1), WIDE)


@pytest.mark.parametrize(
    ("words", "fast_share"),  # without fast overtakers their 38 m/s count for nothing
    [
        ("traffic desired_speed_max_m_s", 0.0),
        ("ego max_speed_m_s", 0.0),
        ("traffic fast_speed_m_s", 0.1),
    ],
)
def test_a_setting_above_the_speed_limit_is_refused_by_its_name(
    words: str, fast_share: float
) -> None:
    road, (section, setting) = ScenarioDescription(speed_limit_m_s=36.0), words.split()
    config = Config().updated("traffic", fast_share=fast_share)
    require_speed_limit(config.updated(section, **{setting: 36.0}), road)
    told = rf"^{section}\.{setting} is 36\.5, .* speed_limit_m_s is 36:"
    with pytest.raises(ConfigError, match=told):
        require_speed_limit(config.updated(section, **{setting: 36.5}), road)


def test_placed_vehicles_bring_their_own_desired_speeds_to_a_slower_road() -> None:
    ego = PlacedVehicle("ego", lane=1, position_m=50.0, speed_m_s=20.0, desired_speed_m_s=30.0)
    require_speed_limit(Config(), ScenarioDescription(speed_limit_m_s=31.0, vehicles=(ego,)))
    with pytest.raises(ConfigError, match=r"^traffic\.desired_speed_max_m_s is 32, but"):
        require_speed_limit(Config(), ScenarioDescription(speed_limit_m_s=31.0))
    with pytest.raises(ConfigError, match=r"^ego\.\S+ is 30 and traffic\.\S+ is 32, but .* 25:"):
        require_speed_limit(Config(), ScenarioDescription(speed_limit_m_s=25.0))


def test_random_lane_changes_come_at_their_rate_for_each_vehicle_and_go_both_ways() -> None:
    decisions = itertools.islice(random_lane_changes(np.random.default_rng(0), 4, 0.1), 20_000)
    requests = [request for decision in decisions for request in decision]
    rows, sides = zip(*requests, strict=True)
    assert set(rows) == {1, 2, 3}  # never the ego
    for row in (1, 2, 3):
        assert rows.count(row) == pytest.approx(2000, abs=150)
    assert set(sides) == {-1, 1}
    assert sides.count(1) / len(sides) == pytest.approx(0.5, abs=0.02)


def test_a_rate_of_zero_asks_for_no_lane_change() -> None:
    decisions = itertools.islice(random_lane_changes(np.random.default_rng(0), 9, 0.0), 2_000)
    assert not any(decisions)
