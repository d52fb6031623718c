"""The tool that measures the memory of several environments over many resets."""

import sys

import pytest
from runs import Capsys

from tools import measure_memory


def test_memory_that_grows_by_a_twentieth_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    held = iter(100_000_000 + 500_000 * n for n in range(11))  # 100 to 105 MB
    monkeypatch.setattr(measure_memory, "resident_bytes", lambda: next(held))
    words = ["--resets", "10", "--warm-up", "1", "--environments", "2", "--vehicles", "1"]
    monkeypatch.setattr(sys, "argv", ["measure_memory.py", *words, "--decisions", "1"])
    assert measure_memory.main() == 1
    *_, growth, _ = capsys.readouterr().out.splitlines()
    assert growth == "growth over 10 resets of 2 environments: +5.00%"
