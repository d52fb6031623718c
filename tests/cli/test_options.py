"""What the options of several verbs have in common."""

from pathlib import Path

import pytest
from runs import Capsys, error_message

from drl_av.cli import main
from drl_av.cli.options import SETTINGS_OF_OPTIONS
from drl_av.config import Config
from drl_av.scenarios.folder import with_scenario

VALUES = {"traffic": "calm", "world": "sumo", "safety_check": "strict", "scenario": "merge"}


@pytest.mark.parametrize("option", VALUES)
def test_a_setting_is_not_given_twice(option: str, capsys: Capsys) -> None:
    setting, flag = SETTINGS_OF_OPTIONS[option], f"--{option.replace('_', '-')}"
    words = ["evaluate", "idm", "--episodes", "1", flag, VALUES[option]]
    assert main([*words, "-o", f"{setting}={VALUES[option]}"]) == 1
    assert f"{flag} and -o {setting} are the same setting" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "setting"),
    [
        (["train", "--episodes", "2"], "learning.episodes=3"),
        (["train", "--seed", "3"], "learning.seed=7"),
        (["train", "--seeds", "1-2"], "learning.seed=7"),
        (["train", "--replay", "uniform"], "learning.replay=prioritized"),
        (["adapt", "pretrained-paper", "--learning-rate", "0.1"], "learning.learning_rate=0.2"),
        (["replay", "idm", "--decisions", "5"], "simulation.decisions_per_episode=3"),
    ],
)
def test_nor_is_one_of_a_verb(words: list[str], setting: str, here: Path, capsys: Capsys) -> None:
    out = [] if words[0] == "replay" else ["--out", "run"]
    assert main([*words, *out, "-o", setting]) == 1
    said = rf"{words[-2]} and -o {setting.partition('=')[0]} are the same setting"
    assert said in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_the_numbers_of_vehicles_of_a_training_are_none_of_an_evaluation(capsys: Capsys) -> None:
    for verb in ("evaluate", "replay"):
        assert main([verb, "idm", "-o", "traffic.vehicles_max=10"]) == 1
        assert "=10 is a setting of trainings: give the numbers here with" in error_message(capsys)


def test_a_table_takes_drivers_whose_trainings_had_other_numbers_of_vehicles(here: Path) -> None:
    (here / "few.toml").write_text("[traffic]\nvehicles_max = 8\n")
    words = ["evaluate", "--vehicles", "9", "--episodes", "1", "--out", "t.csv"]
    words += ["-o", "simulation.decisions_per_episode=2"]
    assert main([*words, "--driver", "idm", "--config", "few.toml"]) == 0
    assert main([*words, "--driver", "random"]) == 0
    assert len((here / "t.csv").read_text().splitlines()) == 3


def test_a_scenario_is_the_same_however_its_path_is_written(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["scenario", "mine"]) == 0
    found = {with_scenario(Config(), word) for word in ("mine", "./mine/", str(here / "mine"))}
    (here / "other").mkdir()
    found.add(with_scenario(Config(), "other/../mine"))
    monkeypatch.chdir("other")
    found.add(with_scenario(Config(), Path("../mine")))
    assert [each.simulation.scenario for each in found] == [str(here / "mine")]
    monkeypatch.chdir(here)
    Path("deep/a").mkdir(parents=True)
    Path("link").symlink_to("deep/a")
    assert main(["scenario", "deep/mine"]) == 0
    behind = with_scenario(Config(), "link/../mine").simulation.scenario
    assert behind == str(here / "deep" / "mine")


def test_a_folder_with_the_name_of_a_shipped_scenario_is_not_passed_over_in_silence(
    here: Path, capsys: Capsys
) -> None:
    assert main(["scenario", "merge", "--kind", "merge", "--flow-per-h", "100"]) == 0
    short = ["replay", "idm", "--decisions", "1", "--record"]
    for name, told, vehicles in (("merge", True, 65), ("./merge", False, 6)):
        capsys.readouterr()
        assert main([*short, f"{vehicles}.npz", "--scenario", name]) == 0
        said = capsys.readouterr()
        assert f", {vehicles} vehicles," in said.out
        assert said.err.count("write ./merge for the folder here") == told
    assert main(["replay", "pretrained-merge", *short[2:], "learned.npz"]) == 0  # names none
    assert "write ./merge" not in capsys.readouterr().err


def test_a_file_of_a_scenario_is_not_taken_for_a_network(here: Path, capsys: Capsys) -> None:
    assert main(["scenario", "mine"]) == 0
    assert main(["evaluate", "idm", "--scenario", "mine/highway.net.xml"]) == 1
    assert f"name its folder, {here / 'mine'}" in capsys.readouterr().err
