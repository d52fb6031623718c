"""The speed that ``strict`` costs: both checks in the same traffic, compared seed by seed."""

from pathlib import Path

import pytest
from drives import rows_of

from studies import strictness
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions
from studies.strictness import STRICT, change, strict_figure


def test_both_checks_meet_the_same_traffic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strictness, "DENSITIES", (2,))
    monkeypatch.setattr(strictness, "VEHICLES", 2)
    monkeypatch.setattr(strictness, "BOUNDS", {"clearance_m": (2.0,)})
    options = ReproduceOptions(out=tmp_path, drives=2, jobs=1)
    steps = [step for step in reproduce(STRICT, options) if step.label]
    # two episodes each of: paper, strict, and strict with 2 m of clearance
    assert [(step.done, step.total) for step in steps] == [(n, 6) for n in range(1, 7)]
    rows = ResultsFolder(tmp_path).rows("strict.csv")
    assert [(row["check"], row["bound"], row["value"], row["seed"]) for row in rows] == [
        *(("paper", "", "", "0"), ("paper", "", "", "1")),
        *(("strict", "", "", "0"), ("strict", "", "", "1")),
        *(("strict", "clearance_m", "2", "0"), ("strict", "clearance_m", "2", "1")),
    ]
    density, bounds = strict_figure(rows).axes
    assert density.get_title() == "the check as it is"
    assert bounds.get_legend_handles_labels()[1] == ["clearance"]


def test_the_cost_is_paired_by_seed_in_percent_of_the_speed_without() -> None:
    rows = rows_of(
        """check,vehicles,seed,mean_speed_m_s
        paper,5,0,20 paper,5,1,30 strict,5,0,19 strict,5,1,29"""
    )
    # 1 m/s less in either traffic, of 25 m/s
    found = change(rows, rows, 5)
    assert found.value == pytest.approx(-4.0)
    assert found.half_width == pytest.approx(0.0)
