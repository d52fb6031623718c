"""How a program ends."""

import os
import signal
import sys
from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from runs import Capsys

from drl_av.cli import main
from drl_av.cli.console import exit_status, stop_request
from drl_av.config.presets import PRESETS
from drl_av.learning.large_scale import Progress

PPO = PRESETS["large"].ppo


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


def test_a_stop_is_one_though_nobody_reads_that_it_is_and_a_thread_has_none() -> None:
    with stop_request() as stop, pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "write", lambda *_: os.stat("/no/file"))  # raises an OSError
        signal.raise_signal(signal.SIGTERM)
    assert stop.made
    with ThreadPoolExecutor() as pool, stop_request():
        assert not pool.submit(lambda: stop_request().__enter__().made).result()


@pytest.mark.parametrize(("updates", "status"), [(1, 130), (2, 0)])
def test_a_training_at_scale_that_is_stopped_after_its_last_update_is_complete(
    updates: int, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> Generator[Progress, None, None]:
        for update in range(updates):
            if update == updates - 1:
                signal.raise_signal(signal.SIGTERM)
            yield Progress(PPO.batch_size * (update + 1), 0.0, 0)

    monkeypatch.setattr("drl_av.learning.large_scale.train_at_scale", stopped)
    size = f"ppo.decisions={2 * PPO.batch_size}"
    assert main(["train", "--preset", "large", "-o", size, "--out", "run"]) == status


def test_what_is_closed_is_the_null_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert exit_status("drl-av", lambda: sys.stdout.write("x") - 1) == 0


def test_nohup_stays() -> None:
    former = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with stop_request() as stop:
        signal.raise_signal(signal.SIGHUP)
    signal.signal(signal.SIGHUP, former)
    assert not stop.made


def test_a_name_of_bytes_that_are_no_text_is_one_sentence(capsys: Capsys) -> None:
    assert exit_status("drl-av", lambda: len(os.fsdecode(b"caf\xe9.csv").encode())) == 1
    assert capsys.readouterr().err == "drl-av: 'caf\\udce9.csv' is no text in utf-8: rename it.\n"


def test_an_error_without_an_interrupt_is_shown_as_it_is() -> None:
    def broken() -> int:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        exit_status("drl-av", broken)
