"""The twin on open roads: the traffic of SUMO, which enters and leaves, and makes room for the ego.

On the merge road the traffic's edges begin at 0, 500 and 750 m; lane 0 is the ramp, which exists on
the second of them only.
"""

import math
from contextlib import closing

import gymnasium
import numpy as np
import pytest

from drl_av.config import Config
from drl_av.drivers.registry import load_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.vector import TwinVectorEnv
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.inflow import last_vehicles
from drl_av.simulation.population import ARRAYS
from drl_av.twin.commands import request_change
from drl_av.twin.following import EPS, krauss_speed
from drl_av.twin.lane_speeds import expect_anew
from drl_av.twin.lateral_room import request_of
from drl_av.twin.neighbors import edge_of, next_edge
from drl_av.twin.traffic import (
    exchange,
    net_of,
    place_vehicles,
    routes_of,
    sizes_of,
    sort_and_activate,
)
from drl_av.twin.worlds import (
    BY_RANK,
    COUNT,
    DESIRED_M_S,
    EDGE,
    EDGE_BEGIN,
    EDGE_LENGTH,
    EXPECTED_M_S,
    FIRST_LANE,
    FRONT_M,
    LANE,
    ORDER,
    Net,
    World,
    empty_worlds,
)

CALM = Config().with_traffic("calm")
# seed 12 on the merge road: the ego asks for room until it has stopped, and others let it in


@pytest.mark.parametrize(
    ("road", "traffic", "seed", "decisions"),
    [
        *(("straight", "calm", 7, 95), ("straight", "overtaking", 16, 98)),
        *(("merge", "calm", 12, 75), ("merge", "overtaking", 24, 44)),
        *(("exit", "calm", 4, 50), ("ramp_to_ramp", "calm", 13, 68)),
    ],
)
def test_an_episode_is_the_same_as_in_sumo(
    road: str, traffic: str, seed: int, decisions: int
) -> None:
    config, driver = Config().with_traffic(traffic), load_driver("gap-mobil")
    twin = HighwayEnv(road, "paper", config.updated("simulation", world="twin"))
    with closing(HighwayEnv(road, "paper", config)) as sumo:
        sumo.reset(seed=seed)
        twin.reset(seed=seed)
        over, made = False, 0
        while not over:
            action = driver.act(sumo.scene, sumo.observation).number
            seen, reward, *ends, info = sumo.step(action)
            seen_there, reward_there, *ends_there, there = twin.step(action)
            assert seen_there == pytest.approx(seen, abs=1e-5), made
            assert reward_there == pytest.approx(reward, abs=1e-5)
            assert twin.scene.snapshot.ids == sumo.scene.snapshot.ids
            assert ends_there == ends
            assert there["way"] == info["way"]
            over, made = any(ends), made + 1
    assert made == decisions


@pytest.mark.parametrize("road", ["straight", "merge", "exit", "ramp_to_ramp"])
def test_many_worlds_drive_as_one(road: str) -> None:
    name = {"straight": "Straight", "merge": "Merge", "exit": "Exit"}.get(road, "RampToRamp")
    twin = {"simulation": {"world": "twin"}}
    many = gymnasium.make_vec(
        f"drl_av/{name}-v0", num_envs=3, vectorization_mode="vector_entry_point"
    ).unwrapped
    one = gymnasium.make(f"drl_av/{name}-v0", config=twin).unwrapped
    assert many.single_observation_space.shape == one.observation_space.shape == (30,)
    many.reset(seed=5)
    _, info = one.reset(seed=6)  # the second of the three
    draws, entered = np.random.default_rng(0), set(one.scene.snapshot.ids)
    for _ in range(60):
        actions = draws.integers(0, 12, 3)
        if info["action_mask"][1]:
            actions[1] = 1
        seen, rewards, *all_ends, infos = many.step(actions)
        seen_there, reward, *ends, info = one.step(int(actions[1]))
        assert seen[1] == pytest.approx(seen_there)
        assert rewards[1] == pytest.approx(reward)
        assert [bool(end[1]) for end in all_ends] == ends
        for name in ("vehicles", "way", "is_success", "rule", "collided_with", "action_mask"):
            assert np.array_equal(infos[name][1], info[name]), name
        assert many.scene(1).snapshot.ids == one.scene.snapshot.ids
        entered |= set(one.scene.snapshot.ids)
        if any(ends):
            break
    assert len(entered) > len(one.scene.snapshot.ids)  # some have left


