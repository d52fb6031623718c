"""What ``strict`` costs, as an experiment of ``drl-av reproduce``, and its figure."""

import json
from pathlib import Path
from typing import Any

import pytest

from drl_av.errors import DrlAvError
from drl_av.experiments import strictness as module
from drl_av.experiments.options import Scale
from drl_av.experiments.strictness_figure import change, strictness_figure
from drl_av.experiments.tables import read_rows


def test_both_checks_meet_the_same_traffic_and_what_is_there_is_not_driven_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "DENSITIES", (2,))
    monkeypatch.setattr(module, "VEHICLES", 2)
    monkeypatch.setattr(module, "BOUNDS", {"clearance_m": (2.0,)})
    scale = Scale(out=tmp_path, drives=2, jobs=1)
    told = list(module.strictness(scale))
    # two episodes each of: paper, strict, and strict with 2 m of clearance
    assert [step.done for step in told] == [1, 2, 3, 4, 5, 6]
    assert told[-1].total == 6
    rows = read_rows(tmp_path / "strict.csv")
    cells = [(row["check"], row["bound"], row["value"], row["seed"]) for row in rows]
    assert cells == [
        *(("paper", "", "", "0"), ("paper", "", "", "1")),
        *(("strict", "", "", "0"), ("strict", "", "", "1")),
        *(("strict", "clearance_m", "2", "0"), ("strict", "clearance_m", "2", "1")),
    ]
    assert json.loads((tmp_path / "strict.json").read_text())["seeds"] == "0 to 1"
    assert list(module.strictness(scale)) == []
    more = list(module.strictness(scale._replace(drives=3)))
    assert [step.done for step in more] == [3, 6, 9]  # the third episode of each
    assert len(read_rows(tmp_path / "strict.csv")) == 9
    density, bounds = strictness_figure(tmp_path / "strict.csv").axes
    assert density.get_title() == "the check as it is"
    assert bounds.get_legend_handles_labels()[1] == ["clearance"]


def test_a_table_of_other_columns_is_left_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "cells", lambda: [module.Cell("paper", "", "", 1)])
    scale = Scale(out=tmp_path, drives=1, jobs=1)
    list(module.strictness(scale))
    monkeypatch.setattr(module, "OUTCOME", ("seed", "collided"))
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(DrlAvError, match=r"strict\.csv was made with other settings"):
        list(module.strictness(scale._replace(drives=2)))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == kept


def drives(check: str, *speeds: float) -> list[dict[str, Any]]:
    return [
        {"check": check, "bound": "", "vehicles": 5, "seed": seed, "mean_speed_m_s": speed}
        for seed, speed in enumerate(speeds)
    ]


def test_the_cost_is_paired_by_seed_and_told_in_percent_of_the_speed_without() -> None:
    rows = drives("paper", 20.0, 30.0) + drives("strict", 19.0, 29.0)
    # 1 m/s less in either traffic, of 25 m/s
    found = change(rows, rows, 5)
    assert found.value == pytest.approx(-4.0)
    assert found.half_width == pytest.approx(0.0)


def test_other_seeds_are_not_compared() -> None:
    rows = drives("paper", 20.0, 30.0) + drives("strict", 19.0)
    with pytest.raises(DrlAvError, match="not of the same seeds"):
        change(rows, rows, 5)
