"""How a program ends."""

import sys
from functools import partial

import pytest
from runs import Capsys

from drl_av.cli.console import exit_status


class Callback:
    """Swallows an interrupt, as a callback of a library does."""

    def __del__(self) -> None:
        raise KeyboardInterrupt


def compile_it(fails: bool) -> int:
    Callback()
    if fails:
        raise RuntimeError("no compiled object yet")
    return 0


def test_an_interrupt_that_a_library_swallows_is_one(capsys: Capsys) -> None:
    hook = sys.unraisablehook
    for fails in (True, False):
        assert exit_status("drl-av", partial(compile_it, fails)) == 130
        assert capsys.readouterr().err == "drl-av: interrupted.\n"
    assert sys.unraisablehook is hook


def test_an_error_without_an_interrupt_is_shown_as_it_is() -> None:
    def broken() -> int:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        exit_status("drl-av", broken)
