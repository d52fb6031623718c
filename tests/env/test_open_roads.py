"""Episodes on open roads: they end at the end, vehicles come and go, and all repeats exactly."""

import dataclasses
import hashlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from drives import HARD_BRAKE, KEEP, LEFT, Place, hash_of, until_over
from gymnasium.utils.env_checker import check_env
from runs import Capsys

import drl_av
from drl_av.cli import main
from drl_av.config import Config, load_config
from drl_av.drawing.page import write_page
from drl_av.drawing.panels import Caption
from drl_av.drawing.picture import draw
from drl_av.drivers.registry import rule_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.env.transition import Transition
from drl_av.env.video import Film
from drl_av.errors import ConfigError, RecordingError, ScenarioError
from drl_av.evaluation.recording import load_recording
from drl_av.evaluation.replay import ReplaySession, page_episode, replay_session
from drl_av.road.snapshot import CollisionKind
from drl_av.scenarios.folder import write_scenario
from drl_av.scenarios.highways import MergeDescription, StraightDescription
from drl_av.scenarios.road_description import PlacedVehicle
from drl_av.scenarios.road_types import ROAD_TYPES

EGO = PlacedVehicle("ego", 0, 639.0, 20.0, 30.0)
STRICT = Config().updated("safety", check="strict")


def config(scenario: str) -> Config:
    return STRICT.updated("simulation", scenario=scenario)


@pytest.fixture(scope="module")
def merge() -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=config("merge"))) as env:
        yield env


def digest(env: HighwayEnv, seed: int, vehicles: int, decisions: int = 25) -> str:
    found = hashlib.sha256()
    driver = rule_driver("gap-mobil", env.config)
    for number, decision in enumerate(rollout(env, driver, seed, vehicles)):
        shot = decision.next_scene.snapshot
        found.update(repr(shot.ids).encode())
        found.update(np.stack((shot.s_m, shot.y_m, shot.speed_m_s)).tobytes())
        if number == decisions:
            break
    return found.hexdigest()


def test_an_episode_repeats_whatever_ran_before_it(merge: HighwayEnv) -> None:
    first = digest(merge, 5, 60)
    assert digest(merge, 6, 40) != first
    assert digest(merge, 5, 60) == first
    with closing(HighwayEnv(config=config("merge"))) as fresh:
        assert digest(fresh, 5, 60) == first


def test_the_gap_rule_merges_under_strict_and_its_episode_ends_at_the_end(
    merge: HighwayEnv,
) -> None:
    driver = rule_driver("gap-mobil", merge.config)
    *_, last = rollout(merge, driver, 1, 30)
    assert last.truncated
    assert not last.terminated
    assert last.next_scene.snapshot.s_m[0] >= 1250.0 > last.scene.snapshot.s_m[0]
    assert last.next_scene.affordances.lane >= 1


@pytest.mark.parametrize("seed", [830_002, 830_003, 830_004])
def test_under_paper_a_fast_ego_that_finds_no_gap_stays_on_the_road(seed: int) -> None:
    # by rule 1 alone each of the three leaves it at the end of the acceleration lane
    with closing(HighwayEnv("merge")) as env:
        assert env.config.safety.check == "paper"
        *_, last = rollout(env, rule_driver("idm-mobil", env.config), seed)
    assert last.collision is None


def test_vehicles_enter_with_new_names_and_leave(merge: HighwayEnv) -> None:
    merge.reset(seed=3, options={"vehicles": 60})
    before = merge.scene.snapshot
    for _ in range(20):
        merge.step(HARD_BRAKE)
    after = merge.scene.snapshot
    assert after.ids[0] == "ego"
    assert not set(before.ids) <= set(after.ids)
    entered = set(after.ids) - set(before.ids)
    assert entered
    assert min(int(name.removeprefix("vehicle")) for name in entered) > 60
    assert len(after.ids) == len(after.s_m) == len(after.length_m) == len(set(after.ids))
    assert after.s_m.max() < 1250.0 + 305.0 + 50.0


