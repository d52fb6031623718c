"""One episode has one hash wherever and after whatever it is driven, and resets cost no memory."""

import os
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import hash_of
from programs import python

import drl_av.simulation.start_sumo
from drl_av.config import Config
from drl_av.drivers.rule_based import IdmSumoDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.evaluation.recording import Recording, recording_of
from drl_av.scenarios.folder import ScenarioDescription, write_scenario
from drl_av.simulation.sumo_options import start_arguments

CONFIG = Config().updated("simulation", decisions_per_episode=10)
SEED, VEHICLES = 4, 30
OTHERS = 1_000
WARM = 200
"""Episodes after which every cache is full."""
PROGRAM = """
import sys
from drives import hash_of
from drl_av.evaluation.recording import load_recording
from drl_av.evaluation.replay import ReplaySession, replay_session
from test_one_hash import CONFIG, SEED, VEHICLES, IdmSumoDriver
session = ReplaySession(CONFIG, IdmSumoDriver(CONFIG.safety), "idm-sumo", SEED, VEHICLES)
print(hash_of(session.drive(sys.argv[1] if sys.argv[1:] else None)[0]))
"""


@pytest.fixture(scope="module", params=["alone", "beside another"])
def env(request: pytest.FixtureRequest) -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=CONFIG)) as other, closing(HighwayEnv(config=CONFIG)) as env:
        if request.param == "beside another":
            other.reset(seed=1)
        yield env


def driven(env: HighwayEnv) -> Recording:
    """The episode, in an environment that may have driven others."""
    decisions = list(rollout(env, IdmSumoDriver(CONFIG.safety), SEED, VEHICLES))
    return recording_of(decisions, env, "idm-sumo", SEED)


@pytest.fixture(scope="module")
def recording() -> Recording:
    """The episode, first of its SUMO."""
    with closing(HighwayEnv(config=CONFIG)) as env:
        return driven(env)


def of_a_process(*arguments: str, **environment: str) -> str:
    """The hash that a new process prints."""
    ended = python("-c", PROGRAM, *arguments, cwd=Path(__file__).parent, **environment)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.split()[-1]


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_the_hash_looks_at_every_vehicle_of_every_decision(recording: Recording) -> None:
    assert recording.states.shape == (11, 31, 4)
    for place in ((0, 0, 0), (5, 17, 1), (10, 30, 3)):
        states = recording.states.copy()
        states[place] = np.nextafter(states[place], np.inf)
        assert hash_of(replace(recording, states=states)) != hash_of(recording)


def test_the_hash_is_that_of_a_fresh_process_and_of_another(recording: Recording) -> None:
    assert of_a_process(PYTHONHASHSEED="12345") == hash_of(recording)


def test_a_thousand_other_episodes_change_no_hash_and_hold_no_memory(
    env: HighwayEnv, recording: Recording
) -> None:
    held = {}
    for number in range(1, OTHERS + 1):
        env.reset(seed=number, options={"vehicles": 30 if number % 50 == 0 else number % 4})
        env.step(number % 12)
        held[number] = resident_bytes()
    assert hash_of(driven(env)) == hash_of(recording)
    assert held[OTHERS] < 1.05 * held[WARM]


@pytest.mark.parametrize("name", ["odd lengths", "short steps", "every kind of driver"])
def test_a_crowd_that_was_taken_off_the_road_leaves_nothing_behind(
    name: str, tmp_path: Path
) -> None:
    write_scenario(tmp_path / "odd", ScenarioDescription(731.3, vehicle_length_m=4.7))
    config = {
        "odd lengths": CONFIG.updated("simulation", scenario=str(tmp_path / "odd")),
        "short steps": CONFIG.updated("simulation", step_length_s=0.1, lateral_resolution_m=0.95),
        "every kind of driver": CONFIG.updated(
            "traffic", finite_state_share=0.2, level_0_share=0.2, level_1_share=0.2
        ),
    }[name].updated("traffic", speed_gain_max=1.0, random_lane_changes_per_s=0.1)
    with closing(HighwayEnv(config=config, safety_check="permit_all")) as env:
        first, ends = hash_of(driven(env)), []
        for seed in range(10, 25):
            env.reset(seed=seed, options={"vehicles": 30})
            over = False
            while not over:
                _, _, collided, truncated, _ = env.step((seed * 7 + env.decisions * 5) % 12)
                over = collided or truncated
            ends.append(collided)
        assert any(ends)
        assert hash_of(driven(env)) == first
        assert env.scene.snapshot.time_s == env.decisions
        env.close()  # SUMO starts again
        assert hash_of(driven(env)) == first


def test_chance_that_a_user_put_into_a_scenario_is_drawn_from_the_seed(tmp_path: Path) -> None:
    write_scenario(tmp_path / "loop", ScenarioDescription())
    types = tmp_path / "loop" / "vehicle_types.add.xml"
    sober = types.read_text()
    types.write_text(sober.replace('lcKeepRight="0"', 'lcKeepRight="0" lcSigma="0.2"', 1))
    (tmp_path / "loop" / "SHA256SUMS").unlink()
    config = CONFIG.updated("simulation", scenario=str(tmp_path / "loop"))
    with closing(HighwayEnv(config=config)) as env:
        first = hash_of(driven(env))
        env.reset(seed=SEED + 1)
        assert hash_of(driven(env)) == first
    types.write_text(sober)
    with closing(HighwayEnv(config=config)) as env:
        assert hash_of(driven(env)) != first


def test_nothing_hangs_on_the_random_numbers_of_sumo(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        drl_av.simulation.start_sumo,
        "start_arguments",
        lambda files, seed, config, own: start_arguments(files, seed + 12345, config, own),
    )
    with closing(HighwayEnv(config=CONFIG)) as env:
        assert hash_of(driven(env)) == hash_of(recording)


def test_the_hash_is_the_same_in_sumo_gui(recording: Recording, screen: str) -> None:
    shown = of_a_process("human", DISPLAY=screen, LIBGL_ALWAYS_SOFTWARE="1")
    assert shown == hash_of(recording)
