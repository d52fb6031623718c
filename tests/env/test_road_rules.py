"""Forbidden lines and speed limits along a road: the ego, its check and its drivers obey them."""

import copy
import os
import pickle
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from drives import KEEP, LEFT
from hypothesis import given
from hypothesis import strategies as st
from nets import Part, along, chain, converted
from reward_terms import desired

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.driving.actions import ACTIONS
from drl_av.driving.maneuver import plan
from drl_av.env.episode_start import most_decisions
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import ConfigError, DrlAvWarning, ScenarioError
from drl_av.road.road import (
    LIMIT_BRAKING_M_S2,
    OPEN_LAP_M,
    ForbiddenLine,
    Road,
    SpeedLimit,
    allowed_speed,
    allowed_speed_in,
    may_cross,
    road_numbers,
)
from drl_av.scenarios.folder import find_scenario, load_scenario, write_scenario
from drl_av.scenarios.highways import ExitDescription
from drl_av.scenarios.imported.description import ImportedDescription
from drl_av.scenarios.road_description import PlacedVehicle

SLOW = (SpeedLimit(0.0, 500.0, 30.0), SpeedLimit(500.0, 600.0, 8.0), SpeedLimit(600.0, 900.0, 30.0))
LINES = (ForbiddenLine(0, 1, 100.0, 300.0), ForbiddenLine(1, -1, 100.0, 300.0))
ROAD = Road(
    OPEN_LAP_M, 3.5, (True,) * 3, 900.0, speed_limits=(SLOW, SLOW[:1], SLOW), forbidden_lines=LINES
)


def test_the_allowed_speed_lets_the_ego_brake_to_each_limit_ahead() -> None:
    # 209 m before 8 m/s: v^2 = 8^2 + 2 x 2 x 209 = 30^2
    assert allowed_speed(SLOW, 291.0) == pytest.approx(30.0)
    assert allowed_speed(SLOW, 391.0) == pytest.approx((64 + 4 * 109) ** 0.5)
    assert allowed_speed(SLOW, 500.0) == allowed_speed(SLOW, 599.9) == 8.0
    assert allowed_speed(SLOW, 600.0) == 30.0
    assert allowed_speed(SLOW, 900.0) == allowed_speed((), 5.0) == np.inf


@given(st.integers(0, 3), st.floats(-100, 1000), st.sampled_from([0.0, 0.1, 0.5, 1.0]))
def test_the_compiled_form_of_the_allowed_speed_is_the_same(
    lane: int, front_m: float, step_s: float
) -> None:
    limits = ROAD.speed_limits[lane] if lane < 3 else ()
    found = allowed_speed_in(road_numbers(ROAD).speed_limits, lane, front_m, step_s)
    assert found == allowed_speed(limits, front_m, step_s)


@given(st.integers(0, 2), st.sampled_from([-1, 1]), st.floats(0, 900), st.floats(0, 200))
def test_the_compiled_form_of_forbidden_lines_is_the_same(
    lane: int, side: int, from_m: float, long_m: float
) -> None:
    to_m = from_m + long_m
    found = may_cross(lane, side, from_m, to_m, road_numbers(ROAD))
    passed = [line for line in LINES if line.begin_m <= to_m and from_m < line.end_m]
    assert found == ((lane, side) not in [line[:2] for line in passed])


@given(st.floats(0, 30), st.floats(0.0, 700.0), st.sampled_from([0.1, 0.5, 1.0]))
def test_an_ego_that_keeps_the_allowed_speed_never_brakes_harder_than_stated(
    speed: float, front_m: float, step_s: float
) -> None:
    speed = min(speed, allowed_speed(SLOW, front_m, step_s))
    for _ in range(200):
        front_m += speed * step_s
        after = min(speed + 2 * step_s, allowed_speed(SLOW, front_m, step_s))
        assert after >= speed - LIMIT_BRAKING_M_S2 * step_s - 1e-9
        inside = [limit for begin, end, limit in SLOW if begin <= front_m + after * step_s < end]
        assert after <= min(inside, default=np.inf) + LIMIT_BRAKING_M_S2 * step_s + 1e-9
        speed = after


def solid(folder: Path) -> Path:
    """Three lanes; after 1,000 m no line may be crossed for 600 m."""
    nodes = "".join(f'<node id="n{k}" x="{x}" y="0"/>' for k, x in enumerate((0, 1000, 1600, 2500)))
    lane = '<lane index="{}" changeLeft="authority" changeRight="authority"/>'
    closed = "".join(lane.format(index) for index in range(3))
    edges = "".join(
        f'<edge id="e{k}" from="n{k}" to="n{k + 1}" numLanes="3" speed="36" width="3.5">'
        f"{closed if k == 1 else ''}</edge>"
        for k in range(3)
    )
    return converted(folder, nodes, edges, None)