def test_the_flow_of_the_scenario_says_how_many_vehicles_there_are(merge: HighwayEnv) -> None:
    # 1,000 an hour at 20 m/s on 1,555 m of three lanes: 64.8
    assert merge.reset(seed=1_000_001)[1]["vehicles"] == 65
    assert merge.reset(seed=4, options={"vehicles": 7})[1]["vehicles"] == 7


@pytest.fixture
def unchecked(place: Place) -> HighwayEnv:
    """The ego alone on the acceleration lane, 111 m before its end, without a check."""
    return place(EGO, kind=MergeDescription)


def test_ego_that_drives_on_where_its_lane_ends_hits_the_edge(unchecked: HighwayEnv) -> None:
    unchecked.reset(seed=0)
    info = until_over(unchecked, KEEP)
    assert info["collision"] == CollisionKind.HIT_EDGE.value
    # 111 m at 20 m/s: in the sixth decision the front would pass 750 m
    assert unchecked.decisions == 6
    assert unchecked.scene.snapshot.s_m[0] + 2.5 == pytest.approx(749.0)


def test_ego_that_changes_in_time_drives_on(unchecked: HighwayEnv) -> None:
    unchecked.reset(seed=0)
    for _ in range(8):
        *_, info = unchecked.step(LEFT if unchecked.decisions == 0 else KEEP)
        assert not info["collision"]
    assert unchecked.scene.affordances.lane == 1
    assert unchecked.scene.snapshot.s_m[0] > 760.0


def test_ego_that_crosses_the_divider_of_the_ramp_hits_the_edge(place: Place) -> None:
    env = place(PlacedVehicle("ego", 0, 410.0, 10.0, 30.0), kind=MergeDescription)
    env.reset(seed=0)
    assert until_over(env, LEFT)["collision"] == CollisionKind.HIT_EDGE.value
    assert env.scene.snapshot.y_m[0] < 1.1


@pytest.mark.parametrize(
    ("driver", "kind", "decisions"),
    [
        *(("gap-mobil", "merge", 12), ("sumo", "merge", 12)),
        *(("idm", "exit", 24), ("sumo", "exit", 27)),
        ("gap-mobil", "ramp_to_ramp", 12),
    ],
)
def test_an_episode_is_recorded_filmed_and_repeated_exactly(
    driver: str, kind: str, decisions: int, tmp_path: Path
) -> None:
    near = {"approach_m": 500.0} if kind == "exit" else {}  # so that the ego passes the gore
    write_scenario(tmp_path / "road", ROAD_TYPES[kind](**near))
    short = config(str(tmp_path / "road")).updated("simulation", decisions_per_episode=decisions)
    session = ReplaySession(short, rule_driver(driver, short), driver, 9, 50)
    decisions_made = list[Transition]()
    film = Film(driver, session.road, session.seed)
    recording, result = session.drive(None, film.add, decisions_made.append)
    assert (result.vehicles, recording.vehicles) == (50, 50)
    assert np.isnan(recording.states).any()  # vehicles that came or went
    recording.save(tmp_path / "episode.npz")
    write_page(tmp_path / "page.html", session.road, [page_episode(session, decisions_made)])
    assert film.write(tmp_path / "film.gif", rate=20.0) == decisions
    assert kind != "exit" or recording.states[-1, 0, 0] > session.road.exit_m
    loaded = load_recording(tmp_path / "episode.npz")
    assert hash_of(replay_session(loaded).drive(None)[0]) == hash_of(recording)
    loaded.states[7, 3, 2] += 1e-12
    with pytest.raises(RecordingError, match="differs from the recording at decision 7"):
        replay_session(loaded).drive(None)


def test_picture_shows_the_acceleration_lane_only_where_it_is(merge: HighwayEnv) -> None:
    merge.reset(seed=3, options={"vehicles": 0})
    asphalt = (45, 51, 62)
    # the ego at 397.5 m: 60 m ahead lies the ramp, which begins 2.5 m behind it
    picture = draw(merge.scene.snapshot, merge.road, Caption())
    lane_0 = picture[66 + round(3.5 * 45)]
    assert tuple(lane_0[1200]) == asphalt
    assert tuple(lane_0[40]) != asphalt