def test_who_has_left_the_road_is_out_of_sight_of_many_worlds_too() -> None:
    config = {"simulation": {"world": "twin"}, "observation": {"range_m": 1000.0}}
    kind = {"num_envs": 1, "vectorization_mode": "vector_entry_point", "config": config}
    many = gymnasium.make_vec("drl_av/Straight-v0", **kind)
    one = gymnasium.make("drl_av/Straight-v0", config=config).unwrapped
    for env in (one, many):
        env.reset(seed=1_000_008, options={"vehicles": 5})
    for decision in range(66):  # at the 63rd the one ahead is 416 m away, and has left
        (seen, *_), (there, *_) = one.step(1), many.step(np.array([1]))
        assert there[0] == pytest.approx(seen, abs=1e-6), decision


@pytest.fixture(scope="module")
def net() -> Net:
    return net_of(load_scenario(find_scenario("merge")), CALM)


def test_the_edges_of_a_road_are_those_of_its_network(net: Net) -> None:
    assert net.edges_m[EDGE_BEGIN].tolist() == [0.0, 500.0, 750.0]
    assert net.edges_m[EDGE_LENGTH].tolist() == [500.0, 250.0, 1000.0]
    assert net.edge_lanes[FIRST_LANE].tolist() == [1, 0, 1]
    assert [edge_of(at_m, net) for at_m in (0.0, 499.9, 500.0, 750.0, 5000.0)] == [0, 0, 1, 2, 2]
    assert [next_edge(edge, net) for edge in range(3)] == [1, 2, -1]
    assert net.edge_lanes[BY_RANK].tolist() == [2, 0, 1]  # after, before, beside


def test_sumo_regards_the_rest_of_the_route_as_far_as_it_needs_to() -> None:
    assert routes_of(np.full(7, 400.0), False).tolist() == [2800, 2400, 2000, 1600, 1200, 800, 400]
    # 3 edges make 3000 m, but it regards at least 5
    assert routes_of(np.full(8, 1000.0), False).tolist()[:5] == [5000, 5000, 5000, 5000, 4000]
    # at most 9 edges, as many as make 3000 m, and at least 5
    ahead = {m: {*routes_of(np.full(4, m), True)} for m in (125.0, 375.0, 700.0, 5000.0)}
    assert ahead == {125.0: {1125.0}, 375.0: {3000.0}, 700.0: {3500.0}, 5000.0: {25_000.0}}
    # from the edge of 900 m: 900 + 1,000 + 400 + 900 + 1,000
    assert routes_of(np.array([1000.0, 400.0, 900.0]), True)[2] == 4200.0


def test_the_ego_could_stop_in_whole_steps() -> None:
    # 20, 18, ..., 2 m/s for half a second each after 0.5 s at 20 m/s: 10 + 0.5 * 90 = 55 m
    assert krauss_speed(30.0, 55.0 + EPS, 0.0, 0.5) == pytest.approx(20.0)
    # another 1.5 s at 20 m/s are 30 m
    assert krauss_speed(30.0, 75.0 + EPS, 0.0, 1.5) == pytest.approx(20.0)
    # behind a vehicle that stops from 10 m/s in 0.5 * (8 + 6 + 4 + 2) = 10 m
    assert krauss_speed(30.0, 45.0 + EPS, 10.0, 0.5) == pytest.approx(20.0)
    assert krauss_speed(15.0, 55.0 + EPS, 0.0, 0.5) == 16.0  # it accelerates with 2 m/s^2 at most
    assert krauss_speed(15.0, 0.0, 0.0, 0.5) == 0.0


def placed(net: Net, vehicles: int = 5) -> World:
    env = HighwayEnv("merge", config=CALM.updated("simulation", world="twin"))
    env.reset(seed=1, options={"vehicles": vehicles})
    fleet = env.simulation.fleet
    world = World(*(array[0] for array in empty_worlds(1, 40, net.lanes)))
    place_vehicles(world, net, fleet.population, fleet.driver_models, fleet.scenario, fleet.config)
    return world


def test_a_request_names_a_lane_as_its_edge_counts_them(net: Net) -> None:
    world = placed(net)
    world.z[EDGE, 1], world.z[LANE, 1] = 1, 2
    request_change(world, net, 1, -1, 10)  # to lane 1, the second of this edge
    assert request_of(world, net, 1) == -1
    world.z[EDGE, 1] = 2  # where the second lane is lane 2: SUMO keeps it there
    assert request_of(world, net, 1) == 2
    world.z[LANE, 1] = 1
    assert request_of(world, net, 1) == 1


