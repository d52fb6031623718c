"""The report of the long run names each broken bound with its driver and its cause."""

import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from drl_av.errors import DrlAvError
from studies.options import RESULTS
from verification.auditor import BEHIND, BRAKES, CUT_IN, SOONER
from verification.long_run import approaches, main, report

ROW = dict.fromkeys(("collision", "other", "broken_bounds", "all_breaches"), "") | {
    **{"seed": "800000", "vehicles": "3", "mix": "sumo", "decisions": "200", "ego_hit": "False"},
    **{"cut_ins": "2", "least_cut_in_margin_m": "1.5"},
}


def test_breaches_of_a_vehicle_within_2_s_are_one_approach_with_the_circumstance_of_the_first() -> (
    None
):
    cell = f"{BEHIND}|sumo|vehicle1|10|{BRAKES}; {BEHIND}|sumo|vehicle1|10.5|; "
    cell += f"{BEHIND}|sumo|vehicle1|20|; {CUT_IN}|level_1|vehicle2|10|{SOONER}"
    assert approaches(cell) == [
        (BEHIND, "sumo", 2, BRAKES),
        (BEHIND, "sumo", 1, ""),
        (CUT_IN, "level_1", 1, SOONER),
    ]
    assert approaches("") == []


@pytest.mark.parametrize(("circumstance", "status"), [(BRAKES, 0), ("", 1)])
def test_a_broken_bound_without_a_known_cause_is_a_failure(
    circumstance: str, status: int, capsys: Any
) -> None:
    broken = ROW | {"all_breaches": f"{BEHIND}|sumo|vehicle1|10|{circumstance}"}
    assert report([ROW, broken]) == status
    out = capsys.readouterr().out
    assert "bounds broken 1 times, in 1 episodes:" in out
    cause = "no known cause" if status else "SUMO's IDM, which limits every driver, keeps a time"
    assert f"  {BEHIND}, sumo: 1 times in 1 approaches: {cause}" in out


def test_an_ego_that_hits_or_is_hit_by_one_that_keeps_the_bounds_is_a_failure() -> None:
    assert report([ROW]) == 0
    hit = ROW | {"collision": "ego was hit from behind", "other": "vehicle1"}
    assert report([hit]) == 1
    assert report([hit | {"broken_bounds": BEHIND}]) == 0
    assert report([hit | {"ego_hit": "True", "broken_bounds": BEHIND}]) == 1


def test_a_table_of_other_traffic_or_of_another_program_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["long_run", "--episodes", "1", "--out", str(tmp_path / "t.csv")]
    monkeypatch.setattr(sys, "argv", words)
    assert main() == 0
    monkeypatch.setattr(sys, "argv", [*words, "--traffic", "calm"])
    with pytest.raises(DrlAvError, match=r"t\.csv was made with other settings"):
        main()
    for suffix in (".csv", ".json"):
        shutil.copy((RESULTS / "shielding").with_suffix(suffix), tmp_path)
    monkeypatch.setattr(sys, "argv", [*words[:-1], str(tmp_path / "shielding.csv")])
    with pytest.raises(DrlAvError, match=r"shielding\.csv was made with other settings"):
        main()