@pytest.mark.parametrize(
    ("name", "way"),
    [
        ("Straight", [0.0, 1.0]),
        ("Merge", [1 / 3, 0.35]),
        ("Exit", [-1.0, 1.0]),  # three lane changes to the right of three, within 1,000 m
        ("RampToRamp", [1 / 3, 0.35]),  # one to the left, within 100 m of ramp and 250 m
    ],
)
def test_environments_have_names_and_pass_gymnasiums_check(name: str, way: list[float]) -> None:
    env = gymnasium.make(f"drl_av/{name}-v0")
    with closing(env):
        check_env(env.unwrapped, skip_render_check=True)
        observation, info = env.reset(seed=2, options={"vehicles": 30})
        assert observation[27] == 1.0  # the end of the ego's lane is out of range
        assert observation[28:] == pytest.approx(way)
        assert info["way"] == ""


def test_the_distance_to_the_end_of_the_lane_is_observed(unchecked: HighwayEnv) -> None:
    with closing(
        gymnasium.make("drl_av/Merge-v0", scenario=unchecked.config.simulation.scenario)
    ) as env:
        observation, _ = env.reset(seed=0)
        assert observation[27] == pytest.approx(111.0 / 250.0)


def test_an_inflow_of_too_many_vehicles_is_refused_with_the_inflow_that_would_do(
    tmp_path: Path,
) -> None:
    write_scenario(tmp_path / "far", StraightDescription(length_m=40_000, lanes=9, flow_per_h=1800))
    with pytest.raises(ScenarioError, match=r"flow_per_h, 1800, means 9136 .* up to 590, or a sho"):
        HighwayEnv(tmp_path / "far")
    most = StraightDescription(length_m=40_000, lanes=9, flow_per_h=590)
    write_scenario(tmp_path / "less", most)
    HighwayEnv(tmp_path / "less").close()


def test_drivers_of_our_own_are_refused_on_an_open_road() -> None:
    own = config("merge").updated("traffic", finite_state_share=0.5)
    with pytest.raises(ConfigError, match=r"must be 0 on an open road, on which SUMO drives"):
        HighwayEnv(config=own)


def test_the_default_traffic_of_an_open_road_is_calm_and_is_written_so(tmp_path: Path) -> None:
    calm = Config().with_traffic("calm").traffic
    for scenario, expected in (("merge", calm), ("barricade", Config().traffic)):
        with closing(HighwayEnv(scenario)) as env:
            assert env.config.traffic == expected
    given = {"vehicles_max": 9, "headway_min_s": 1.0}
    with closing(HighwayEnv("merge", config={"traffic": given})) as env:
        assert env.config.traffic == dataclasses.replace(calm, vehicles_max=9, headway_min_s=1.0)
    few = {
        "simulation": {"scenario": "merge", "decisions_per_episode": 2},
        "learning": {"evaluation_episodes": 1},
    }
    run = drl_av.train(tmp_path / "run", config=few, episodes=1)
    assert load_config(run / "config.toml").traffic == calm


def test_what_the_user_names_is_refused_and_not_replaced(capsys: Capsys) -> None:
    refusal = r"set them to 0, or traffic\.kind to calm, the default there, overtaking"
    for traffic in ({"level_2_share": 0.1}, {"level_0_share": 0.3}, {"kind": "all"}):
        with pytest.raises(ConfigError, match=refusal):
            HighwayEnv("merge", config={"traffic": traffic})
    with pytest.raises(ConfigError, match=refusal):
        drl_av.evaluate("idm", scenario="merge", traffic="paper")
    with pytest.raises(ConfigError, match=refusal):
        drl_av.train("nowhere", scenario="merge", traffic="paper")
    assert main(["replay", "idm", "--scenario", "merge", "--traffic", "paper"]) == 1
    assert "traffic.kind to calm, the default there" in capsys.readouterr().err
