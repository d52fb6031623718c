"""A trained driver drives where torch cannot be imported; only learning needs it."""

import subprocess
from pathlib import Path

import pytest
from programs import python

WITHOUT = """
import sys
hidden = sys.argv.pop(1)
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == hidden:
            raise ModuleNotFoundError(f"No module named {hidden!r}", name=hidden)
sys.meta_path.insert(0, Without())
from drl_av.cli import main
sys.exit(main(sys.argv[1:]))
"""
SHORT_WITH_LEVEL_1 = """
[simulation]
decisions_per_episode = 5
[traffic]
kind = "calm"
level_1_share = 1.0
"""


def without_torch(*words: str) -> subprocess.CompletedProcess[str]:
    return python("-c", WITHOUT, "torch", *words)


def test_evaluate_and_replay_drive_among_level_1_traffic(tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(SHORT_WITH_LEVEL_1)
    out, film = tmp_path / "rows.csv", tmp_path / "film.gif"
    words = ["evaluate", "pretrained", "idm", "--vehicles", "3", "--episodes", "1"]
    done = without_torch(*words, "--config", str(settings), "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert len(out.read_text().splitlines()) == 1 + 2
    words = ["replay", "--video", str(film), "--vehicles", "3", "--config", str(settings)]
    done = without_torch(*words)
    assert done.returncode == 0, done.stderr
    assert film.stat().st_size > 0


@pytest.mark.parametrize(
    ("hidden", "preset", "what"),
    [
        ("torch", "paper", "needs the package torch"),
        ("sb3_contrib", "large", "at scale needs the package sb3-contrib"),
        ("stable_baselines3", "large", "at scale needs the package sb3-contrib"),
    ],
)
def test_learning_is_what_needs_torch_and_at_scale_sb3_contrib(
    hidden: str, preset: str, what: str, tmp_path: Path
) -> None:
    words = ["train", "--out", str(tmp_path / "run"), "--preset", preset]
    done = python("-c", WITHOUT, hidden, *words)
    assert done.returncode == 1
    assert " ".join(done.stderr.split()) == (
        f"drl-av: Training {what}, which is not installed: pip install 'drl-av[train]'."
    )
    assert not (tmp_path / "run").exists()
