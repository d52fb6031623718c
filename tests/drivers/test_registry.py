"""Drivers by name: rules, runs and policy files, and a driver that a program adds."""

import os
from pathlib import Path

import numpy as np
import pytest
from runs import SHORT, Capsys, run_folder
from worlds import ALONE

import drl_av
from drl_av.cli import main
from drl_av.config import Config, load_config
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import PRETRAINED, SHIPPED, save_policy
from drl_av.drivers.registry import (
    RULE_DRIVERS,
    DriverSpec,
    baselines,
    default_config,
    find_drivers,
    make_drivers,
)
from drl_av.env.observation import GROUPS
from drl_av.errors import CheckpointError, RunError

KEEP, LEFT, BRAKE = 0, 8, 2


def test_a_driver_of_another_program_is_one_line_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setitem(RULE_DRIVERS, "cautious", lambda config: PolicyDriver(lambda o: BRAKE))
    settings, out = tmp_path / "short.toml", tmp_path / "rows.csv"
    settings.write_text("[simulation]\ndecisions_per_episode = 10\n")
    words = ["evaluate", "--driver", "cautious", "idm", "--vehicles", "0", "--episodes", "1"]
    assert main([*words, "--config", str(settings), "--out", str(out)]) == 0
    header, cautious, idm = (line.split(",") for line in out.read_text().splitlines())
    speed = header.index("mean_speed_m_s")
    assert (cautious[0], idm[0]) == ("cautious", "idm")
    assert float(cautious[speed]) < float(idm[speed])
    for verb in ("evaluate", "replay"):
        with pytest.raises(SystemExit):
            main([verb, "--help"])
        assert "cautious" in capsys.readouterr().out
    assert main(["evaluate", "cautius"]) == 1
    assert "did you mean 'cautious'?" in " ".join(capsys.readouterr().err.split())


def test_learned_drivers_are_no_baselines() -> None:
    names = ["mine", "sumo", "pretrained", "idm", "sumo"]
    assert baselines(names) == ["sumo", "idm"]


def test_runs_of_one_name_are_distinguished_and_drivers_mix(tmp_path: Path) -> None:
    a, b, c = (run_folder(tmp_path / name) for name in ("a/run", "b/run", "other"))
    specs = find_drivers([str(a), "idm", str(b), str(c), "idm", "random"])
    runs = [(str(a), a), ("idm", None), (str(b), b), ("other", c), ("random", None)]
    assert [*specs] == [DriverSpec(*run) for run in runs]
    made = make_drivers(specs, default_config(specs))
    assert [*made] == [str(a), "idm", str(b), "other", "random"]
    assert find_drivers(["pretrained"]) == (DriverSpec("pretrained", PRETRAINED),)


def test_a_run_with_the_name_of_a_driver_keeps_its_path(tmp_path: Path) -> None:
    runs = [run_folder(tmp_path / name) for name in ("sumo", "pretrained")]
    specs = find_drivers([*map(str, runs), "sumo"])
    assert [spec.name for spec in specs] == [*map(str, runs), "sumo"]
    assert baselines(spec.name for spec in specs) == ["sumo"]
    planner = run_folder(tmp_path / "planner")
    words = [f"{runs[0]}@strict", f"{planner}@paper"]
    specs = find_drivers(words)
    assert [spec.name for spec in specs] == words
    assert not baselines(spec.name for spec in specs)
    assert not any(spec.is_planner for spec in specs)


@pytest.mark.parametrize(
    ("driver", "check"), [("pretrained", "strict"), ("pretrained-paper", "paper")]
)
def test_a_driver_drives_under_the_check_of_its_training(driver: str, check: str) -> None:
    assert load_config(SHIPPED[driver] / "config.toml").safety.check == check
    config = default_config(find_drivers([driver, "idm"]))
    assert (config.safety.check, config.simulation.world) == (check, "sumo")
    options = {"vehicles": 3, "episodes": 1, "seed": 800_000}
    short = {"simulation": {"decisions_per_episode": 2}}
    [row] = drl_av.evaluate(driver, config=short, **options)
    assert row.safety_check == check
    [row] = drl_av.evaluate(driver, config=short, safety_check="paper", **options)
    assert row.safety_check == "paper"


