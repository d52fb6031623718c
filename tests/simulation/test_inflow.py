"""The vehicles of an open road: where they start, who enters, and who leaves."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.errors import ScenarioError
from drl_av.road.road import OPEN_LAP_M, SpeedLimit
from drl_av.scenarios.folder import load_scenario, with_scenario, write_scenario
from drl_av.scenarios.layout import OpenStart
from drl_av.scenarios.road_types import ROAD_TYPES
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.inflow import (
    Inflow,
    Last,
    draw_open_population,
    flow_speed,
    open_capacity,
    safe_speed,
    vehicles_of_flow,
)
from drl_av.simulation.population import Population, safe_speeds

CONFIG, LENGTH_M = Config(), 5.0
TRAFFIC = CONFIG.traffic
STRAIGHT = OpenStart((0, 1, 2), 2400.0, 1000.0, None, 300.0)
RAMP = OpenStart((1, 2, 3), 1500.0, 1000.0, 0, 400.0, 15.0)


def draw(vehicles: int, seed: int, start: OpenStart = STRAIGHT) -> Population:
    rng = np.random.default_rng(seed)
    return draw_open_population(rng, vehicles, start, LENGTH_M, CONFIG)


def test_1000_vehicles_an_hour_on_three_lanes_of_2400_m_are_100_vehicles_at_20_m_s() -> None:
    # 1000 / 3600 / 20 = 1 vehicle in 72 m of a lane
    assert vehicles_of_flow(STRAIGHT, TRAFFIC) == 100
    assert vehicles_of_flow(STRAIGHT._replace(flow_per_h=0.0), TRAFFIC) == 0


def test_the_lane_in_which_the_ego_must_start_holds_its_vehicles_too() -> None:
    # 303 m: 298 / 13 = 22 vehicles of 5 m a lane; the ego may be one more, so 3 lanes take 63
    start = OpenStart((0, 1, 2), 303.0, 1000.0, 2, 100.0)
    assert open_capacity(start, LENGTH_M, TRAFFIC.start_gap_m) == 63
    assert open_capacity(start._replace(ego_lane=None), LENGTH_M, TRAFFIC.start_gap_m) == 66
    for seed in range(20):
        population = draw(62, seed, start)
        assert population.lane[0] == 2
        for lane in range(3):
            front_m = np.sort(population.front_m[population.lane == lane])
            assert np.diff(front_m).min() >= LENGTH_M + TRAFFIC.start_gap_m - 1e-9


SLOW = STRAIGHT._replace(
    speed_limits=(
        SpeedLimit(0.0, 600.0, 40.0),
        SpeedLimit(600.0, 1200.0, 10.0),
        SpeedLimit(1200.0, OPEN_LAP_M, 30.0),
    )
)
"""A quarter of the road with 10 m/s, and no vehicle wants less than 20; the last limit goes on."""


def test_a_flow_is_denser_where_the_speed_limit_is_low() -> None:
    # 1800 m at 20 m/s and 600 m at 10 m/s: 150 s, 125 vehicles of 3,000 an hour
    assert flow_speed(SLOW, TRAFFIC) == pytest.approx(16.0)
    assert vehicles_of_flow(SLOW, TRAFFIC) == 125
    assert flow_speed(STRAIGHT, TRAFFIC) == 20.0


def test_vehicles_start_and_enter_at_most_at_the_limit_of_their_place() -> None:
    population = draw(40, 2, SLOW)
    slow = (population.front_m >= 600.0) & (population.front_m < 1200.0)
    assert population.speed_m_s[slow].max() == 10.0
    assert population.speed_m_s[~slow].max() > 20.0
    assert population.desired_speed_m_s[slow].min() >= 20.0
    crawl = SLOW._replace(speed_limits=(SpeedLimit(0.0, 50.0, 10.0), *SLOW.speed_limits))
    found = Inflow(np.random.default_rng(0), 100, crawl, LENGTH_M, CONFIG)
    entering = [found.entering(float(second), {}) for second in range(60)]
    assert {speed for one in entering if one for speed in one.speed_m_s.tolist()} == {10.0}


@given(st.sampled_from([STRAIGHT, RAMP]), st.integers(0, 150), st.integers(0, 2**32))
def test_vehicles_start_on_the_road_evenly_over_lanes_with_the_start_gap(
    start: OpenStart, vehicles: int, seed: int
) -> None:
    population = draw(vehicles, seed, start)
    assert population.front_m[0] == pytest.approx(start.ego_front_m)
    assert population.front_m.min() >= LENGTH_M
    assert population.front_m.max() < start.span_m
    counts = [np.sum(population.lane == lane) for lane in start.lanes]
    assert max(counts) - min(counts) <= 2
    for lane in (0, *start.lanes):
        fronts = np.sort(population.front_m[population.lane == lane])
        assert (np.diff(fronts) >= LENGTH_M + TRAFFIC.start_gap_m - 1e-9).all()


def test_ego_starts_on_the_ramp_alone_at_the_speed_of_the_ramp() -> None:
    population = draw(60, 3, RAMP)
    assert population.lane[0] == 0
    assert 0 not in population.lane[1:]
    assert population.speed_m_s[0] == 15.0


def test_more_vehicles_than_fit_are_refused() -> None:
    most = open_capacity(STRAIGHT, LENGTH_M, 8.0)
    assert most == 3 * 184  # 2,395 m in berths of 13 m
    draw(most - 1, 0)
    with pytest.raises(
        ScenarioError,
        match=f"takes {most - 1} vehicles besides the ego on its 3 lanes, not {most}: ",
    ):
        draw(most, 0)


def test_an_open_road_takes_at_most_3000_vehicles_however_long_it_is() -> None:
    # SUMO needs some 10 s a step for 3,000 vehicles on three lanes, minutes for 9,000
    assert open_capacity(STRAIGHT._replace(span_m=40_000.0), LENGTH_M, 8.0) == 3000


def inflow(vehicles: int = 100, seed: int = 0) -> Inflow:
    return Inflow(np.random.default_rng(seed), vehicles, STRAIGHT, LENGTH_M, CONFIG)


def test_vehicles_enter_at_the_rate_that_keeps_their_number() -> None:
    # 100 vehicles at 20 m/s on 2,400 m: 0.83 a second
    found = inflow()
    entering = [found.entering(float(second), {}) for second in range(3000)]
    entered = sum(len(one.ids) for one in entering if one)
    assert entered == pytest.approx(2500, rel=0.04)


def test_a_vehicle_enters_on_the_road_as_a_whole_with_a_name_of_its_own() -> None:
    found, ids = inflow(), []
    for second in range(60):
        if vehicles := found.entering(float(second), {}):
            ids += vehicles.ids
            assert (vehicles.front_m == LENGTH_M).all()
            assert (vehicles.speed_m_s == vehicles.desired_speed_m_s).all()
    assert ids == [f"vehicle{101 + number}" for number in range(len(ids))]


def test_a_vehicle_waits_while_the_last_one_is_too_near_and_enters_behind_it_safely() -> None:
    found = inflow()
    blocked = dict.fromkeys(range(3), Last(12.9, 0.0))  # 7.9 m behind it, below 8 m
    assert not any(found.entering(float(second), blocked) for second in range(100))
    slow = dict.fromkeys(range(3), Last(45.0, 10.0))
    entering = found.entering(100.0, slow)
    assert entering.lane.tolist() == [0, 1, 2]
    # free 40 - 2.5 m: sqrt(10^2 + 2 * 2 * 37.5) = 15.8 m/s stops behind it with 2 m/s^2
    assert entering.speed_m_s.min() >= 10.0
    assert entering.speed_m_s.max() <= 15.82


def test_a_truck_enters_on_the_road_as_a_whole_too() -> None:
    trucks = CONFIG.updated("traffic", truck_share=1.0, truck_length_m=12.0)
    found = Inflow(np.random.default_rng(0), 100, STRAIGHT, LENGTH_M, trucks)
    # its front is at 12 m, so a rear at 19.9 m leaves 7.9 m, below 8 m, where a car has 14.9 m
    near = dict.fromkeys(range(3), Last(19.9, 30.0))
    assert not any(found.entering(float(second), near) for second in range(100))
    entering = found.entering(100.0, {})
    assert entering.front_m.tolist() == [12.0, 12.0, 12.0]


def test_no_vehicle_enters_a_road_without_traffic() -> None:
    assert not any(inflow(0).entering(float(second), {}) for second in range(1000))


@given(
    *(st.floats(low, high) for low, high in ((0.1, 60.0), (0.5, 10.0), (0.0, 500.0), (0.0, 60.0)))
)
def test_one_vehicle_starts_as_fast_as_it_would_among_others(
    desired: float, headway_s: float, gap_m: float, ahead: float
) -> None:
    speeds = np.array([desired, ahead])
    gaps_m = np.array([gap_m, np.inf])
    [one, _] = safe_speeds(speeds, np.array([headway_s, 0.5]), gaps_m, np.array([1, 1]))
    assert safe_speed(desired, headway_s, gap_m, ahead) == pytest.approx(one, rel=1e-12)


@pytest.mark.parametrize(
    ("flow_per_h", "gap_m", "most"),
    [
        (500.0, 8.0, 64),  # 3 lanes of 1,555 m at 20 m/s: 32 vehicles
        (1000.0, 8.0, 130),
        (1500.0, 30.0, 131),  # 97 by the flow; 44 fit in a lane, and one of all is the ego
    ],
)
def test_a_training_begins_with_up_to_twice_the_vehicles_of_the_flow_that_have_room(
    flow_per_h: float, gap_m: float, most: int, tmp_path: Path
) -> None:
    write_scenario(tmp_path / "road", ROAD_TYPES["merge"](flow_per_h=flow_per_h))
    config = Config().with_traffic("calm").updated("traffic", start_gap_m=gap_m)
    assert Fleet(load_scenario(tmp_path / "road"), config).most_in_training == most


def test_a_request_stays_with_its_vehicle_while_others_leave_and_enter() -> None:
    config = with_scenario(Config(), "straight").updated("traffic", random_lane_changes_per_s=0.05)
    kept = moved = 0
    with closing(HighwayEnv(config=config)) as env:
        env.reset(seed=3)
        for _ in range(60):
            simulation, now_s = env.simulation, float(env.scene.snapshot.time_s)
            ids = simulation.fleet.ids
            asked = {ids[row]: request for row, request in simulation.requests.items()}
            env.step(0)
            after = simulation.fleet.ids
            now = {after[row]: request for row, request in simulation.requests.items()}
            for name, (lane, end_s) in asked.items():
                if name not in after:
                    assert name not in now
                elif now[name][1] == end_s:  # not asked anew
                    assert now[name] == (lane, end_s)
                    kept += 1
                    moved += ids.index(name) != after.index(name)
            assert all(end_s >= now_s for name, (_, end_s) in now.items() if name not in asked)
    assert min(kept, moved) > 20
