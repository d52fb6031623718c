"""Folders of runs: their files, the order of writing them, and commands that are interrupted."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from programs import HANG_S

from drl_av.cli import main
from drl_av.config import Config
from drl_av.drivers.network import QNetwork
from drl_av.drivers.policy_file import save_policy

Capsys = pytest.CaptureFixture[str]
"""What a test has printed: the fixture ``capsys``."""
SHORT = Config().updated("simulation", decisions_per_episode=10)
TINY = (
    Config()
    .updated("simulation", decisions_per_episode=20)
    .updated("learning", episodes=12, evaluate_every=3, checkpoint_every=2, evaluation_episodes=2)
)
"""A training of 12 short episodes."""

HARNESS = """
import os, signal, sys, threading
from drl_av.cli import main
from drl_av.env import HighwayEnv
from drl_av.learning import run_folder

def die(number):
    os.kill(os.getpid(), number)

def at_call(owner, name, call, then, after=False):
    method, calls = getattr(owner, name), 0
    def armed(*arguments, **options):
        nonlocal calls
        calls += 1
        if calls == call and not after:
            then()
        result = method(*arguments, **options)
        if calls == call and after:
            then()
        return result
    setattr(owner, name, armed)

def without_root_rights():
    import ctypes
    header, data = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    assert ctypes.CDLL(None).capset(header, data) == 0
"""
KILL = "lambda: die(signal.SIGKILL)"
INTERRUPT = "lambda: die(signal.SIGINT)"


def interrupted(
    prelude: str, arguments: list[str], limit: int | None = None
) -> subprocess.CompletedProcess[str]:
    """Run ``drl-av`` in a process of its own after the prelude, which may call ``at_call``.

    No file may have more bytes than ``limit``.
    """

    def starve() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    program = f"{HARNESS}\n{prelude}\nsys.exit(main({arguments!r}))"
    return subprocess.run(
        [sys.executable, "-B", "-c", program],
        preexec_fn=starve,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
    )


def run_folder(folder: Path, config: Config = SHORT) -> Path:
    """The folder of a run with an untrained policy."""
    folder.mkdir(parents=True)
    save_policy(folder / "policy.safetensors", QNetwork(np.random.default_rng(3)), config)
    return folder


def replace_in(file: Path, old: str, new: str, count: int = 1) -> None:
    """Replace a text in a file, in which it must be."""
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, count), encoding="utf-8")


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}


def one_sentence(text: str) -> str:
    """The text, which must be one sentence of ``drl-av``."""
    assert text.startswith("drl-av: ")
    assert text.endswith(".\n")
    assert text.count("\n") == 1
    assert "Traceback" not in text
    return text


def error_message(capsys: Capsys) -> str:
    """The one sentence on stderr."""
    return one_sentence(capsys.readouterr().err)


def refused_scenario(capsys: Capsys, folder: Path, *words: str) -> str:
    """The sentence with which ``drl-av scenario`` refuses to write ``folder/new``."""
    assert main(["scenario", str(folder / "new"), *words]) == 1
    assert not (folder / "new").exists()
    return error_message(capsys)


def disk_tape(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A list that grows with each file or folder that is brought to the disk or renamed."""
    tape: list[str] = []
    fsync, replace = os.fsync, os.replace

    def synced(descriptor: int) -> None:
        tape.append(f"fsync {Path(os.readlink(f'/proc/self/fd/{descriptor}')).name}")
        fsync(descriptor)

    def renamed(old: Path, new: Path) -> None:
        tape.append(f"rename {Path(old).name} to {Path(new).name}")
        replace(old, new)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", renamed)
    return tape
