"""How a program of ``verification/`` ends."""

import re
from typing import Any

import pytest
from programs import python
from shown import ROOT

import drl_av
from drl_av.errors import DrlAvError
from verification.program import made_by, run_program


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (DrlAvError("No such\n    driver."), 1, "falsify: No such driver.\n"),
        (
            OSError(28, "No space", "/full"),
            1,
            "falsify: /full cannot be read or written (No space): correct the path, or free some "
            "space.\n",
        ),
        (KeyboardInterrupt(), 130, "falsify: interrupted.\n"),
    ],
)
def test_an_error_of_a_program_is_one_sentence_and_a_status(
    error: BaseException, status: int, sentence: str, capsys: Any, monkeypatch: Any
) -> None:
    def main() -> int:
        raise error

    monkeypatch.setattr("sys.argv", ["/somewhere/falsify.py"])
    with pytest.raises(SystemExit) as ended:
        run_program(main)
    assert (ended.value.code, capsys.readouterr().err) == (status, sentence)


def test_every_program_that_the_makefile_runs_is_listed() -> None:
    done = python("-m", "verification", cwd=ROOT)
    line = r"^python -m (verification\.\w+) +[A-Z].+\.$"
    listed = set(re.findall(line, done.stdout, re.MULTILINE))
    made = set(re.findall(r"verification\.\w+", (ROOT / "Makefile").read_text(encoding="utf-8")))
    assert made <= listed
    assert "verification.program" not in listed


def test_a_text_tells_its_origin_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["tools/benchmark.py"])
    line = made_by(59.6)
    assert line.startswith("made by python tools/benchmark.py in 60 s on 20")
    assert "eclipse-sumo 1." in line
    assert f"drl-av {drl_av.__version__}, " in line
    assert "cores" in line
    assert "\n" not in line


def test_it_names_the_kernels_on_which_the_last_bits_of_a_training_depend() -> None:
    code = "from verification.program import made_by; print(made_by(1))"
    made = python("-c", code, OPENBLAS_CORETYPE="Nehalem")  # every x86-64 processor can
    assert made.stdout.rstrip().endswith(" Nehalem")
