"""Memory of several environments over many resets, and the tool that measures it."""

import re
import sys

import pytest
from programs import python
from runs import Capsys
from shown import ROOT

from tools import measure_memory

SHORT = ["--resets", "60", "--warm-up", "40", "--environments", "3", "--vehicles", "10"]


def test_three_environments_of_a_process_keep_their_memory_over_resets() -> None:
    words = [str(ROOT / "tools" / "measure_memory.py"), *SHORT, "--decisions", "1"]
    done = python(*words)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert lines.pop().startswith("made by python tools/measure_memory.py --resets 60 ")
    assert [line.split()[0] for line in lines[:-1]] == [str(n) for n in range(40, 101, 6)]
    growth = re.fullmatch(r"growth over 60 resets of 3 environments: ([+-]\d+\.\d+)%", lines[-1])
    assert abs(float(growth[1])) < 5


def test_memory_that_grows_by_a_twentieth_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    held = iter(100_000_000 + 500_000 * n for n in range(11))  # 100 to 105 MB
    monkeypatch.setattr(measure_memory, "resident_bytes", lambda: next(held))
    words = ["--resets", "10", "--warm-up", "1", "--environments", "2", "--vehicles", "1"]
    monkeypatch.setattr(sys, "argv", ["measure_memory.py", *words, "--decisions", "1"])
    assert measure_memory.main() == 1
    assert "growth over 10 resets of 2 environments: +5.00%" in capsys.readouterr().out
