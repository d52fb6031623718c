"""The committed results: still what the experiments of this version would make."""

import shutil
from importlib.metadata import version
from pathlib import Path

import pytest

from studies.__main__ import main
from studies.registry import EXPERIMENTS

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
TESTED = (ROOT / "constraints.txt").read_text().splitlines()
SAME_BYTES = all(f"{name}=={version(name)}" in TESTED for name in ("matplotlib", "pillow"))
"""Whether figures have the bytes of the committed ones, which depend on these."""


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_nothing_of_them_is_refused_or_made_again(experiment: str, tmp_path: Path) -> None:
    out, runs = tmp_path / "results", tmp_path / "runs"
    out.mkdir()
    for file in (*RESULTS.glob("*.csv"), *RESULTS.glob("*.json")):
        shutil.copy(file, out)
    words = [experiment, "--jobs", "1", "--out", str(out), "--runs", str(runs)]
    assert main(words) == 0
    for file in out.iterdir():
        if SAME_BYTES or file.suffix != ".png":
            assert file.read_bytes() == (RESULTS / file.name).read_bytes(), file.name
    assert all((out / f"{name}.png").exists() for name in EXPERIMENTS[experiment].figures)
    assert not list(runs.glob("*"))
