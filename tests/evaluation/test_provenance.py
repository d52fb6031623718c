"""What a results file says of its origin, without a path of the machine that made it."""

from dataclasses import asdict

import pytest
from programs import python

from drl_av.config import Config
from drl_av.evaluation.provenance import command, made_by
from studies.store import stored_config


@pytest.mark.parametrize(
    ("program", "shown"),
    [
        ("/home/someone/.venv/bin/drl-av", "drl-av --jobs 2 'a b'"),
        ("/home/someone/drl_av/__main__.py", "drl-av --jobs 2 'a b'"),
        ("/home/someone/tools/benchmark.py", "python tools/benchmark.py --jobs 2 'a b'"),
        ("/src/examples/own_experiment.py", "python examples/own_experiment.py --jobs 2 'a b'"),
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
    assert "cores" in line
    assert "\n" not in line


def test_it_names_the_kernels_on_which_the_last_bits_of_a_training_depend() -> None:
    code = "from drl_av.evaluation.provenance import made_by; print(made_by(1))"
    made = python("-c", code, OPENBLAS_CORETYPE="Nehalem")  # every x86-64 processor can
    assert made.stdout.rstrip().endswith(" Nehalem")


def test_settings_stored_before_there_was_a_tolerance_in_v_des_had_none() -> None:
    settings = asdict(Config())
    assert stored_config(settings, "curves.json") == Config()
    del settings["reward"]["speed_tolerance_m_s"]
    found = stored_config(settings, "curves.json")
    assert found == Config().updated("reward", speed_tolerance_m_s=0.0)
