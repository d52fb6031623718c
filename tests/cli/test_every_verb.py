"""Every verb ends by SIGTERM as by Ctrl-C, and removes what a killed process left."""

import argparse
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drl_av import cli
from drl_av.cli import VERBS, main

DRIVE = ("--driver", "idm", "--vehicles", "2", "--config", "short.toml")
WRITING = {
    "evaluate": ("rows.csv", (*DRIVE, "--episodes", "1", "--out", "rows.csv")),
    "export": ("driver.onnx", ("pretrained", "driver.onnx")),
    "figures": ("reward.png", ("rows.csv",)),
    "scenario --from": ("road", ("road", "--from", "road.toml")),
    "scenario --kind": ("road", ("road", "--kind", "merge")),
    "replay --html": ("page.html", (*DRIVE, "--html", "page.html")),
    "replay --record": ("drive.npz", (*DRIVE, "--html", "page.html", "--record", "drive.npz")),
    "replay --video": ("drive.gif", (*DRIVE, "--video", "drive.gif")),
}


@pytest.mark.parametrize("verb", VERBS)
def test_sigterm_ends_each_verb_as_ctrl_c_does(
    verb: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def works(options: argparse.Namespace) -> int:
        signal.raise_signal(signal.SIGTERM)
        return 0

    named = VERBS[verb]._replace(add_options=lambda parser: None, run=works)
    monkeypatch.setitem(cli.VERBS, verb, named)
    assert main([verb]) == 130
    assert capsys.readouterr().err == "drl-av: interrupted.\n"
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.parametrize("what", WRITING)
def test_each_verb_removes_what_a_killed_one_left(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("short.toml").write_text("[simulation]\ndecisions_per_episode = 2\n")
    Path("road.toml").write_text("circumference_m = 400\n")
    if what == "figures":
        Path("rows.csv").write_text("driver,vehicles,mean_speed_m_s\nidm,5,20\n")
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        dead.wait()
    name, words = WRITING[what]
    written = Path(name)
    abandoned = Path(f".{written.stem}.{dead.pid}.unfinished{written.suffix}")
    abandoned.write_text("half")
    assert main([what.split()[0], *words]) == 0
    assert written.exists()
    assert list(tmp_path.glob(".*unfinished*")) == []
