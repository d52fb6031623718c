"""Drivers in other settings: a table each, with what made it, driven once."""

import json
from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.experiments import variations as module
from drl_av.experiments.options import Scale
from drl_av.experiments.tables import read_rows


def test_each_is_driven_once_in_its_own_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = [variation._replace(densities=(2,)) for variation in module.VARIATIONS]
    monkeypatch.setattr(module, "VARIATIONS", small)
    (tmp_path / "short.toml").write_text("[simulation]\ndecisions_per_episode = 5\n")
    scale = Scale(out=tmp_path, drives=2, jobs=1, config=str(tmp_path / "short.toml"))
    told = list(module.variations(scale))
    # two episodes each of the drivers of every table, 1 + 2 + 4 + 1 + 1
    assert [step.done for step in told] == list(range(1, 19))
    assert {step.total for step in told} == {18}
    found = {file.name: read_rows(file) for file in tmp_path.glob("*.csv")}
    assert {name: len(rows) for name, rows in found.items()} == {
        "check_paper.csv": 2,
        "check_permit_all.csv": 4,
        "reference_acc.csv": 8,
        "exact_speed.csv": 2,
        "barricade_pretrained.csv": 2,
    }
    assert {row["safety_check"] for row in found["check_permit_all.csv"]} == {"permit_all"}
    made = {name: json.loads((tmp_path / name).with_suffix(".json").read_text()) for name in found}
    assert made["reference_acc.csv"]["settings"]["ego"]["acc_gap_gain_per_s"] == 0.125
    assert made["reference_acc.csv"]["settings"]["simulation"]["decisions_per_episode"] == 5
    assert made["exact_speed.csv"]["settings"]["reward"]["speed_tolerance_m_s"] == 0
    places = {name: facts["settings"]["simulation"]["scenario"] for name, facts in made.items()}
    assert places.pop("barricade_pretrained.csv") == "barricaded_right_lane"
    assert set(places.values()) == {Config().simulation.scenario}
    assert "policy_sha256" not in made["check_paper.csv"]
    assert len(made["barricade_pretrained.csv"]["policy_sha256"]) == 64
    assert list(module.variations(scale)) == []
