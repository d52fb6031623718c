"""Memory of several environments over many resets, and the tool that measures it."""

import re
import subprocess
import sys
from contextlib import ExitStack, closing

import pytest
from shown import ROOT

from drl_av.env.highway import HighwayEnv
from tools import measure_memory

SHORT = ["--resets", "60", "--warm-up", "40", "--environments", "3", "--vehicles", "10"]


def test_three_environments_of_a_process_keep_their_memory_over_resets() -> None:
    words = [str(ROOT / "tools" / "measure_memory.py"), *SHORT, "--decisions", "1"]
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert lines.pop().startswith("made by python tools/measure_memory.py --resets 60 ")
    assert [line.split()[0] for line in lines[:-1]] == [str(n) for n in range(40, 101, 6)]
    growth = re.fullmatch(r"growth over 60 resets of 3 environments: ([+-]\d+\.\d+)%", lines[-1])
    assert growth is not None
    assert abs(float(growth[1])) < 5


def test_memory_that_grows_by_a_twentieth_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    held = iter(100_000_000 + 500_000 * n for n in range(11))  # 100 to 105 MB
    monkeypatch.setattr(measure_memory, "resident_bytes", lambda: next(held))
    words = ["--resets", "10", "--warm-up", "1", "--environments", "2", "--vehicles", "1"]
    monkeypatch.setattr(sys, "argv", ["measure_memory.py", *words, "--decisions", "1"])
    assert measure_memory.main() == 1
    assert "growth over 10 resets of 2 environments: +5.00%" in capsys.readouterr().out


def test_after_many_resets_in_turns_each_environment_drives_as_a_new_one() -> None:
    with ExitStack() as stack:
        old = [stack.enter_context(closing(HighwayEnv())) for _ in range(3)]
        for _ in zip(*(measure_memory.resets(env, 25, 10, 1) for env in old), strict=True):
            pass
        new = stack.enter_context(closing(HighwayEnv()))
        for seed, env in enumerate(old):
            driven = []
            for each in (env, new):
                each.reset(seed=seed, options={"vehicles": 10})
                for _ in range(5):
                    each.step(4)
                seen = each.scene.snapshot
                driven.append((seen.s_m.tobytes(), seen.y_m.tobytes(), seen.speed_m_s.tobytes()))
            assert driven[0] == driven[1]
