"""Mean speeds: driven once, to the density where the drivers meet; driven anew for a new policy."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drl_av.errors import DrlAvError
from drl_av.experiments import density_sweep as module
from drl_av.experiments import driven
from drl_av.experiments.density_sweep import speeds
from drl_av.experiments.driven import DrivenTable
from drl_av.experiments.options import Scale
from drl_av.experiments.provenance import write_sidecar
from drl_av.experiments.tables import read_rows

SETTINGS = """
[simulation]
decisions_per_episode = 10
[traffic]
start_gap_m = 30.0
"""


@pytest.fixture
def scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scale:
    """Two densities of the tables, on a road that takes 41 vehicles and the ego."""
    monkeypatch.setattr(module, "DENSITIES", (1, 30))
    (tmp_path / "settings.toml").write_text(SETTINGS)
    return Scale(drives=2, jobs=1, out=tmp_path, config=str(tmp_path / "settings.toml"))


def densities(folder: Path) -> list[str]:
    return list(dict.fromkeys(row["vehicles"] for row in read_rows(folder / "evaluation.csv")))


def never_met(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.Paired, "lower_m_s", property(lambda gain: 1.0))


def test_goes_on_to_a_full_road_where_the_drivers_do_not_meet(
    scale: Scale, monkeypatch: pytest.MonkeyPatch
) -> None:
    never_met(monkeypatch)
    told = list(speeds(scale))
    assert densities(scale.out) == ["1", "30", "35", "40"]
    rows = read_rows(scale.out / "evaluation.csv")
    assert len({(r["driver"], r["vehicles"], r["seed"]) for r in rows}) == len(rows) == 4 * 4 * 2
    assert [row["vehicles"] for row in read_rows(scale.out / "paired.csv")][::3] == densities(
        scale.out
    )
    assert told[-1].done == told[-1].total == 32
    assert "40 vehicles: pretrained gains" in told[-1].line
    facts = json.loads((scale.out / "evaluation.json").read_text())
    assert (facts["seeds"], facts["step_length_s"]) == ("0 to 1", 0.5)


def test_stops_where_they_meet_and_drives_nothing_twice(
    scale: Scale, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module.Paired, "lower_m_s", property(lambda gain: 0.0))
    list(speeds(scale))
    assert densities(scale.out) == ["1", "30"]
    before = (scale.out / "evaluation.csv").read_bytes()
    counts: list[int] = []
    rows = driven.Evaluation.rows

    def counted(evaluation: Any, jobs: int) -> Iterator[Any]:
        counts.append(len(evaluation))
        return rows(evaluation, jobs)

    monkeypatch.setattr(driven.Evaluation, "rows", counted)
    list(speeds(scale))
    assert not counts
    list(speeds(scale._replace(drives=3)))
    assert counts == [4, 4]  # four drivers on the third seed
    whole = (scale.out / "evaluation.csv").read_bytes()
    assert before != whole
    # fewer are there already
    list(speeds(scale))
    assert counts == [4, 4]
    assert json.loads((scale.out / "evaluation.json").read_text())["seeds"] == "0 to 2"
    monkeypatch.setattr(driven, "checksum", lambda file: "that of another policy")
    with pytest.raises(DrlAvError, match=r"evaluation\.csv was made with .* another driver"):
        list(speeds(scale))
    assert (scale.out / "evaluation.csv").read_bytes() == whole


def test_a_row_that_is_lost_is_told(scale: Scale, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.Paired, "lower_m_s", property(lambda gain: 0.0))
    list(speeds(scale))
    table = scale.out / "evaluation.csv"
    header, _, *rest = table.read_text().splitlines(keepends=True)
    table.write_text("".join([header, *rest]))
    before = table.read_bytes()
    with pytest.raises(DrlAvError, match=r"evaluation\.csv, .* damaged or of another version"):
        list(speeds(scale._replace(drives=3)))
    assert table.read_bytes() == before


def test_a_table_that_nobody_says_how_it_was_made_is_left_alone(scale: Scale) -> None:
    text = "driver,vehicles,seed\nidm,1,0\n"
    (scale.out / "evaluation.csv").write_text(text)
    with pytest.raises(DrlAvError, match=r"has no evaluation\.json beside it"):
        list(speeds(scale))
    assert (scale.out / "evaluation.csv").read_text() == text


@pytest.mark.parametrize("harm", ["a column", "a number", "the time"])
def test_a_damaged_table_is_told_in_one_sentence_and_kept(scale: Scale, harm: str) -> None:
    config = scale.over(module.default_config(module.find_drivers(["pretrained"])))
    table = DrivenTable(scale, "evaluation.csv", config, module.find_drivers(["pretrained"]))
    facts = table.facts()
    if harm == "the time":
        del facts["wall_time_s"]
    write_sidecar(scale.out / "evaluation.csv", facts)
    rows = {"a column": "driver,vehicles\nidm,1\n", "a number": "driver,vehicles\nidm,x\n"}
    text = rows.get(harm, "driver\n")
    (scale.out / "evaluation.csv").write_text(text)
    with pytest.raises(DrlAvError, match=r"evaluation\.csv, .* damaged or of another version"):
        list(speeds(scale))
    assert (scale.out / "evaluation.csv").read_text() == text
