"""What a results file says of its origin, without a path of the machine that made it."""

import pytest

from drl_av.evaluation.provenance import command


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
