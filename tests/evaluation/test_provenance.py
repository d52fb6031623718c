"""What a results file says of its origin, without a path of the machine that made it."""

import pytest
from programs import python

import drl_av
from drl_av.evaluation.provenance import command, made_by


@pytest.mark.parametrize(
    ("program", "shown"),
    [
        ("/home/someone/.venv/bin/drl-av", "drl-av --jobs 2 'a b'"),
        ("/home/someone/drl_av/__main__.py", "drl-av --jobs 2 'a b'"),
        ("/home/someone/tools/benchmark.py", "python tools/benchmark.py --jobs 2 'a b'"),
        ("/src/examples/own_check.py", "python examples/own_check.py --jobs 2 'a b'"),
        ("/src/studies/__main__.py", "python -m studies --jobs 2 'a b'"),
        ("/home/someone/drl_av/mine.py", "python mine.py --jobs 2 'a b'"),
        ("tools/benchmark.py", "python tools/benchmark.py --jobs 2 'a b'"),
        ("/src/verification/long_run.py", "python -m verification.long_run --jobs 2 'a b'"),
    ],
)
def test_a_command_is_shown_as_it_would_be_given_in_the_projects_folder(
    program: str, shown: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", [program, "--jobs", "2", "a b"])
    assert command() == shown


def test_a_text_tells_its_origin_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["tools/benchmark.py"])
    line = made_by(59.6)
    assert line.startswith("made by python tools/benchmark.py in 60 s on 20")
    assert "eclipse-sumo 1." in line
    assert f"drl-av {drl_av.__version__}, " in line
    assert "cores" in line
    assert "\n" not in line


def test_it_names_the_kernels_on_which_the_last_bits_of_a_training_depend() -> None:
    code = "from drl_av.evaluation.provenance import made_by; print(made_by(1))"
    made = python("-c", code, OPENBLAS_CORETYPE="Nehalem")  # every x86-64 processor can
    assert made.stdout.rstrip().endswith(" Nehalem")