def test_where_strict_is_refused_the_shipped_driver_names_the_way_out(
    tmp_path: Path, capsys: Capsys
) -> None:
    words = ["evaluate", "pretrained", "--vehicles", "3", "--episodes", "1", "--config"]
    for settings in ("ego]\nlateral_plant = 'steering'", "traffic]\nacceleration_max_m_s2 = 2.5"):
        file = tmp_path / "own.toml"
        file.write_text(f"[{settings}\n[simulation]\ndecisions_per_episode = 2\n")
        assert main([*words, str(file)]) == 1
        said = " ".join(capsys.readouterr().err.split())
        assert said.endswith("take the check paper (--safety-check paper).") or said.endswith(
            "take that, or the check paper (--safety-check paper)."
        )
        assert main([*words, str(file), "--safety-check", "paper"]) == 0


def test_config_is_that_of_the_first_run(tmp_path: Path) -> None:
    run = run_folder(tmp_path / "run", SHORT.updated("safety", check="permit_all"))
    assert default_config(find_drivers(["idm", str(run)])).safety.check == "permit_all"
    assert default_config(find_drivers(["idm"])) == Config()


def test_a_run_drives_in_the_mirror_of_its_training_whatever_the_config_has(tmp_path: Path) -> None:
    network = QNetwork(np.random.default_rng(0))
    network.flat[:] = 0
    network.flat[-12:] = -1.0
    network.flat[-12 + KEEP], network.flat[-12 + LEFT] = 0.0, 0.5
    # in the mirror: 0 for keeping the lane, and the mean of 0.5 and -1, -0.25, for either side
    specs = []
    for mirrored in (True, False):
        path = tmp_path / f"{mirrored}.safetensors"
        save_policy(path, network, SHORT.updated("learning", mirrored=mirrored))
        specs += find_drivers([str(path)])

    def decided(config: Config) -> list[int]:
        drivers = make_drivers(specs, config).values()
        return [driver.act(ALONE, np.zeros(27, np.float32)).number for driver in drivers]

    base = default_config(specs)
    assert base.learning.mirrored
    assert decided(base.updated("reward", collision_reward=-1.0)) == [KEEP, LEFT]
    assert decided(base.updated("learning", mirrored=False)) == [KEEP, LEFT]


@pytest.mark.parametrize(
    ("section", "change"), [("observation", {"range_m": 100.0}), ("ego", {"max_speed_m_s": 25.0})]
)
def test_run_that_sees_the_road_otherwise_is_refused(
    section: str, change: dict[str, float], tmp_path: Path
) -> None:
    specs = find_drivers([str(run_folder(tmp_path / "run"))])
    with pytest.raises(RunError, match="was trained with other"):
        make_drivers(specs, SHORT.updated(section, **change))


def test_a_run_is_not_fed_another_observation_of_as_many_numbers() -> None:
    groups = tuple(GROUPS)[6::-1]
    with pytest.raises(RunError, match="pretrained-paper observes the indicators alone: drive it"):
        drl_av.evaluate("pretrained-paper", vehicles=[2], episodes=1, observation=groups)
    usual = tuple(GROUPS)[:7]
    drl_av.evaluate("pretrained-paper", vehicles=[2], episodes=1, observation=usual)


def test_folder_without_a_policy_and_damaged_policy_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match="holds no trained driver"):
        default_config(find_drivers([str(tmp_path / "empty")]))
    run = run_folder(tmp_path / "cut")
    os.truncate(run / "policy.safetensors", 1000)
    with pytest.raises(CheckpointError, match="cut short"):
        default_config(find_drivers([str(run)]))


def test_the_best_models_of_two_trainings_have_the_names_of_their_folders(here: Path) -> None:
    for folder in ("one", "two"):
        Path(folder).mkdir()
        for name in ("best_model.zip", "last.zip"):
            Path(folder, name).touch()
    words = ["one/best_model.zip", "two/best_model.zip@paper", "one/last.zip"]
    for order in (words, words[:1], words[::-1]):  # whatever drives beside it
        names = dict(zip(order, (spec.name for spec in find_drivers(order)), strict=True))
        assert names["one/best_model.zip"] == "one/best_model.zip"
        assert names.get("one/last.zip", "last.zip") == "last.zip"
        assert names.get(words[1], words[1]) == "two/best_model.zip@paper"
