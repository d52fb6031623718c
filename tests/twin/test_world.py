"""``simulation.world = "twin"``: the environment, trainings and evaluations without SUMO."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from drives import hash_of
from nets import A10, EAST
from programs import python
from runs import Capsys, replace_in

import drl_av
from drl_av.cli import main
from drl_av.config import Config, load_config
from drl_av.drivers.registry import load_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import ConfigError, DrlAvError
from drl_av.evaluation.criterion import judge
from drl_av.evaluation.replay import ReplaySession, replay_session
from drl_av.learning.algorithm_1 import Training, build_training

TWIN = Config().updated("simulation", world="twin")
SHORT = {"decisions_per_episode": 40}


def trained(world: str) -> Training:
    """A training of four episodes among few vehicles, which learns from its first hits on."""
    config = (
        Config()
        .updated("simulation", world=world, **SHORT)
        .updated("traffic", vehicles_min=0, vehicles_max=6)
        .updated("learning", episodes=4, collisions_to_start=1)
    )
    with closing(HighwayEnv(config=config)) as env:
        training = build_training(env)
        for _ in range(4):
            training.run_episode()
    return training


def test_algorithm_1_has_the_same_experience_in_both_worlds() -> None:
    in_sumo, in_twin = trained("sumo").state()[0], trained("twin").state()[0]
    for name in ("buffer.safe.rows", "buffer.collision.rows"):
        assert in_twin[name].shape == in_sumo[name].shape
        assert np.abs(in_twin[name] - in_sumo[name]).max() < 1e-6
    assert len(in_twin["buffer.safe.rows"]) > 100
    assert len(in_twin["buffer.collision.rows"]) > 20
    assert np.abs(in_twin["learner.online"] - in_sumo["learner.online"]).max() < 1e-4


def test_a_run_says_in_which_world_it_learned_and_is_evaluated_in_sumo_unless_told(
    tmp_path: Path, capsys: Capsys
) -> None:
    run, table, other = tmp_path / "run", tmp_path / "twin.csv", tmp_path / "sumo.csv"
    settings = ["-o", "simulation.decisions_per_episode=20"]
    words = ["train", "--world", "twin", "--episodes", "2", "--out", str(run), *settings]
    assert main(words) == 0
    assert load_config(run / "config.toml").simulation.world == "twin"
    assert main(["train", "--resume", "--out", str(run)]) == 0
    job = ["evaluate", str(run), "idm", "--vehicles", "3", "--episodes", "1", "--out"]
    assert main([*job, str(other)]) == 0
    assert "the twin" not in capsys.readouterr().out
    assert "world" not in other.read_text()
    assert main([*job, str(table), "--world", "twin"]) == 0
    assert "Driven in the twin, not in SUMO." in capsys.readouterr().out
    rows = table.read_text().splitlines()
    assert [row.rpartition(",")[2] for row in rows] == ["world", "twin", "twin"]
    recorded = [str(tmp_path / "recorded.csv"), "--record", str(tmp_path / "recordings")]
    assert main([*job, *recorded, "--world", "twin"]) == 0
    assert "Driven in the twin, not in SUMO." in capsys.readouterr().out
    assert Path(recorded[0]).read_bytes() == table.read_bytes()
    assert main([*job, str(table)]) == 1
    assert "was made with other settings" in capsys.readouterr().err


def test_rows_of_both_worlds_are_not_compared() -> None:
    job = {"vehicles": 2, "episodes": 2, "config": {"simulation": SHORT}}
    there = {"simulation": {"world": "twin", **SHORT}}
    sumo = drl_av.evaluate(["pretrained", "idm"], **job)  # type: ignore[arg-type]
    twin = drl_av.evaluate(["pretrained", "idm"], **(job | {"config": there}))  # type: ignore[arg-type]
    assert [row.world for row in (*sumo, *twin)] == ["sumo"] * 4 + ["twin"] * 4
    assert judge(twin)[0].over == "idm"
    with pytest.raises(DrlAvError, match="one world at a time"):
        judge([*sumo, *(row for row in twin if row.driver == "idm")])


def test_a_recording_of_the_twin_is_replayed_to_the_bit() -> None:
    config = TWIN.updated("simulation", **SHORT)
    session = ReplaySession(config, load_driver("gap-mobil"), "gap-mobil", 3, 20)
    recording, result = session.drive(None)
    assert (result.decisions, result.world) == (40, "twin")
    again, _ = replay_session(recording).drive(None)
    assert hash_of(again) == hash_of(recording)


def test_nothing_starts_or_imports_sumo() -> None:
    program = """
