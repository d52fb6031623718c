"""Every verb ends by SIGTERM and SIGHUP as by Ctrl-C, and removes what a killed process left."""

import argparse
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from runs import Capsys

from drl_av import cli
from drl_av.cli import VERBS, main
from drl_av.env.metrics import EpisodeMetrics
from drl_av.learning.algorithm_1 import EpisodeRow, Training

SHORT = ("-o", "simulation.decisions_per_episode=2")
DRIVE = ("--driver", "idm", "--vehicles", "2", *SHORT)
WRITING = {
    "train": ("run", ("--out", "run", "--episodes", "1", *SHORT)),
    "adapt": ("run", ("--out", "run", "--episodes", "1", *SHORT)),
    "evaluate": ("rows.csv", (*DRIVE, "--episodes", "1", "--out", "rows.csv")),
    "export": ("driver.onnx", ("pretrained", "driver.onnx")),
    "figures": ("reward.png", ()),
    "scenario --from": ("road", ("road", "--from", "road.toml")),
    "scenario --kind": ("road", ("road", "--kind", "merge")),
    "replay --html": ("page.html", (*DRIVE, "--html", "page.html")),
    "replay --record": ("drive.npz", (*DRIVE, "--html", "page.html", "--record", "drive.npz")),
    "replay --video": ("drive.gif", (*DRIVE, "--video", "drive.gif")),
}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("verb", VERBS)
def test_sigterm_and_sighup_end_each_verb_as_ctrl_c_does(
    verb: str, number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    def works(options: argparse.Namespace) -> int:
        signal.raise_signal(number)
        return 0

    named = VERBS[verb]._replace(add_options=lambda parser: None, run=works)
    monkeypatch.setitem(cli.VERBS, verb, named)
    former = signal.signal(number, signal.SIG_DFL)  # nohup ignores one of them
    assert main([verb]) == 130
    assert capsys.readouterr().err == "drl-av: interrupted.\n"
    assert signal.signal(number, former) is signal.SIG_DFL


@pytest.mark.parametrize("what", WRITING)
def test_each_verb_removes_what_a_killed_one_left(what: str, here: Path) -> None:
    Path("road.toml").write_text("circumference_m = 400\n")
    name, words = WRITING[what]
    written = Path(name)
    written.parent.mkdir(exist_ok=True)
    leave_unfinished(written)
    assert main([what.split()[0], *words]) == 0
    assert written.exists()
    assert list(here.rglob(".*unfinished*")) == []


@pytest.mark.parametrize("verb", ["train", "adapt"])
def test_a_resumed_training_removes_what_a_killed_one_left_in_its_folder(
    verb: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as interrupted:
        episodes = iter([Training.run_episode])

        def run_episode(training: Training, *metrics: EpisodeMetrics) -> EpisodeRow:
            for run in episodes:
                return run(training, *metrics)
            raise KeyboardInterrupt

        interrupted.setattr(Training, "run_episode", run_episode)
        often = ("-o", "learning.checkpoint_every=1")
        assert main([verb, "--out", "run", "--episodes", "2", *SHORT, *often]) == 130
    for name in ("checkpoint.safetensors", "policy.safetensors"):
        leave_unfinished(Path("run", name))
    assert main([verb, "--out", "run", "--resume"]) == 0
    assert len(Path("run/episodes.csv").read_text().splitlines()) == 3
    assert list(here.rglob(".*unfinished*")) == []


def leave_unfinished(path: Path) -> None:
    """Leave half a file beside ``path``, as a process that is killed while it writes it does."""
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        dead.wait()
    folder = path.with_name(f".{path.stem}.{dead.pid}.unfinished{path.suffix}")
    folder.mkdir()
    (folder / path.name).write_text("half")
