"""The tables of the documentation, and the numbers in its prose, are those of their sources."""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from runs import Capsys

ROOT = Path(__file__).parents[2]
PAGE = """Text before.
<!-- table: other -->
|  | speed, m/s | hits |
| --- | --- | --- |
| all | 19.50 | 0 |
<!-- end -->
<!-- table: mine -->
| driver | vehicles | speed, m/s |
| --- | --- | --- |
| `idm` | 5 | **20.26 ± 0.30** |
| `idm` | 10 | 18.00 |
<!-- end -->
It drives <!-- value: mine | idm | 5 | speed, m/s -->20.26 ± 0.30<!-- end --> m/s, or
<!-- mean: mine | idm | 5 | speed, m/s -->20.26<!-- end -->, about
<!-- mean.1: mine | idm | 5 | speed, m/s -->20.3<!-- end -->.
<!-- value: other | all | speed, m/s -->19.50<!-- end -->.
Write `<!-- value: A | B | C -->`.
"""
TABLE = PAGE.partition("mine -->\n")[2].partition("\n<!-- end")[0]


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """The tool with one page and one table, whose source is a file."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    module = importlib.import_module("refresh_tables")
    (tmp_path / "page.md").write_text(PAGE)
    (tmp_path / "source.csv").write_text("1")
    made: list[str] = []

    def make() -> str:
        made.append((tmp_path / "source.csv").read_text())
        return TABLE if made[-1] == "1" else TABLE.replace("20.26", "21.51")

    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "PAGES", (tmp_path / "page.md",))
    monkeypatch.setattr(module, "LOCK", tmp_path / "lock")
    other = PAGE.partition("other -->\n")[2].partition("\n<!-- end")[0]
    tables = {"mine": module.Table(make, [tmp_path / "source.csv"])}
    monkeypatch.setattr(module, "TABLES", tables | {"other": module.Table(lambda: other)})
    monkeypatch.setattr(module, "made", made, raising=False)
    return module


def run(tool: ModuleType, monkeypatch: pytest.MonkeyPatch, *words: str) -> Any:
    monkeypatch.setattr(sys, "argv", ["refresh_tables.py", *words])
    return tool.main()


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("-->20.26 ± 0.30<", "-->20.27 ± 0.30<"),
        ("-->20.26<", "-->20.25<"),
        ("-->20.3<", "-->20.2<"),
        ("**20.26", "**20.27"),
    ],
)
def test_a_wrong_number_in_prose_or_in_a_table_is_found_and_corrected(
    right: str,
    wrong: str,
    tool: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capsys,
) -> None:
    assert run(tool, monkeypatch) == run(tool, monkeypatch, "--check") == 0
    page = tmp_path / "page.md"
    assert page.read_text() == PAGE
    page.write_text(PAGE.replace(right, wrong))
    assert run(tool, monkeypatch, "--check") == 1
    assert "page.md differs from its sources" in capsys.readouterr().out
    assert run(tool, monkeypatch) == 0
    assert page.read_text() == PAGE


def test_a_table_is_made_again_only_when_a_source_changes(
    tool: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tool, monkeypatch)
    run(tool, monkeypatch, "--check")
    assert tool.made == ["1"]
    (tmp_path / "source.csv").write_text("2")
    assert run(tool, monkeypatch, "--check") == 1
    assert run(tool, monkeypatch) == 0
    assert tool.made == ["1", "2", "2"]
    faster = PAGE.replace("20.26", "21.51").replace("20.3<", "21.5<")
    assert (tmp_path / "page.md").read_text() == faster


def test_a_cell_that_does_not_exist_is_one_sentence(
    tool: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "page.md").write_text(PAGE.replace("mean: mine | idm | 5", "mean: mine | idm"))
    with pytest.raises(SystemExit, match=r"No cell is 'mine \| idm \| speed, m/s': name a table"):
        run(tool, monkeypatch)  # two rows begin with idm
