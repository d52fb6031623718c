"""Episodes on a motorway from OpenStreetMap, and on roads whose lanes end on both sides."""

from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from drives import HARD_BRAKE, KEEP, LEFT, RIGHT, hash_of, printed_by_a_fresh_process, until_over
from gymnasium.utils.env_checker import check_env
from nets import Part, along, chain, east

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.evaluation.replay import ReplaySession
from drl_av.road.snapshot import CollisionKind
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.road_description import PlacedVehicle

STRICT = Config().updated("safety", check="strict")
NARROW = (Part(5), Part(3), Part(4))
NARROW_WAYS = ("e0 1 e1 0", "e0 2 e1 1", "e0 3 e1 2", "e1 0 e2 0", "e1 1 e2 1", "e1 2 e2 2")
"""Of five lanes the two outer ones end; later one begins on the left."""


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folders of the A 10 and of a road that narrows on both sides."""
    home = tmp_path_factory.mktemp("roads")
    write_scenario(home / "a10", east())
    narrow = chain(home, *NARROW, ways=NARROW_WAYS)
    write_scenario(home / "narrow", along(narrow, 2, flow_per_h=1400.0))
    return home


def config(folder: Path) -> Config:
    return STRICT.updated("simulation", scenario=str(folder))


@pytest.fixture(scope="module")
def motorway(roads: Path) -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=config(roads / "a10"))) as env:
        yield env


def test_an_imported_road_is_an_environment_by_its_folder(roads: Path) -> None:
    with closing(gymnasium.make("drl_av/Highway-v0", scenario=roads / "a10")) as env:
        check_env(env.unwrapped, skip_render_check=True)
        observation, info = env.reset(seed=2)
        assert observation.shape == (27,)
        # 1,000 an hour at 20 m/s on 3,016 m of three lanes, as on each open road
        assert info["vehicles"] == 128
        assert info["way"] == ""


def test_the_gap_rule_drives_the_motorway_to_its_end_under_strict(motorway: HighwayEnv) -> None:
    driver = rule_driver("gap-mobil", motorway.config)
    driven = [*rollout(motorway, driver, 1, 90)]
    last = driven[-1]
    assert last.truncated
    assert not last.terminated
    assert last.next_scene.snapshot.s_m[0] >= 2766.48 > last.scene.snapshot.s_m[0]
    # along the curves, over junctions, no position jumps
    places = [float(decision.next_scene.snapshot.s_m[0]) for decision in driven]
    assert max(after - before for before, after in pairwise(places)) <= 30.0 + 1e-6
    aside = [float(decision.next_scene.snapshot.y_m[0]) for decision in driven]
    assert max(abs(after - before) for before, after in pairwise(aside)) < 0.65  # 3.2 m in 5 s


def test_the_traffic_crosses_junctions_without_a_jump(motorway: HighwayEnv) -> None:
    motorway.reset(seed=5)
    for _ in range(25):
        before = motorway.scene.snapshot
        motorway.step(KEEP)
        after = motorway.scene.snapshot
        for name in set(before.ids) & set(after.ids):
            old, new = before.ids.index(name), after.ids.index(name)
            step_m = after.s_m[new] - before.s_m[old]
            faster_m_s = max(before.speed_m_s[old], after.speed_m_s[new])
            assert -0.1 < step_m <= faster_m_s + 1.5, name
            assert abs(after.y_m[new] - before.y_m[old]) < 0.8, name


def test_traffic_obeys_the_limit_of_each_edge_and_wants_to_be_faster(tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2, 40.0), Part(2, 22.0), Part(2, 40.0))
    write_scenario(tmp_path / "road", along(net, 2, flow_per_h=600.0))
    slow = Config().updated("ego", max_speed_m_s=22.0)
    seen: list[list[float]] = [[], [], []]
    with closing(HighwayEnv(tmp_path / "road", config=slow)) as env:
        cuts = [part.end_m for part in env.simulation.scenario.description.route.sections]
        assert env.reset(seed=3)[0].shape == (27,)
        shot = env.scene.snapshot
        in_between = (shot.s_m + 2.5 >= cuts[0]) & (shot.s_m + 2.5 < cuts[1])
        assert shot.speed_m_s[in_between].max() <= 22.0 < shot.speed_m_s[~in_between].max()
        for _ in range(40):
            env.step(KEEP)
            shot = env.scene.snapshot
            if shot.time_s > 5.0:  # vehicles that start just before the limit brake for it
                for s_m, speed in zip(shot.s_m[1:], shot.speed_m_s[1:], strict=True):
                    front = int(np.searchsorted(cuts, s_m + 2.5))
                    seen[min(front, 2)].append(float(speed))
    assert max(seen[1]) <= 22.0 + 1e-6
    assert max(seen[0]) > 26.0
    assert max(seen[2]) > 26.0


def test_ego_in_the_lane_of_an_exit_hits_its_end_and_strict_stops_it(tmp_path: Path) -> None:
    ego = PlacedVehicle("ego", 0, 1220.0, 20.0, 30.0)
    write_scenario(tmp_path / "placed", east(vehicles=(ego,)))
    with closing(HighwayEnv(tmp_path / "placed", safety_check="permit_all")) as env:
        env.reset(seed=0)
        assert env.scene.affordances.mandatory == (1, pytest.approx(123.66))
        assert until_over(env, KEEP)["collision"] == CollisionKind.HIT_EDGE.value
        # 123.66 m at 20 m/s: in the seventh decision the front would pass 1,343.66 m
        assert env.decisions == 7
    with closing(HighwayEnv(tmp_path / "placed", safety_check="strict")) as env:
        env.reset(seed=0)
        for _ in range(20):
            assert not env.step(KEEP)[4]["collision"]
        assert 1300.0 < env.scene.snapshot.s_m[0] < 1343.66 - 2.5
        assert env.scene.affordances.ego_speed_m_s == 0.0


def test_ego_leaves_a_lane_that_ends_on_the_left(roads: Path, tmp_path: Path) -> None:
    own = along(roads / "own.net.xml", 2, vehicles=(PlacedVehicle("ego", 4, 300.0, 20.0, 30.0),))
    write_scenario(tmp_path / "placed", own)
    end_m = own.route.sections[0].end_m
    for action, collides in ((KEEP, True), (LEFT, True), (RIGHT, False)):
        with closing(HighwayEnv(tmp_path / "placed", safety_check="permit_all")) as env:
            env.reset(seed=0)
            assert env.scene.affordances.mandatory == (-1, pytest.approx(end_m - 300.0))
            info = env.step(action)[4]
            while env.decisions < 12 and not info["collision"]:
                *_, info = env.step(KEEP)
            assert bool(info["collision"]) is collides
            assert (env.scene.snapshot.s_m[0] > end_m) is not collides


PROGRAM = """
from drives import hash_of
from drl_av.config import Config; from drl_av.drivers.registry import rule_driver
from drl_av.evaluation.replay import ReplaySession
config = Config().updated('safety', check='strict').updated('simulation', scenario={folder!r})
config = config.updated('simulation', decisions_per_episode=15)
session = ReplaySession(config, rule_driver('gap-mobil', config), 'gap-mobil', 4, 70)
print(hash_of(session.drive(None)[0]))
"""


def test_the_hash_is_that_of_a_fresh_process_whatever_ran_before(motorway: HighwayEnv) -> None:
    folder = motorway.config.simulation.scenario
    short = motorway.config.updated("simulation", decisions_per_episode=15)
    session = ReplaySession(short, rule_driver("gap-mobil", short), "gap-mobil", 4, 70)
    motorway.reset(seed=77)
    motorway.step(HARD_BRAKE)
    program = PROGRAM.strip().replace("\n", "; ").format(folder=folder)
    assert printed_by_a_fresh_process(program) == [hash_of(session.drive(None)[0])]


def test_under_strict_an_ego_that_changes_lanes_at_random_hits_nothing(roads: Path) -> None:
    rng, ended, partial = np.random.default_rng(1), 0, set()
    short = config(roads / "narrow").updated("simulation", decisions_per_episode=60)
    with closing(HighwayEnv(config=short)) as env:
        for seed in range(15):
            env.reset(seed=seed)
            over = False
            while not over:  # fast, and now and then to a side
                action = int(rng.choice([1, 5, 9, 4, 8], p=[0.5, 0.15, 0.15, 0.1, 0.1]))
                _, _, terminated, truncated, info = env.step(action)
                assert info["collision"] == "", (seed, env.decisions)
                partial |= {lane for lane in [env.scene.affordances.lane] if lane in (0, 4)}
                over = terminated or truncated
            ended += bool(env.scene.snapshot.s_m[0] >= env.road.end_m)
    assert partial == {0, 4}  # it was in the lanes that end
    assert ended
