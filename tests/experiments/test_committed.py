"""The committed results: still what the experiments of this version would make."""

import shutil
from pathlib import Path

import pytest

from drl_av.cli import main
from drl_av.experiments.registry import EXPERIMENTS

RESULTS = Path(__file__).parents[2] / "docs" / "results"


@pytest.mark.parametrize("experiment", [name for name in EXPERIMENTS if name != "figures"])
def test_nothing_of_them_is_refused_or_made_again(experiment: str, tmp_path: Path) -> None:
    out, runs = tmp_path / "results", tmp_path / "runs"
    out.mkdir()
    for file in (*RESULTS.glob("*.csv"), *RESULTS.glob("*.json")):
        shutil.copy(file, out)
    words = ["reproduce", experiment, "--jobs", "1", "--out", str(out), "--runs", str(runs)]
    assert main(words) == 0
    for file in out.iterdir():
        assert file.read_bytes() == (RESULTS / file.name).read_bytes(), file.name
    assert not list(runs.glob("*"))
