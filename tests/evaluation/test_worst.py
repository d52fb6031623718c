"""The worst episodes of a table are driven again, exactly, and drawn on one sheet."""

from pathlib import Path
from zipfile import ZipFile

import pytest
from PIL import Image
from runs import Capsys, error_message, replace_in, run_folder
from stable_baselines3 import PPO

from drl_av.cli import main
from drl_av.config import Config
from drl_av.env.custom import NOTHING_CUSTOM
from drl_av.env.highway import HighwayEnv
from drl_av.evaluation.recording import load_recording
from drl_av.evaluation.replay import worst_sessions
from drl_av.evaluation.table import read_rows
from drl_av.files.table import write_table


@pytest.fixture
def table(here: Path) -> list[dict[str, str]]:
    """The rows of ``rows.csv``, in which the drivers have checks of their own."""
    words = ["evaluate", "pretrained", "pretrained-paper@paper", "random", "--vehicles", "20"]
    words += ["--episodes", "2", "-o", "simulation.decisions_per_episode=25", "--out", "rows.csv"]
    assert main(words) == 0
    return rows()


def evaluate(*drivers: str) -> list[str]:
    """The words of an evaluation of ten decisions among nine vehicles."""
    words = ["evaluate", *drivers, "--vehicles", "9", "--out", "rows.csv"]
    return [*words, "-o", "simulation.decisions_per_episode=10"]


def rows() -> list[dict[str, str]]:
    return read_rows(Path("rows.csv"))


def test_the_worst_row_is_driven_again(table: list[dict[str, str]], capsys: Capsys) -> None:
    nearest = min(table, key=lambda row: float(row["min_ttc_s"]))
    busiest = max(table, key=lambda row: int(row["safety_triggers"]))
    slowest = min(table, key=lambda row: float(row["mean_speed_m_s"]))
    wanted = {"min_ttc_s": nearest, "safety_triggers": busiest, "mean_speed_m_s": slowest}
    assert len({(row["driver"], row["seed"]) for row in wanted.values()}) > 1
    for column, row in wanted.items():
        assert main(["replay", "rows.csv", "--worst", column, "--record", "worst.npz"]) == 0
        told = f"{row['driver']}, check {row['safety_check']}, 20 vehicles, seed {row['seed']}: "
        assert f"{told}exactly as recorded, {row['decisions']} de" in capsys.readouterr().out
        recording = load_recording(Path("worst.npz"))
        assert (recording.driver, recording.seed) == (row["driver"], int(row["seed"]))


def test_a_collision_is_worse_than_any_near_miss(table: list[dict[str, str]]) -> None:
    farthest = max(table, key=lambda row: float(row["min_ttc_s"]))
    for row in table:
        row["collided"] = str(row is farthest)
    assert len({row["min_ttc_s"] for row in table}) > 1
    write_table(Path("rows.csv"), table[0], table)
    [worst] = worst_sessions(Path("rows.csv"), "min_ttc_s", None, NOTHING_CUSTOM, None, 1)
    assert (worst.name, worst.seed) == (farthest["driver"], int(farthest["seed"]))


def test_a_named_driver_chooses_among_its_own_rows(table: list[dict[str, str]]) -> None:
    for name in ("pretrained", "pretrained-paper@paper", "random"):
        own = [row for row in table if row["driver"] == name]
        slowest = min(own, key=lambda row: float(row["mean_speed_m_s"]))
        words = ["rows.csv", "--worst", "mean_speed_m_s", "--driver", name]
        assert main(["replay", *words, "--record", "worst.npz"]) == 0
        recording = load_recording(Path("worst.npz"))
        assert (recording.driver, recording.seed) == (name, int(slowest["seed"]))
        assert main(["replay", *words, "--sheet", "sheet.png"]) == 0
        with Image.open("sheet.png") as sheet:
            assert sheet.size == (2 * 640, 360)  # two episodes


def test_the_sheet_has_a_picture_of_each_episode(table: list[dict[str, str]]) -> None:
    Path("rows.csv").rename("rows.CSV")
    assert main(["replay", "rows.CSV", "--worst", "min_ttc_s", "--sheet", "sheet.png"]) == 0
    with Image.open("sheet.png") as sheet:
        assert sheet.size == (2 * 640, 3 * 360)  # six episodes
        tiles = [
            sheet.crop((x, y, x + 640, y + 360)).tobytes() for x in (0, 640) for y in (0, 360, 720)
        ]
    assert len(set(tiles)) == 6


