"""The cross table: which drivers meet which traffic, and the gains and the worst kind by hand."""

from pathlib import Path

import pytest
from drives import traffic_row as row

from drl_av.config import SINGLE_PRESETS
from drl_av.files import write_table
from studies import cross_table
from studies.cross_table import CROSS_TABLE, gains
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions


def test_gains_are_paired_by_seed_in_each_kind_and_the_smallest_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross_table, "SINGLE_PRESETS", ("calm", "hazards"))
    speeds = {
        ("gap-mobil", "calm"): (20.0, 22.0, 24.0),
        ("gap-mobil", "hazards"): (10.0, 10.0, 10.0),
        ("pretrained", "calm"): (23.0, 21.0, 25.0),
        ("pretrained", "hazards"): (10.0, 10.0, 10.0),
        ("cross_table-all", "calm"): (19.0, 21.0, 23.0),
        ("cross_table-all", "hazards"): (9.0, 9.5, 10.0),
    }
    rows = [
        row(*key, seed, speed, hit=key[0] == "pretrained" and seed == 3)
        for key, own in speeds.items()
        for seed, speed in zip((1, 2, 3), own, strict=True)
    ]
    # 3, -1 and 1: mean 1, standard deviation 2; Student's t for 2 degrees of freedom is 4.303
    found = gains(rows[::-1], "pretrained")
    assert found["calm"] == pytest.approx((1.0, 4.303 * 2 / 3**0.5), 1e-3)
    write_table(tmp_path / CROSS_TABLE.table, [*rows[0]], rows)
    speed, shipped, trained = CROSS_TABLE.summaries["cross_table"](
        ResultsFolder(tmp_path)
    ).splitlines()[2:]
    assert speed == "| speed of `gap-mobil` | 22.00 ± 4.97 | 10.00 ± 0.00 |  |"
    assert shipped.endswith("| 0.00 ± 0.00 | hazards: 0.00 ± 0.00 |")
    assert trained.startswith("| trained in all | -1.00 ± 0.00 | -0.50 ±")
    assert trained.endswith("| calm: -1.00 ± 0.00 |")
    hits = CROSS_TABLE.summaries["cross_table_hits"](ResultsFolder(tmp_path)).splitlines()
    assert hits[3] == "| `pretrained` | 1 / 0 of 3 | 1 / 0 of 3 |"


def test_each_driver_learns_in_its_own_traffic_and_meets_the_same_episodes(
    tmp_path: Path, short: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross_table, "TRAINED_IN", ("hazards", "all"))
    monkeypatch.setattr(cross_table, "DENSITIES", (5,))
    monkeypatch.setattr(cross_table, "DRIVES", 2)
    options = short._replace(drives=100)
    list(reproduce(CROSS_TABLE, options))
    results = ResultsFolder(tmp_path)
    rows, made = results.rows(CROSS_TABLE.table), results.made_by(CROSS_TABLE.table)["settings"]
    assert len(rows) == 6 * 5 * 2
    assert {each["seed"] for each in rows} == {"950000", "950001"}
    assert made["cross_table-hazards"]["traffic"]["standing_share"] == 0.01
    assert made["cross_table-all"]["traffic"]["presets"] == [*SINGLE_PRESETS]
    assert (tmp_path / "runs" / "cross_table-all" / "policy.safetensors").is_file()
    assert "| trained in all | " in CROSS_TABLE.summaries["cross_table"](results)
