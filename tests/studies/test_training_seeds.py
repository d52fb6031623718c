"""Trainings of the shipped driver with several seeds: what is planned, and the tables."""

from pathlib import Path

import pytest
from drives import traffic_row as row

from drl_av.files import write_table
from studies import training_seeds
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions
from studies.training_seeds import TRAINING_SEEDS


def test_the_tables_have_a_line_for_each_seed_with_its_worst_kind(tmp_path: Path) -> None:
    kinds = ("calm", "paper", "overtaking", "naturalistic", "hazards")
    gains = {
        "gap-mobil": dict.fromkeys(kinds, 0.0),
        "pretrained": dict.fromkeys(kinds, 0.5) | {"calm": 0.25},
        "seed 0": dict.fromkeys(kinds, -0.5) | {"hazards": -2.0},
        "seed 1": dict.fromkeys(kinds, 1.0) | {"paper": 0.75},
    }
    rows = [
        row(
            driver, kind, seed, 20 + seed + gain, hit=(driver, kind, seed) == ("seed 1", "paper", 2)
        )
        for driver, by_kind in gains.items()
        for kind, gain in by_kind.items()
        for seed in (1, 2, 3)
    ]
    write_table(tmp_path / TRAINING_SEEDS.table, [*rows[0]], rows)
    results = ResultsFolder(tmp_path)
    tables = {name: make(results) for name, make in TRAINING_SEEDS.summaries.items()}
    reference, shipped, first, second = tables["training_seeds"].splitlines()[2:]
    # 21, 22 and 23: mean 22, standard deviation 1; Student's t 4.303 / sqrt(3) = 2.48
    assert reference.startswith("| speed of `gap-mobil` | 22.00 ± 2.48 | 22.00 ± 2.48 |")
    assert shipped.endswith("| 0.50 ± 0.00 | calm: 0.25 ± 0.00 |")
    assert first.endswith("| -2.00 ± 0.00 | hazards: -2.00 ± 0.00 |")
    assert second == (
        "| seed 1 | 1.00 ± 0.00 | 0.75 ± 0.00 | 1.00 ± 0.00 | 1.00 ± 0.00 | 1.00 ± 0.00 "
        "| paper: 0.75 ± 0.00 |"
    )
    hits = tables["training_seeds_hits"].splitlines()[2:]
    assert hits[0].startswith("| `gap-mobil` | 0 / 0 of 3 | 0 / 0 of 3 |")
    assert hits[3].startswith("| seed 1 | 0 / 0 of 3 | 1 / 0 of 3 | 0 / 0 of 3 |")


def test_each_seed_trains_under_paper_and_all_drive_the_same_episodes_under_strict(
    tmp_path: Path, short: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training_seeds, "DENSITIES", (5,))
    monkeypatch.setattr(training_seeds, "DRIVES", 2)
    options = short._replace(seeds=2, drives=100)
    list(reproduce(TRAINING_SEEDS, options))
    results = ResultsFolder(tmp_path)
    rows, made = results.rows(TRAINING_SEEDS.table), results.made_by(TRAINING_SEEDS.table)
    drivers = ["gap-mobil", "pretrained", "seed 0", "seed 1"]
    assert list(dict.fromkeys(row["driver"] for row in rows)) == drivers
    assert len(rows) == 4 * 5 * 2
    assert {each["seed"] for each in rows} == {"960000", "960001"}
    settings = made["settings"]
    checks = ["strict", "strict", "paper", "paper"]
    assert [settings[name]["safety"]["check"] for name in drivers] == checks
    assert [settings[f"seed {seed}"]["learning"]["seed"] for seed in (0, 1)] == [0, 1]
