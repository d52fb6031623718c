"""What the README shows is run, made small; its tables are those of the committed results."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
SMALL = {
    "scenario": [],
    "train": ["--episodes", "2"],
    "evaluate": ["--episodes", "1", "--vehicles", "2"],
    "adapt": ["--episodes", "2"],
    "figures": [],
    "replay": ["--decisions", "3"],
}
"""What makes a command of the README a matter of seconds."""


def fenced(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def shown_commands() -> list[list[str]]:
    lines = [line for block in fenced("console") for line in block.splitlines()]
    commands = [shlex.split(line.removeprefix("$ "), comments=True) for line in lines]
    return [command for command in commands if command]


def needs_a_screen(command: list[str]) -> bool:
    return command[1] == "replay" and "--video" not in command


def test_the_console_commands_work_one_after_the_other_in_an_empty_folder(tmp_path: Path) -> None:
    commands = [command for command in shown_commands() if not needs_a_screen(command)]
    assert {command[1] for command in commands} == set(SMALL)
    for command in commands:
        program, verb, *options = command
        assert program == "drl-av"
        if verb == "evaluate":
            options = [o for o in options if o not in ("--episodes", "20")]
        small = [] if verb == "train" and "--resume" in options else SMALL[verb]
        run(tmp_path, "-m", "drl_av", verb, *options, *small)
    for made in ("my_loop/highway.sumocfg", "runs/first/policy.safetensors", "table.csv"):
        assert (tmp_path / made).exists()
    assert (tmp_path / "figures" / "mean_speed.png").exists()
    assert (tmp_path / "drive.mp4").exists()
    assert (tmp_path / "episode.npz").exists()


def test_the_python_example_runs(tmp_path: Path) -> None:
    done = run(tmp_path, "-c", fenced("python")[0])
    assert done.stdout.startswith("none") or "lane" in done.stdout or "road" in done.stdout


def test_roads_and_settings_of_ones_own(tmp_path: Path) -> None:
    (settings,) = fenced("toml")
    (tmp_path / "mine.toml").write_text(settings)
    run(tmp_path, "-m", "drl_av", "scenario", "my_loop")
    small = ["--preset", "fast", "--config", "mine.toml", "--episodes", "1"]
    run(tmp_path, "-m", "drl_av", "train", "--out", "mine", *small)
    assert 'lateral_plant = "steering"' in (tmp_path / "mine" / "config.toml").read_text()
    run(tmp_path, "-c", fenced("python")[1])
    short = ["--decisions", "2", "--video", "story.mp4"]
    run(tmp_path, "-m", "drl_av", "replay", "--scenario", "my_story", *short)


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done


def test_the_tables_are_those_of_the_committed_results() -> None:
    tool = ROOT / "tools" / "refresh_tables.py"
    done = subprocess.run([sys.executable, str(tool), "--check"], env=os.environ.copy())
    assert done.returncode == 0, "run: python tools/refresh_tables.py"


@pytest.mark.parametrize("command", ["demo", "test"])
def test_the_two_commands_of_the_first_screen_are_targets_of_the_makefile(command: str) -> None:
    first_screen = "\n".join(README.splitlines()[:25])
    assert f"make {command}" in first_screen
    assert re.search(rf"^{command}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
