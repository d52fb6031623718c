"""Commands and programs that a page shows, and how to run them."""

import re
import shlex
import subprocess
from pathlib import Path

from programs import python

ROOT = Path(__file__).parent.parent
SMALL = {
    "scenario": [],
    "train": ["--episodes", "2"],
    "evaluate": ["--episodes", "1", "--vehicles", "2"],
    "adapt": ["--episodes", "2"],
    "figures": [],
    "replay": ["--decisions", "3"],
}
"""Arguments that reduce a shown command to a matter of seconds."""


def read(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def fenced(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", read(page), flags=re.DOTALL)


SMALL_PPO = ("decisions=128", "batch_size=64", "minibatch_size=64", "worlds=8")


def run_commands(page: str, folder: Path) -> None:
    """Run the console commands of a page in order, but those that need a screen."""
    lines = [line for block in fenced(page, "console") for line in block.splitlines()]
    for line in lines:
        program, verb, *options = shlex.split(line.removeprefix("$ "), comments=True)
        assert program == "drl-av"
        if verb == "replay" and "--video" not in options:
            continue
        if verb == "evaluate" and "--episodes" in options:
            del options[options.index("--episodes") :][:2]
        small = [] if "--resume" in options else SMALL[verb]
        if any(word.startswith("large") for word in options):
            small = [word for number in SMALL_PPO for word in ("-o", f"ppo.{number}")]
        run(folder, "-m", "drl_av", verb, *options, *small)


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    done = python(*arguments, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done
