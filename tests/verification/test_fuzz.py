"""Mutated inputs of every kind, a few of each; ``python -m verification.fuzz`` tries more."""

import os
import random
import signal
import time
from pathlib import Path

import pytest
from worlds import CENTER, ROAD, Car, snapshot

from drl_av.errors import ConfigError
from verification import fuzz_driving
from verification.fuzz import KINDS, fuzz
from verification.fuzz_driving import apart, require_sense

INPUTS = {"config": 500, "description": 410, "command line": 400, "checkpoint": 100}


@pytest.mark.parametrize("kind", KINDS)
def test_a_mutated_input_is_used_or_refused_in_one_sentence(kind: str, here: Path) -> None:
    assert os.getcwd() == str(here)
    inputs = 25 if kind.startswith("driven") else INPUTS.get(kind, 350)
    refused, failures = fuzz(kind, inputs, seed=21)
    assert failures == []
    assert kind == "command line" or inputs * 0.05 < refused
    assert kind == "command line" or refused < inputs


def _crashes(rng: random.Random, folder: Path) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _hangs(rng: random.Random, folder: Path) -> None:
    time.sleep(60)


def _is_refused(rng: random.Random, folder: Path) -> None:
    raise ConfigError("The number is 3, but must be 4.")


def _divides_by_zero(rng: random.Random, folder: Path) -> None:
    raise ZeroDivisionError("by hand")


def test_a_crash_a_hang_and_an_error_of_an_input_are_failures_and_a_sentence_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(fuzz_driving, "LIMIT_S", 1)
    tried = {"crash": _crashes, "hang": _hangs, "sentence": _is_refused, "bug": _divides_by_zero}
    for name, attempt in tried.items():
        monkeypatch.setitem(KINDS, name, apart(attempt))
    for name in ("crash", "hang"):
        failure = "AssertionError('its process crashed, or took longer than 1 s')"
        assert fuzz(name, 1, seed=1) == (0, [f"{name} 0 of seed 1: {failure}"])
    assert fuzz("sentence", 2, seed=1) == (2, [])
    refused, failures = fuzz("bug", 2, seed=1)
    assert refused == 0
    assert ["ZeroDivisionError" in failure for failure in failures] == [True, True]


def test_numbers_that_make_no_sense_are_found() -> None:
    require_sense(snapshot(Car(40.0, CENTER, 22.0)), ROAD)
    for car in (
        Car(float("nan"), CENTER, 22.0),
        Car(40.0, CENTER, -1.0),
        Car(40.0, CENTER, 500.0),
        Car(40.0, -2.0, 22.0),
        Car(40.0, 9.6, 22.0),
    ):
        with pytest.raises(AssertionError):
            require_sense(snapshot(car), ROAD)