import sys
from drl_av.drivers.registry import load_driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
env = HighwayEnv(config={"simulation": {"world": "twin", "decisions_per_episode": 5}})
print(drive(env, load_driver("pretrained"), "pretrained", 1, 10).decisions)
print([name for name in ("libsumo", "traci") if name in sys.modules])
"""
    assert python("-c", program).stdout.split() == ["5", "[]"]


def test_each_step_is_shown_as_in_sumo() -> None:
    with closing(HighwayEnv(config=TWIN)) as env:
        times: list[float] = []
        env.reset(seed=1, options={"vehicles": 3})
        env.simulation.after_step = lambda shot: times.append(shot.time_s)
        env.step(0)
        env.step(0)
        assert times == [0.5, 1.0, 1.5, 2.0]
        assert env.scene.snapshot.time_s == 2.0


@pytest.mark.parametrize("driver", ["sumo", "sumo-tuned", "idm-sumo"])
def test_drivers_of_sumo_are_refused(driver: str) -> None:
    with pytest.raises(ConfigError, match="evaluate them in SUMO"):
        drl_av.evaluate(driver, vehicles=2, episodes=1, config={"simulation": {"world": "twin"}})
    with closing(HighwayEnv(config=TWIN)) as env:
        env.reset(seed=1, options={"vehicles": 3})
        with pytest.raises(ConfigError, match="SUMO does not drive the ego of the twin"):
            [*rollout(env, load_driver("sumo"), 1, 2)]


def test_what_the_twin_cannot_do_is_refused(tmp_path: Path, capsys: Capsys) -> None:
    folder = tmp_path / "a10"
    way = ["--net", str(A10), "--from-edge", EAST[0], "--to-edge", EAST[1]]
    assert main(["scenario", str(folder), "--kind", "imported", *way]) == 0
    with pytest.raises(ConfigError, match=r"The twin does not know imported roads.*drive in SUMO"):
        HighwayEnv(folder, config=TWIN)
    narrow = tmp_path / "narrow"
    assert main(["scenario", str(narrow), "--lane-width-m", "3"]) == 0  # cars are 1.8 m wide
    with pytest.raises(ConfigError, match=r"lanes at most 1\.2 m wider than their widest veh"):
        HighwayEnv(narrow, config=TWIN)
    edited = tmp_path / "edited"
    assert main(["scenario", str(edited)]) == 0
    (edited / "SHA256SUMS").unlink()
    replace_in(edited / "vehicle_types.add.xml", 'decel="4', 'decel="4.4')
    with pytest.raises(ConfigError, match=r"know changes of vehicle_types\.add\.xml other than"):
        HighwayEnv(edited, config=TWIN)
    for given in ({"render_mode": "human"}, {"sumo_options": "--fcd-output fcd.xml"}):
        told = r"neither sumo-gui nor options and outputs of SUMO: drive in SUMO .*--video"
        with pytest.raises(ConfigError, match=told):
            HighwayEnv(config=TWIN, **given)  # type: ignore[arg-type]
    assert HighwayEnv(config=TWIN, render_mode="rgb_array").reset(seed=1)
    large = ["train", "--preset", "large", "--world", "sumo", "--out", str(tmp_path / "run")]
    assert main(large) == 1
    assert "PPO at scale trains in the twin" in capsys.readouterr().err
    large[-3:-2] = ["twin", "--scenario", "merge", "--traffic", "calm"]
    assert main(large) == 1
    assert "set observation.way = true, as the preset" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
