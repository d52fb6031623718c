"""The committed results: still what the studies of this version would make."""

import shutil
from importlib.metadata import version
from pathlib import Path

import pytest
from runs import Capsys

from studies.__main__ import main
from studies.registry import STUDIES

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "docs" / "results"
TESTED = (ROOT / "constraints.txt").read_text().splitlines()
SAME_BYTES = all(f"{name}=={version(name)}" in TESTED for name in ("matplotlib", "pillow"))
"""Whether figures have the bytes of the committed ones, which depend on these."""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tables of results, without figures."""
    folder = tmp_path_factory.mktemp("results")
    for file in (*RESULTS.glob("*.csv"), *RESULTS.glob("*.json")):
        shutil.copy(file, folder)
    return folder


@pytest.mark.parametrize("name", STUDIES)
def test_nothing_of_them_is_refused_or_made_again(
    name: str, results: Path, tmp_path: Path, capsys: Capsys
) -> None:
    assert main([name, "--jobs", "1", "--out", str(results), "--runs", str(tmp_path / "runs")]) == 0
    assert f"{name}.csv is complete: nothing was driven;" in capsys.readouterr().out
    figures = [results / f"{figure}.png" for figure in STUDIES[name].figures]
    assert all(figure.exists() for figure in figures)
    tables = [*results.glob("*.csv"), *results.glob("*.json")]
    for file in (*tables, *(figures if SAME_BYTES else ())):
        assert file.read_bytes() == (RESULTS / file.name).read_bytes(), file.name
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("name", ["opponents", "straight"])
def test_an_episode_of_each_driver_repeats_to_the_digit(
    name: str, results: Path, tmp_path: Path
) -> None:
    table = results / f"{name}.csv"
    committed = table.read_text(encoding="utf-8").splitlines()
    head = committed[0].split(",")
    of_each: dict[tuple[str, str | None], str] = {}
    for line in committed[1:]:
        row = dict(zip(head, line.split(","), strict=True))
        if row["vehicles"] != "40":  # where all crawl
            of_each[row["driver"], row.get("variant")] = line
    assert {"pretrained", "gap-mobil"} < {driver for driver, _ in of_each}
    of_each.pop(("planner", "planner"), None)  # whose search takes long to compile
    dropped = set(of_each.values())
    table.write_text("".join(f"{line}\n" for line in committed if line not in dropped))
    assert main([name, "--jobs", "1", "--out", str(results), "--runs", str(tmp_path)]) == 0
    assert table.read_text(encoding="utf-8").splitlines() == committed
