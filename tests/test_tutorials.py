"""Each tutorial works in an empty folder, made small: its files, then its commands, in order."""

import re
import shlex
from pathlib import Path

import pytest
from programs import python
from shown import ROOT, read

from drl_av.sumo_programs import program

PAGES = sorted(path.stem for path in (ROOT / "docs" / "tutorials").glob("*.md"))
SMALL = {
    "agent.md": {
        "my_agent.py 20000": "my_agent.py 60",
        "learning_starts=1000": "learning_starts=40",
        "5 15 25 --episodes 10": "5 --episodes 1",
        "--vehicles 15 --seed": "--vehicles 5 --decisions 3 --seed",
    },
    "check.md": {
        "--episodes 50": "--episodes 1",
        "--scenes 1000": "--scenes 300",
        "--scenes 5000": "--scenes 100",
    },
    "road.md": {
        "--episodes 10": "--episodes 1",
        "--seed 800000 --video": "--seed 800000 --decisions 3 --video",
    },
}
"""Text that makes a tutorial a matter of seconds, in place of the shown one."""
ONE_SCREEN = 70
"""Most lines of a tutorial."""


def small(page: str) -> str:
    text = read(f"docs/tutorials/{page}")
    for shown, instead in SMALL[page].items():
        assert text.count(shown) == 1, f"{page} no longer has {shown!r} once"
        text = text.replace(shown, instead)
    return text


def run(command: str, folder: Path) -> str:
    """Run one command of a tutorial; return what it prints."""
    name, *words = shlex.split(command)
    if name == "netconvert":
        words = ["-c", "import subprocess, sys; sys.exit(subprocess.call(sys.argv[1:]))"]
        words += [str(program("netconvert")), *shlex.split(command)[1:]]
    elif name == "drl-av":
        words = ["-m", "drl_av", *words]
    else:
        assert name == "python"
    done = python(*words, cwd=folder, PYTHONPATH=str(ROOT))
    breaks = "falsify --safety-check my_check" in command
    assert done.returncode == breaks, f"{command}: {done.stderr}"
    return done.stdout


def follow(page: str, folder: Path) -> list[str]:
    """Write the files of a tutorial, run its commands, and return what each prints."""
    printed = []
    for title, block in re.findall(r'```\w+(?: title="(.+?)")?\n(.*?)```', small(page), re.DOTALL):
        if title:
            (folder / title).write_text(block, encoding="utf-8")
        else:
            lines = block.replace("\\\n", "").splitlines()
            assert all(line.startswith("$ ") for line in lines)
            printed += [run(line.removeprefix("$ "), folder) for line in lines]
    return printed


def test_the_agent_is_trained_compared_drawn_and_filmed(tmp_path: Path) -> None:
    _, summary, *_ = follow("agent.md", tmp_path)
    assert "my_agent.zip: " in summary  # PASS or FAIL against the rule
    for made in ("my_agent.zip", "mine.csv", "figures/mean_speed.png", "mine.mp4"):
        assert (tmp_path / made).stat().st_size > 0


def test_the_road_is_built_driven_and_filmed(tmp_path: Path) -> None:
    follow("road.md", tmp_path)
    for made in ("my.net.xml", "my_road/highway.sumocfg", "road.mp4"):
        assert (tmp_path / made).stat().st_size > 0
    assert "truck" in (tmp_path / "my_road" / "scenario.toml").read_text(encoding="utf-8")


def test_the_search_breaks_the_new_check_and_not_strict(tmp_path: Path) -> None:
    driven, *searched = follow("check.md", tmp_path)
    assert "safety check: my_check:six_seconds" in driven
    mine, strict = (re.findall(r"lead-brakes +\d+ +(\d+)", printed) for printed in searched)
    assert int(mine[0]) > 0 == int(strict[0])


def test_each_tutorial_is_followed() -> None:
    assert {f"{page}.md" for page in PAGES} == set(SMALL)


@pytest.mark.parametrize("page", PAGES)
def test_a_tutorial_fits_on_a_screen(page: str) -> None:
    assert len(read(f"docs/tutorials/{page}.md").splitlines()) <= ONE_SCREEN
