"""What a results file says of its origin, without a path of the machine that made it."""

import pytest

from drl_av.studies.reproduction.provenance import command, made_by


@pytest.mark.parametrize(
    ("program", "told"),
    [
        ("/home/someone/.venv/bin/drl-av", "drl-av --jobs 2 'a b'"),
        ("/home/someone/drl_av/__main__.py", "drl-av --jobs 2 'a b'"),
        ("/home/someone/tools/benchmark.py", "python tools/benchmark.py --jobs 2 'a b'"),
        ("tools/benchmark.py", "python tools/benchmark.py --jobs 2 'a b'"),
    ],
)
def test_a_command_is_told_as_it_would_be_given_in_the_projects_folder(
    program: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", [program, "--jobs", "2", "a b"])
    assert command() == told


def test_a_text_tells_its_origin_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["tools/benchmark.py"])
    line = made_by(59.6)
    assert line.startswith("made by python tools/benchmark.py in 60 s on 20")
    assert "eclipse-sumo 1." in line
    assert "cores" in line
    assert "\n" not in line
