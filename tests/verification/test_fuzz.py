"""Mutated inputs of every kind, a few of each; ``python -m verification.fuzz`` tries more."""

import os
from pathlib import Path

import pytest

from verification.fuzz import KINDS, fuzz


@pytest.mark.parametrize("kind", KINDS)
def test_a_mutated_input_is_used_or_refused_in_one_sentence(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert os.getcwd() == str(tmp_path)
    refused = fuzz(kind, 350, seed=21)
    assert kind == "command line" or refused > 100
