"""Compiled functions give the numbers of their plain forms in ``oracles``, to the last bit."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from oracles import affordances, finite_state, paper, plan, reward, rules, strict
from worlds import seen_from

from drl_av.compiled import compiled
from drl_av.config import Config
from drl_av.drivers.background.finite_state import finite_state as decide
from drl_av.drivers.driver import Driver
from drl_av.drivers.rule_based import IdmDriver, MobilDriver
from drl_av.driving import maneuver
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import CODES, VALUES, complete, compute_indicators, indicators
from drl_av.driving.nearest import Along, find_nearest, sort_along
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.reward import Rewards, reward_terms
from drl_av.road.road import (
    PartialLane,
    Road,
    holds,
    is_beside,
    is_open_at,
    lane_end_m,
    lane_of,
    mandatory_change,
    road_numbers,
)
from drl_av.road.snapshot import Snapshot
from drl_av.road.sweep import NO_CONTACT, swept_collision
from drl_av.safety.paper import Paper
from drl_av.safety.strict import Strict

SCENES = 1_500
LAP_M = 2.0**20
RAMP, LANE_DROP = PartialLane(0, 200, 500, 220, 480), PartialLane(0, 600, math.inf, 600, 900)
ROADS = (
    Road(500.0, 3.8, (True,) * 3),
    Road(731.3, 3.2, (True, False, True)),
    Road(LAP_M, 3.8, (True,) * 3, end_m=1000.0, partial_lanes=(RAMP,)),
    Road(LAP_M, 3.8, (True,) * 4, 1000.0, (RAMP, LANE_DROP), exit_m=900.0),
)
EGOS = (
    {},
    {"longitudinal_reference": "idm"},
    {"longitudinal_reference": "acc", "lane_change_duration_s": 4.0},
)
CHANGES: tuple[dict[str, dict[str, object]], ...] = (
    {},
    {"safety": {"printed_rule_1": True}, "strict": {"braking_m_s2": 6.0, "clearance_m": 1.0}},
    {"safety": {"printed_rule_3": True}, "reward": {"desired": "best-lane"}},
    {"safety": {"minimum_gap_m": 5.0}, "reward": {"desired": "fixed"}},
    {"simulation": {"step_length_s": 0.1}},
)


def scenes(seed: int) -> Iterator[tuple[Scene, Road, Config]]:
    """Scenes with vehicles anywhere, beside each other too, each with a config."""
    rng = np.random.default_rng(seed)
    for number in range(SCENES):
        road, config = ROADS[number % len(ROADS)], Config()
        for section, settings in CHANGES[number % len(CHANGES)].items():
            config = config.updated(section, **settings)
        config = config.updated("ego", **EGOS[number % len(EGOS)])
        yield scene(rng, road, config.observation.range_m), road, config


def scene(rng: np.random.Generator, road: Road, range_m: float) -> Scene:
    n, lap_m = int(rng.integers(1, 36)), min(road.lap_m, 1000.0)
    off_m = (rng.random(n) < 0.4) * rng.uniform(-road.lane_width_m, road.lane_width_m, n) / 2
    shot = Snapshot(
        0.0,
        tuple(map(str, range(n))),
        np.where(rng.random(n) < 0.2, 10.0, 1.0) * rng.uniform(0, lap_m, n) % lap_m,
        road.lane_width_m * rng.integers(0, len(road.open_lanes), n) + off_m,
        rng.uniform(0, rng.choice((15.0, 40.0)), n) * (rng.random(n) < 0.9),
        rng.uniform(-1, 1, n) * (rng.random(n) < 0.3),
        rng.uniform(3, 15, n),
        rng.uniform(1.5, 2.6, n),
    )
    right, change = math.floor(shot.y_m[0] / road.lane_width_m), None
    if rng.random() < 0.5:
        lanes = (right, right + 1) if rng.random() < 0.5 else (right + 1, right)
        change = LaneChange(*lanes)
    return Scene(shot, compute_indicators(shot, road, range_m), change, road)


def test_the_scenes_are_of_all_kinds() -> None:
    found = [paper.paper(world, ACTIONS[9], config.safety) for world, _, config in scenes(0)]
    assert len({str(verdict.rule) for verdict in found}) == 6
    assert sum(world.lane_change is not None for world, *_ in scenes(0)) > SCENES / 3
    gaps_m = [world.affordances.own_front for world, *_ in scenes(0)]
    assert sum(front is not None and front.gap_m == 0.0 for front in gaps_m) > 20
    assert any(world.affordances.barriers for world, *_ in scenes(0))


def test_indicators() -> None:
    for world, road, config in scenes(1):
        expected = affordances.compute_affordances(world.snapshot, road, config.observation.range_m)
        assert repr(world.affordances) == repr(expected)
        assert world.indicators.values[:27].tobytes() == affordances.vector(expected).tobytes()


def test_paper() -> None:
    for world, _, config in scenes(2):
        verdicts = Paper(config.safety).verdicts(world)
        for action in ACTIONS:
            assert verdicts.of(action) == paper.paper(world, action, config.safety)


def test_strict() -> None:
    for world, _, config in scenes(3):
        settings = config.strict, config.ego, config.simulation
        check, oracle = Strict(*settings), strict.Strict(*settings)
        assert check.fallback_is_free(world) == oracle.fallback_is_free(world)
        verdicts = check.verdicts(world)
        for action in ACTIONS:
            assert verdicts.of(action) == oracle(world, action)


@pytest.mark.parametrize("plant", ["kinematic", "steering"])
def test_plan(plant: str) -> None:
    rng = np.random.default_rng(4)
    for world, _, config in scenes(4):
        if plant == "steering" and world.lane_change is not None:
            turned = world.lane_change._replace(heading_rad=float(rng.uniform(-0.1, 0.1)))
            world = replace(world, lane_change=turned)
        ego, action = replace(config.ego, lateral_plant=plant), ACTIONS[rng.integers(12)]
        found = maneuver.plan(world, action, ego, config.simulation)
        assert repr(found) == repr(plan.plan(world, action, ego, config.simulation))


def test_rule_based_drivers() -> None:
    for world, _, config in scenes(10):
        settings, nothing = (config.safety, config.ego, config.mobil), np.empty(0, np.float32)
        pairs: list[tuple[Driver, Driver]] = [
            (IdmDriver(config.safety), rules.IdmDriver(config.safety)),
            (MobilDriver(*settings), rules.MobilDriver(*settings)),
            (MobilDriver(*settings, 1.1), rules.MobilDriver(*settings, 1.1)),
        ]
        for driver, oracle in pairs:
            assert driver.act(world, nothing) == oracle.act(world, nothing)


def test_reward() -> None:
    for world, road, config in scenes(5):
        target = reward.desired(world.affordances, config.reward, config.safety)
        gap_m = config.safety.minimum_gap_m
        expected = reward.rewards(world.affordances, target, config.reward, gap_m)
        settings = config.reward.numbers, config.safety.numbers
        values, codes, *_ = world.indicators
        terms = reward_terms(values, codes, road.lane_width_m, *settings)
        assert Rewards(*terms) == expected


def test_the_finite_state_machine_of_any_vehicle() -> None:
    rng = np.random.default_rng(6)
    decides = compiled(decide)
    for world, road, config in scenes(6):
        if not road.partial_lanes:
            row, state = rng.integers(len(world.snapshot.ids)), int(rng.integers(3))
            desired_m_s, settings = float(rng.uniform(10, 35)), config.finite_state
            seen = finite_state.surroundings(world.snapshot, road, 250.0, np.array([row]))
            wanted = np.array([state]), np.array([desired_m_s]), settings
            states, decisions = finite_state.finite_state(seen, *wanted)
            shot = seen_from(world.snapshot, int(row))
            values, codes, *_ = compute_indicators(shot, road, 250.0)
            expected = states[0], decisions.acceleration_m_s2[0], decisions.side[0]
            given = settings.numbers
            found = decides(values, codes, road.lane_width_m, state, desired_m_s, given)
            assert found == expected


def test_the_indicators_of_any_vehicle_in_the_place_of_the_ego() -> None:
    rng = np.random.default_rng(7)
    for world, road, config in scenes(7):
        row, range_m = int(rng.integers(len(world.snapshot.ids))), config.observation.range_m
        values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
        numbered = road_numbers(road)
        indicators(world.snapshot.arrays, numbered, range_m, values, codes, row)
        expected = compute_indicators(seen_from(world.snapshot, row), road, range_m)
        assert values.tobytes() == expected.values.tobytes()


def test_the_order_along_the_road_finds_the_same_vehicles_as_a_look_at_all() -> None:
    rng = np.random.default_rng(11)
    for world, road, config in scenes(11):
        shot, range_m = world.snapshot, config.observation.range_m
        n, row, numbered = len(shot.ids), int(rng.integers(len(shot.ids))), road_numbers(road)
        if rng.random() < 0.3:  # vehicles at the very same place
            shot.s_m[rng.integers(n, size=n // 2)] = shot.s_m[row]
        order, places = np.empty(n, np.int64), np.empty(n, np.int64)
        road_m, state = (road.lap_m, road.lane_width_m), shot.arrays
        longest_m, *lanes = sort_along(state, road.lane_width_m, order, places)
        along = Along(order, places, longest_m, tuple(lanes))
        wanted, all_codes = np.empty(VALUES), np.empty(CODES, np.int64)
        indicators(state, numbered, range_m, wanted, all_codes, row)
        for looks_aside in (True, False):
            values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
            find_nearest(state, road_m, along, range_m, row, looks_aside, values, codes)
            complete(state, numbered, range_m, values, codes, row)
            seen = slice(None) if looks_aside else slice(4)
            assert values[seen].tobytes() == wanted[seen].tobytes()
            assert codes[0] == all_codes[0]
            assert not looks_aside or np.array_equal(codes, all_codes)


def test_roads() -> None:
    rng, of_lane = np.random.default_rng(8), (is_open_at, lane_end_m)
    fast = {each: compiled(each) for each in (*of_lane, is_beside, holds, mandatory_change)}
    for road in ROADS:
        numbered = road_numbers(road)
        for _ in range(SCENES):
            lane, at_m = int(rng.integers(-1, 5)), float(rng.integers(0, 100) * 10)
            y_m, width_m = float(rng.uniform(-3, 16)), float(rng.uniform(1, 3))
            aside = lane + int(rng.choice((-1, 1)))
            assert lane_of(y_m, road.lane_width_m) == road.lane_of(y_m)
            for each in of_lane:
                assert fast[each](lane, at_m, numbered) == each(lane, at_m, road)
            beside = lane, aside, at_m
            assert fast[is_beside](*beside, numbered) == is_beside(*beside, road)
            body = y_m, width_m, at_m
            assert fast[holds](*body, numbered) == holds(*body, road)
            if is_open_at(lane, at_m, road):
                found = fast[mandatory_change](lane, at_m, numbered)
                assert found == mandatory_change(lane, at_m, road)


def test_collisions() -> None:
    rng, hits = np.random.default_rng(9), 0
    for world, road, _ in scenes(9):
        shot, n = world.snapshot, len(world.snapshot.ids)
        near_m = (shot.s_m[0] + rng.uniform(-25, 25, n)) % road.lap_m
        near_m[0] = shot.s_m[0]
        before = shot._replace(s_m=near_m)
        y_m = shot.y_m + rng.uniform(-1, 1, n) * (rng.random(n) < 0.5)
        after = before._replace(s_m=(near_m + rng.uniform(-0.5, 20, n)) % road.lap_m, y_m=y_m)
        ways = before.s_m, before.y_m, after.s_m, after.y_m
        found = swept_collision(*ways, shot.length_m, shot.width_m, road.lap_m)
        assert found == swept_collision.python(*ways, shot.length_m, shot.width_m, road.lap_m)
        hits += found[1] != NO_CONTACT
    assert hits > SCENES / 3
