"""Drivers in other settings: a table each, with what made it."""

from pathlib import Path

import pytest

from drl_av.config import Config
from studies import variations
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions
from studies.variations import (
    BARRICADE_PRETRAINED,
    CHECK_PAPER,
    CHECK_PERMIT_ALL,
    EXACT_SPEED,
    REFERENCE_ACC,
)

ROWS = {CHECK_PAPER: 2, CHECK_PERMIT_ALL: 4, REFERENCE_ACC: 8, EXACT_SPEED: 2}
"""Two episodes of each driver."""


def test_each_is_driven_in_its_own_settings(
    tmp_path: Path, short: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(variations, "DENSITIES", (2,))
    rows, made = {}, {}
    for experiment in (*ROWS, BARRICADE_PRETRAINED):
        list(reproduce(experiment, short))
        rows[experiment] = ResultsFolder(tmp_path).rows(experiment.table)
        made[experiment] = ResultsFolder(tmp_path).made_by(experiment.table)
        assert made[experiment]["settings"]["simulation"]["decisions_per_episode"] == 5
    assert {experiment: len(rows[experiment]) for experiment in ROWS} == ROWS
    assert {row["safety_check"] for row in rows[CHECK_PERMIT_ALL]} == {"permit_all"}
    for paper in (REFERENCE_ACC, EXACT_SPEED, BARRICADE_PRETRAINED):
        found = {row["driver"]: row["safety_check"] for row in rows[paper]}
        assert found["pretrained"] == "paper"  # and not strict, its default
    assert {row["vehicles"] for row in rows[BARRICADE_PRETRAINED]} == {"15"}
    assert made[REFERENCE_ACC]["settings"]["ego"]["acc_gap_gain_per_s"] == 0.125
    assert made[EXACT_SPEED]["settings"]["reward"]["speed_tolerance_m_s"] == 0
    places = {made[e]["settings"]["simulation"]["scenario"] for e in ROWS}
    assert places == {Config().simulation.scenario}
    closed = made[BARRICADE_PRETRAINED]
    assert closed["settings"]["simulation"]["scenario"] == "barricaded_right_lane"
    assert "policy_sha256" not in made[CHECK_PAPER]
    assert len(closed["policy_sha256"]) == 64