def placed(folder: Path, check: str, at_m: float, lane: int = 1) -> HighwayEnv:
    ego = PlacedVehicle("ego", lane, at_m, 20.0, 30.0)
    write_scenario(folder / "road", along(solid(folder), 2, vehicles=(ego,)))
    return HighwayEnv(folder / "road", safety_check=check)


@pytest.mark.parametrize("check", ["paper", "strict"])
@pytest.mark.parametrize(("at_m", "starts"), [(880.0, True), (905.0, False), (1200.0, False)])
def test_no_change_of_lanes_begins_that_would_meet_a_forbidden_line(
    check: str, at_m: float, starts: bool, tmp_path: Path
) -> None:
    # a change takes 5 s, 100 m at 20 m/s; the line begins at 1,000 m
    with closing(placed(tmp_path, check, at_m)) as env:
        env.reset(seed=0)
        assert env.scene.affordances.left_lane is starts
        *_, info = env.step(LEFT)
        assert (info["rule"] == "none") is starts
        for _ in range(5):
            *_, info = env.step(KEEP)
        assert info["collision"] == ""
        assert env.scene.affordances.lane == (2 if starts else 1)
        assert float(env.scene.snapshot.y_m[0]) == pytest.approx(7.0 if starts else 3.5)


def test_without_a_check_the_ego_crosses_the_line(tmp_path: Path) -> None:
    with closing(placed(tmp_path, "permit_all", 1200.0)) as env:
        env.reset(seed=0)
        for _ in range(5):
            *_, info = env.step(LEFT)
        assert info["collision"] == ""
        assert float(env.scene.snapshot.y_m[0]) == pytest.approx(7.0)


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A solid line, and a road whose second edge allows 12 m/s."""
    home = tmp_path_factory.mktemp("roads")
    write_scenario(home / "solid", along(solid(home), 2, flow_per_h=900.0))
    net = chain(home, Part(2, 36.0), Part(2, 12.0), Part(2, 36.0))
    write_scenario(home / "slow", along(net, 2, flow_per_h=600.0))
    return home


@pytest.fixture
def slow(roads: Path) -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(roads / "slow", safety_check="strict")) as env:
        yield env


def test_lane_changes_longer_than_the_look_at_a_line_are_refused(roads: Path) -> None:
    longer = Config().updated("ego", lane_change_duration_s=6.0)
    with pytest.raises(ConfigError, match=r"is 6, but .* may not be crossed it must be at most 5"):
        HighwayEnv(roads / "solid", config=longer)


@pytest.mark.parametrize("name", ["gap-mobil", "idm-mobil", "sumo"])
def test_rule_based_drivers_and_the_traffic_keep_their_lane_beside_a_solid_line(
    name: str, roads: Path
) -> None:
    config = Config().updated("simulation", scenario=str(roads / "solid"))
    crossed, elsewhere = set(), 0
    with closing(HighwayEnv(config=config.updated("safety", check="strict"))) as env:
        for made in rollout(env, rule_driver(name, env.config), 3):
            before, after = made.scene.snapshot, made.next_scene.snapshot
            lane_of = env.road.lane_of
            for row, vehicle in enumerate(after.ids):
                old = before.ids.index(vehicle) if vehicle in before.ids else None
                if old is None or lane_of(before.y_m[old]) == lane_of(after.y_m[row]):
                    continue
                if before.s_m[old] > 1030.0 and after.s_m[row] < 1590.0:
                    crossed.add((vehicle, float(after.s_m[row])))
                else:
                    elsewhere += 1
    assert not crossed
    assert elsewhere > 3


def test_the_ego_keeps_the_limit_and_everything_that_it_sees_shows_it(slow: HighwayEnv) -> None:
    slow.reset(seed=2, options={"vehicles": 0})
    begins_m, ends_m = (limit.begin_m for limit in slow.road.speed_limits[0][1:])
    speeds = []
    for made in rollout(slow, rule_driver("gap-mobil", slow.config), 2, 0):
        shot = made.next_scene.snapshot
        front_m, speed = float(shot.s_m[0]) + 2.5, float(shot.speed_m_s[0])
        speeds.append((front_m, speed))
        sees = made.next_scene.affordances
        assert speed <= sees.allowed_speed_m_s + 1e-6
        target = desired(made.next_scene.indicators, slow.config.reward, slow.config.safety)
        assert target.speed_m_s <= min(30.0, sees.allowed_speed_m_s) + 1e-9
    inside = [speed for front_m, speed in speeds if begins_m <= front_m < ends_m]
    assert max(inside) == pytest.approx(12.0)
    assert max(speed for _, speed in speeds) > 28.0
    rates = np.diff([speed for _, speed in speeds])
    assert rates.min() >= -LIMIT_BRAKING_M_S2 - 1e-6


def test_a_group_of_the_observation_shows_the_allowed_speed(roads: Path) -> None:
    with closing(HighwayEnv(roads / "slow", observation=["ego", "speed_limit"])) as env:
        observation, _ = env.reset(seed=2)
        allowed = env.scene.affordances.allowed_speed_m_s
        assert observation[-1] == pytest.approx(min(allowed / 30.0, 1.0))
    with closing(HighwayEnv(observation=["ego", "speed_limit"])) as env:
        assert env.reset(seed=2)[0][-1] == 1.0


@pytest.mark.parametrize("action", [0, 1, 2, 3])
def test_the_plan_of_each_action_keeps_the_limits(action: int, slow: HighwayEnv) -> None:
    slow.reset(seed=2, options={"vehicles": 0})
    for _ in range(4):
        slow.step(1)
    scene, ego, timing = slow.scene, slow.config.ego, slow.config.simulation
    front_m = 0.0
    for command in plan(scene, ACTIONS[action], ego, timing).commands:
        limits = scene.affordances.speed_limits
        assert command.speed_m_s <= allowed_speed(limits, front_m, timing.step_length_s) + 1e-9
        front_m += command.speed_m_s * timing.step_length_s


def test_the_ego_and_the_traffic_start_slow_enough_for_the_limit_ahead(roads: Path) -> None:
    with closing(HighwayEnv(roads / "slow")) as env:
        for seed in range(5):
            env.reset(seed=seed)
            shot, limits = env.scene.snapshot, env.road.speed_limits
            fronts_m = shot.s_m + shot.length_m / 2
            for y_m, front_m, speed in zip(shot.y_m, fronts_m, shot.speed_m_s, strict=True):
                lane = limits[env.road.lane_of(float(y_m))]
                assert speed <= allowed_speed(lane, float(front_m), 1.0) + 1e-6


def test_a_wide_lane_is_one_strip_for_sumo_and_strict_accepts_it(tmp_path: Path) -> None:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="1500" y="0"/>'
    edge = '<edge id="A" from="a" to="b" numLanes="3" speed="36" width="4"/>'
    net = converted(tmp_path, nodes, edge, None)
    write_scenario(tmp_path / "road", ImportedDescription(net=str(net), from_edge="A", to_edge="A"))
    with closing(HighwayEnv(tmp_path / "road", safety_check="strict")) as env:
        env.reset(seed=1)
        for _ in range(10):
            assert env.step(1)[4]["collision"] == ""
        there = env.simulation._sumo.simulation.getOption("lateral-resolution")
        assert float(there) == 4.0


def test_an_episode_is_as_long_as_a_far_exit_needs(tmp_path: Path) -> None:
    write_scenario(tmp_path / "far", ExitDescription(approach_m=7000.0, flow_per_h=0.0))
    with closing(HighwayEnv(tmp_path / "far", safety_check="strict")) as env:
        driven = [*rollout(env, rule_driver("gap-mobil", env.config), 1, 0)]
        # 7,100 m at 30 m/s
        assert 236 <= len(driven) < 260
        assert driven[-1].route_outcome == "exit taken"
    short = Config().updated("simulation", decisions_per_episode=20)
    warns = "its way takes 237 decisions, but an episode has 20"
    with pytest.warns(DrlAvWarning, match=warns):
        env = HighwayEnv(tmp_path / "far", config=short)
    with closing(env):
        assert len([*rollout(env, rule_driver("idm", env.config), 1, 0)]) == 20
    layout = load_scenario(tmp_path / "far").layout
    slow = layout.start._replace(speed_limits=(SpeedLimit(0.0, OPEN_LAP_M, 10.0),))
    assert most_decisions(Config(), layout._replace(start=slow)) == 1420  # twice 710 s at 10 m/s
    with warnings.catch_warnings(action="error"):
        enough = Config().updated("simulation", decisions_per_episode=150)
        for config, most in ((None, 200), (enough, 150)):
            with closing(HighwayEnv(find_scenario("exit"), config=config)) as env:
                assert env._most_decisions == most


def test_a_relative_scenario_survives_another_working_directory(
    roads: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(roads)
    with closing(HighwayEnv("slow")) as env:
        first = env.reset(seed=1)[0]
        monkeypatch.chdir(tmp_path)
        assert os.listdir() == []
        for again in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
            with closing(again):
                assert np.array_equal(again.reset(seed=1)[0], first)


@pytest.mark.parametrize("name", ["m.sumocfg", "m.net.xml", "m.net.xml.gz"])
def test_a_file_of_sumo_in_place_of_a_scenario_names_the_way(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("<net/>")
    with pytest.raises(ScenarioError, match=r"is a file of SUMO, .* drl-av scenario DIR --kind"):
        find_scenario(str(tmp_path / name))
    with pytest.raises(ScenarioError, match=r"There is no scenario"):
        find_scenario(str(tmp_path / f"other{name}"))
