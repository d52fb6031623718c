"""The paper as printed: each point alone and all together, on the same traffic."""

from pathlib import Path

import pytest

from drl_av.config.presets import preset
from studies import literal
from studies.experiment import ResultsFolder, reproduce
from studies.literal import LITERAL_PAPER, VARIANTS, changed, literal_table
from studies.options import ReproduceOptions


def test_each_variant_is_driven_on_the_same_traffic_with_its_own_settings(
    tmp_path: Path, short: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(literal, "DENSITIES", (2,))
    list(reproduce(LITERAL_PAPER, short))
    rows = ResultsFolder(tmp_path).rows("literal.csv")
    assert len(rows) == 3 * 7 * 2
    for variant in VARIANTS:
        own = [(row["driver"], row["seed"]) for row in rows if row["variant"] == variant]
        assert own == [(driver, seed) for seed in "01" for driver in literal.DRIVERS]
    settings = ResultsFolder(tmp_path).made_by("literal.csv")["settings"]
    switched = {
        variant: [rule for rule in ("rule_1", "rule_3", "idm") if own["safety"][f"printed_{rule}"]]
        for variant, own in settings.items()
    }
    assert switched == {
        "ours": [],
        "rule 1": ["rule_1"],
        "rule 3": ["rule_3"],
        "IDM rule": ["idm"],
        "exact v_des": [],
        "v_des of the best lane": [],
        "literal": ["rule_1", "rule_3", "idm"],
    }
    rewards = {variant: settings[variant]["reward"] for variant in [*VARIANTS][-3:]}
    ours = settings["ours"]["reward"]["speed_tolerance_m_s"]
    assert {
        variant: (own["desired"], own["speed_tolerance_m_s"]) for variant, own in rewards.items()
    } == {
        "exact v_des": ("traffic", 0.0),
        "v_des of the best lane": ("best-lane", 0.0),
        "literal": ("best-lane", 0.0),
    }
    assert ours > 0.0


def test_the_preset_literal_is_the_paper_with_all_of_them() -> None:
    assert preset("literal") == changed(preset("paper"), VARIANTS["literal"]) != preset("paper")


def test_the_table_has_the_change_from_ours_paired_by_traffic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(literal, "DRIVERS", ("idm",))
    monkeypatch.setattr(literal, "VARIANTS", {"ours": {}, "rule 1": {}})
    (tmp_path / "literal.csv").write_text(
        "variant,driver,vehicles,seed,mean_speed_m_s,mean_reward,safety_triggers,ego_hit\n"
        "ours,idm,5,0,21,-0.2,0,True\nours,idm,30,0,11,-0.4,1,False\n"
        "rule 1,idm,30,0,10,-0.1,4,False\nrule 1,idm,5,0,20,-0.1,5,True\n"
    )
    _, _, *lines = literal_table(ResultsFolder(tmp_path)).splitlines()
    assert lines == [
        "| `idm` | ours | 16.00 | 0.00 ± 0.00 | -0.300 | 0.5 | 1 of 2 |",
        "| `idm` | rule 1 | 15.00 | -1.00 ± 0.00 | -0.100 | 4.5 | 1 of 2 |",
    ]