def test_a_wrong_wish_is_one_sentence(table: list[dict[str, str]], capsys: Capsys) -> None:
    for words, said in (
        (["rows.csv", "--worst", "min_ttc"], "(did you mean 'min_ttc_s'?): name one of"),
        (["rows.csv", "--worst", "driver"], "no numbers in a column 'driver'"),
        (["rows.csv"], "a table takes --worst"),
        (["none.csv", "--worst", "min_ttc_s"], "There is no table none.csv"),
        (["idm", "--worst", "min_ttc_s"], "--worst takes a table"),
        (["idm", "--sheet", "x.png"], "--sheet draws ten episodes of --worst"),
        (["rows.csv", "--worst", "min_ttc_s", "--seed", "3"], "--seed cannot be changed"),
        (
            ["rows.csv", "--worst", "min_ttc_s", "--driver", "pretrained-paper"],
            "rows.csv has no episodes of the driver 'pretrained-paper' (did you mean "
            "'pretrained-paper@paper'?): name one of: pretrained, pretrained-paper@paper, random.",
        ),
        (["idm", "--driver", "idm"], "idm and idm are no one episode"),
        (
            ["rows.csv", "--worst", "vehicles", "--driver", "random"],
            "All 2 episodes have the same vehicles: name another one.",
        ),
        (["idm", "-o", "ppo.discount=0.5"], "-o ppo.discount=0.5 is a setting of trainings"),
    ):
        capsys.readouterr()
        assert main(["replay", *words]) == 1
        assert said in error_message(capsys)


def test_a_driver_that_changed_since_is_noticed_and_a_moved_one_is_named(
    here: Path, capsys: Capsys
) -> None:
    run_folder(here / "runs" / "mine")
    assert main([*evaluate("runs/mine"), "--episodes", "2"]) == 0
    capsys.readouterr()
    again = ["replay", "rows.csv", "--worst", "mean_reward", "--html", "a.html"]
    assert main(again) == 1
    assert "name its folder or file with --driver" in error_message(capsys)
    assert main([*again, "--driver", "mine"]) == 1
    assert "mine is the table's name of a run, so name its folder" in error_message(capsys)
    assert main([*again, "--driver", "runs/mine"]) == 0
    reward = min(rows(), key=lambda row: float(row["mean_reward"]))["mean_reward"]
    replace_in(Path("rows.csv"), reward, "-0.9", -1)
    assert main([*again, "--driver", "runs/mine"]) == 1
    assert "differs from its row" in error_message(capsys)


def test_of_two_drivers_with_one_last_name_the_path_names_one(here: Path) -> None:
    paths = ["runs/a/mine", "runs/b/mine"]
    for path in paths:
        run_folder(here / path)
    assert main([*evaluate(*paths), "--episodes", "1"]) == 0
    assert [row["driver"] for row in rows()] == paths
    again = ["replay", "rows.csv", "--worst", "mean_reward", "--driver", "runs/b/mine"]
    assert main([*again, "--record", "worst.npz"]) == 0
    assert load_recording(Path("worst.npz")).driver == "runs/b/mine"


def test_the_trainings_of_a_group_are_found_again_as_the_message_says(
    here: Path, capsys: Capsys
) -> None:
    for seed in (1, 2):
        run_folder(here / "moved" / f"seed-{seed}")
    assert main([*evaluate("mine=moved/seed-*"), "--episodes", "2"]) == 0
    capsys.readouterr()
    again = ["replay", "rows.csv", "--worst", "mean_reward", "--html", "a.html"]
    assert main(again) == 1
    assert "name the group as in the evaluation, --driver 'mine=PATTERN'" in error_message(capsys)
    assert main([*again, "--driver", "mine=moved/seed-*"]) == 0


def test_the_recordings_of_another_evaluation_stay(here: Path, capsys: Capsys) -> None:
    words = ["evaluate", "idm", "--vehicles", "5", "--episodes", "1", "--record", "kept"]
    words += ["-o", "simulation.decisions_per_episode=3"]
    assert main(words) == 0
    [file] = Path("kept").iterdir()
    first = file.read_bytes()
    assert main(words) == 0  # the same episode again
    capsys.readouterr()
    assert main([*words, "--safety-check", "strict"]) == 1
    assert f"{file.name} is the recording of another episode" in error_message(capsys)
    assert file.read_bytes() == first


def test_an_agent_of_an_observation_of_its_own_is_driven_again_with_it(
    here: Path, capsys: Capsys
) -> None:
    env = HighwayEnv(config=Config(), observation=("ego", "own_front"))
    PPO("MlpPolicy", env, n_steps=2, batch_size=2, device="cpu").save("a.zip")
    Path("seen.py").write_text('SEEN = ("ego", "own_front")\n')
    words = ["a.zip", "--vehicles", "5", "--episodes", "1", "-o"]
    words += ["simulation.decisions_per_episode=5"]
    assert main(["evaluate", *words, "--observation", "seen:SEEN", "--out", "a.csv"]) == 0
    worst = ["replay", "a.csv", "--worst", "mean_speed_m_s", "--record", "a.npz"]
    assert main(worst) == 1
    assert "a.csv was made with --observation seen:SEEN: give it again" in error_message(capsys)
    assert main([*worst, "--observation", "seen:SEEN"]) == 0
    assert "exactly as recorded, 5 decisions" in capsys.readouterr().out
    with ZipFile("a.npz", "a") as archive:
        archive.writestr("README.txt", "mine")
    assert main(["replay", "a.npz", "--parquet", "a.parquet"]) == 1
    assert "its part README.txt is no array): record the episode again" in capsys.readouterr().err
