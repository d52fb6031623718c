"""How a program of ``verification/`` ends."""

from typing import Any

import pytest

from drl_av.errors import DrlAvError
from verification.program import run_program


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