def test_on_an_edge_with_other_lanes_a_driver_expects_its_rightmost_lane_anew(net: Net) -> None:
    world = placed(net)
    expected = world.x[EXPECTED_M_S : EXPECTED_M_S + 4, 1]
    desired = world.x[DESIRED_M_S, 1]
    expected[:], world.z[EDGE, 1] = [9.0, 10.0, 11.0, 12.0], 1
    expect_anew(world, net, 1)
    assert expected.tolist() == [desired, 10.0, 11.0, 12.0]
    expected[:], world.z[EDGE, 1] = [9.0, 10.0, 11.0, 12.0], 2  # without lane 0
    expect_anew(world, net, 1)
    assert expected.tolist() == [-1.0, desired, 11.0, 12.0]


def test_vehicles_leave_and_enter(net: Net) -> None:
    world = placed(net)
    env = HighwayEnv("merge", config=CALM.updated("simulation", world="twin"))
    env.reset(seed=1, options={"vehicles": 5})
    fleet = env.simulation.fleet
    newcomer = fleet.population.rows([3])
    end_m = net.edges_m[EDGE_BEGIN, -1] + net.edges_m[EDGE_LENGTH, -1]
    world.x[FRONT_M, :6] = [400.0, 300.0, end_m + 1.0, 200.0, end_m - 1.0, 100.0]
    sort_and_activate(world, net)
    kept, models = np.array([0, 1, 3, 5]), np.zeros(1, np.int64)  # 2 and 4 have left
    sizes_m = sizes_of(fleet.scenario, fleet.config)
    exchange(world, net, kept, ARRAYS(newcomer), models, sizes_m)
    entered_m = float(newcomer.front_m[0])
    fronts_m = [400.0, 300.0, 200.0, 100.0, entered_m, end_m - 1.0]  # 4 still drives, behind all
    assert world.near[COUNT] == 6
    assert world.x[FRONT_M, :6].tolist() == fronts_m
    assert world.x[FRONT_M, world.z[ORDER, :6]].tolist() == sorted(fronts_m, reverse=True)
    exchange(world, net, np.arange(5), ARRAYS(newcomer), models[:0], sizes_m)  # no vehicle enters
    assert world.x[FRONT_M, : world.near[COUNT]].tolist() == fronts_m
    world.x[FRONT_M, 5] = end_m
    exchange(world, net, np.array([0, 2, 3, 4]), ARRAYS(newcomer), models[:0], sizes_m)
    assert world.x[FRONT_M, : world.near[COUNT]].tolist() == [400.0, 200.0, 100.0, entered_m, 300.0]


def test_the_last_vehicle_of_a_lane_is_the_one_whose_rear_is_farthest_back() -> None:
    s_m, y_m = np.array([30.0, 20.0, 25.0, 5.0]), np.array([0.0, 3.8, 5.7, 0.0])
    length_m, width_m = np.array([5.0, 5.0, 16.0, 5.0]), np.full(4, 1.8)
    last = np.empty(4, np.int64)
    last_vehicles(np.array([0, 1, 2]), s_m, y_m, length_m, width_m, 3.8, last)
    assert last.tolist() == [0, 2, 2, -1]  # the third, 16 m long, is in two lanes; 3 has left
    last_vehicles(np.array([0, 1, 3]), s_m, y_m, length_m, width_m, 3.8, last)
    assert last.tolist() == [3, 1, -1, -1]


def test_a_lane_that_ends_is_braked_for_in_many_worlds_too() -> None:
    many = TwinVectorEnv(2, "merge", "paper", CALM)
    many.reset(seed=3)
    stopped_m, hits = math.inf, 0
    for _ in range(40):
        *_, info = many.step(np.ones(2, np.int64))  # accelerate, on the ramp
        hits += int((info["collision"] == "edge").sum())
        scene = many.scene(0)
        if scene.snapshot.speed_m_s[0] == 0.0:
            stopped_m = min(stopped_m, float(scene.snapshot.s_m[0]) + 2.5)
    assert hits == 0
    assert 740.0 < stopped_m <= 750.0


def test_a_collision_names_its_vehicle_although_others_leave_in_the_same_decision() -> None:
    worlds = TwinVectorEnv(200, "exit", "permit_all", CALM, autoreset_mode="Disabled")
    worlds.reset(seed=3_000_000)
    rng, exchanged = np.random.default_rng(1), 0
    for _ in range(8):
        _, _, terminated, truncated, info = worlds.step(rng.integers(12, size=200))
        for row in np.flatnonzero(info["collided_with"] != "").tolist():
            shot = worlds.scene(row).snapshot
            other = shot.ids.index(info["collided_with"][row])
            assert abs(shot.s_m[other] - shot.s_m[0]) < 20.0
            exchanged += row in worlds.kept
        over = terminated | truncated
        worlds.reset(options={"reset_mask": over})
    assert exchanged > 3
