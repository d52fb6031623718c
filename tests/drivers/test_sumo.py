"""The ego handed over to SUMO: its limits, its row, its freedom on the right, and its exactness."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from drives import hash_of

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.drivers.rule_based import TUNED, SumoDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive, rollout
from drl_av.evaluation.recording import load_recording, states_of
from drl_av.evaluation.replay import ReplaySession, replay_session
from drl_av.safety.check import Verdict
from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario
from drl_av.simulation.vehicle_calls import EgoModel

CONFIG = Config()
SEED, VEHICLES = 860_001, 15
DRIVERS = {name: rule_driver(name, CONFIG) for name in ("sumo", "sumo-tuned", "gap-mobil")}


@pytest.fixture(scope="module")
def env() -> Iterator[HighwayEnv]:
    with HighwayEnv(config=CONFIG) as made:
        yield made


@pytest.mark.parametrize("name", ["sumo", "sumo-tuned"])
@pytest.mark.parametrize("vehicles", [5, 15, 30])
def test_sumo_keeps_to_the_limits_of_the_ego_s_actions(
    name: str, vehicles: int, env: HighwayEnv
) -> None:
    decisions = list(rollout(env, DRIVERS[name], SEED, vehicles))
    shots = [decisions[0].scene.snapshot, *(d.next_scene.snapshot for d in decisions)]
    speed = np.array([shot.speed_m_s[0] for shot in shots])
    aside_m = np.abs(np.diff([shot.y_m[0] for shot in shots]))
    assert len(decisions) == 200
    assert speed.max() <= 30.0 + 1e-9
    assert np.diff(speed).max() <= 2.0 + 1e-9
    assert np.diff(speed).min() >= -4.0 - 1e-9
    assert aside_m.max() <= 0.76 + 1e-9


def test_it_starts_where_every_other_driver_starts_and_its_row_tells_what_it_did(
    env: HighwayEnv,
) -> None:
    starts = [
        states_of(next(rollout(env, driver, SEED, VEHICLES)).scene.snapshot)
        for driver in DRIVERS.values()
    ]
    rows = {name: drive(env, driver, name, SEED, VEHICLES) for name, driver in DRIVERS.items()}
    assert np.array_equal(starts[0], starts[1])
    assert np.array_equal(starts[0], starts[2])
    assert [rows[name].safety_check for name in DRIVERS] == ["none", "none", "paper"]
    tuned = rows["sumo-tuned"]
    assert tuned.safety_triggers == 0
    assert tuned.lane_changes > 0
    assert 0.5 < tuned.min_headway_s < 5.0
    assert tuned.mean_speed_m_s > rows["sumo"].mean_speed_m_s


def test_no_check_is_asked_while_sumo_drives() -> None:
    def never(scene: object, proposed: object) -> Verdict:
        raise AssertionError("the check must not be asked")

    with closing(HighwayEnv(safety_check=never)) as env:
        env.reset(seed=SEED, options={"vehicles": VEHICLES})
        env.hand_over(EgoModel())
        assert env.step(0)[-1]["rule"] == "none"


def test_lane_changes_of_its_row_are_those_of_its_lanes(env: HighwayEnv) -> None:
    decisions = list(rollout(env, DRIVERS["sumo-tuned"], SEED, VEHICLES))
    lanes = [d.next_scene.affordances.lane for d in decisions if d.next_scene.lane_change is None]
    changes = int(np.count_nonzero(np.diff([decisions[0].scene.affordances.lane, *lanes])))
    row = drive(env, DRIVERS["sumo-tuned"], "sumo-tuned", SEED, VEHICLES)
    assert row.lane_changes == changes > 0
    for decision in decisions:
        snapshot = decision.next_scene.snapshot
        if decision.next_scene.lane_change is None:
            off_m = abs(float(snapshot.y_m[0]) - decision.next_scene.affordances.lane_center_m)
            assert off_m <= 0.05
        assert not decision.triggered


def test_an_episode_of_sumo_is_the_same_whatever_was_driven_before(env: HighwayEnv) -> None:
    first = drive(env, DRIVERS["sumo-tuned"], "a", SEED, VEHICLES)
    for seed in (SEED, SEED + 1):
        for name, driver in DRIVERS.items():
            drive(env, driver, name, seed, VEHICLES)
    assert drive(env, DRIVERS["sumo-tuned"], "a", SEED, VEHICLES) == first
    with HighwayEnv(config=CONFIG) as other:
        assert drive(other, DRIVERS["sumo-tuned"], "a", SEED, VEHICLES) == first


def test_after_sumo_the_ego_obeys_its_actions_again(env: HighwayEnv) -> None:
    alone = drive(env, DRIVERS["gap-mobil"], "gap-mobil", SEED, VEHICLES)
    drive(env, DRIVERS["sumo-tuned"], "sumo-tuned", SEED, VEHICLES)
    assert drive(env, DRIVERS["gap-mobil"], "gap-mobil", SEED, VEHICLES) == alone


@pytest.mark.parametrize("overtake_right", [False, True])
def test_on_the_right_it_passes_only_where_its_model_may(
    overtake_right: bool, tmp_path: Path
) -> None:
    # 60 m behind a vehicle of 22 m/s on the leftmost lane, itself on the centre lane
    ego, slow = PlacedVehicle("ego", 1, 100.0, 25.0, 30.0), PlacedVehicle("slow", 2, 165, 22, 22)
    write_scenario(tmp_path / "s", ScenarioDescription(2000.0, vehicles=(ego, slow)))
    config = CONFIG.updated("traffic", random_lane_changes_per_s=0.0)
    with HighwayEnv(tmp_path / "s", config=config) as env:
        model = EgoModel(speed_gain=0.0, overtake_right=overtake_right)
        drive(env, SumoDriver(model), "sumo", 1, 1)
        shot = env.scene.snapshot
        ahead_m = float(env.road.ahead_m(shot.s_m[1], shot.s_m[0]))
    if overtake_right:
        assert shot.speed_m_s[0] == pytest.approx(30.0, abs=0.01)
    else:
        assert -80 < ahead_m < 0
        assert shot.speed_m_s[0] == pytest.approx(22.0, abs=0.01)


def test_a_recorded_episode_of_sumo_is_replayed_exactly(tmp_path: Path) -> None:
    session = ReplaySession(CONFIG, SumoDriver(TUNED), "sumo-tuned", SEED, VEHICLES)
    recording, row = session.drive(None)
    recording.save(tmp_path / "episode.npz")
    found = load_recording(tmp_path / "episode.npz")
    assert found.ego_model == TUNED
    again, same = replay_session(found).drive("rgb_array")
    assert hash_of(again) == hash_of(recording)
    assert same == row


def test_an_ego_is_handed_over_within_an_episode_only() -> None:
    with HighwayEnv(config=CONFIG) as made:
        with pytest.raises(gymnasium.error.ResetNeeded, match="no episode to hand over"):
            made.hand_over(TUNED)
        made.reset(seed=1, options={"vehicles": 1})
        made.hand_over(TUNED)
        made.reset(seed=1, options={"vehicles": 1})
        assert made.ego_model is None
