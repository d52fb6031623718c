"""The planner beside its opponents: who drives in which settings, and the gains by hand."""

from pathlib import Path

import pytest

from drl_av.files import Row, write_table
from studies import opponents
from studies.experiment import ResultsFolder, reproduce
from studies.opponents import OPPONENTS_SWEEP, VARIANTS, best_opponent, gain, speeds
from studies.options import ReproduceOptions


def row(driver: str, seed: int, speed: float, variant: str = "paper") -> Row:
    return {
        "driver": driver,
        "variant": variant,
        "vehicles": "10",
        "seed": str(seed),
        "mean_speed_m_s": str(speed),
    }


def test_the_gain_is_over_the_fastest_opponent_and_paired_by_seed() -> None:
    found = speeds(
        [
            *(row("planner", seed, speed) for seed, speed in ((1, 25.0), (2, 21.0), (3, 23.0))),
            *(row("sumo", seed, speed) for seed, speed in ((3, 23.0), (1, 20.0), (2, 20.0))),
            *(row("idm-mobil", seed, 22.0, "acc") for seed in (1, 2, 3)),
            *(row("pretrained", seed, 30.0, "strict") for seed in (1, 2, 3)),  # no opponent
        ]
    )
    assert best_opponent(found) == "idm-mobil, acc"
    # 3, -1 and 1: mean 1, standard deviation 2; Student's t for 2 degrees of freedom is 4.303
    assert gain(found["planner"], found["idm-mobil, acc"]) == pytest.approx(
        (1.0, 4.303 * 2 / 3**0.5), 1e-3
    )
    assert gain(found["planner"], found["sumo"]).value == pytest.approx(2.0)


def test_the_statistics_are_those_of_the_middle_densities_beside_the_best_opponent(
    tmp_path: Path,
) -> None:
    speeds = {
        "planner": (24.0, 25.0, 1.0),
        "sumo": (24.0, 20.0, 30.0),
        "gap-mobil": (10.0, 11.0, 30.0),
    }
    rows = [
        row(driver, seed, speed) | {"traffic": "calm", "vehicles": vehicles}
        for driver, own in speeds.items()
        for seed, vehicles, speed in zip((1, 2, 1), ("5", "5", "40"), own, strict=True)
    ]
    write_table(tmp_path / OPPONENTS_SWEEP.table, [*rows[0]], rows)
    lines = OPPONENTS_SWEEP.summaries["opponents_aggregate"](ResultsFolder(tmp_path)).splitlines()
    # of two speeds none is an outer quarter; 24 ties with 24, the other three pairs are won
    assert lines[2].startswith("| calm | `planner` | 24.50 [24.00, 25.00] | 0.88 [")
    assert lines[3:] == [
        "| calm | `sumo` | 22.00 [20.00, 24.00] |  |",
        "| calm | `gap-mobil` | 10.50 [10.00, 11.00] | 0.00 [0.00, 0.00] |",
    ]


def test_a_gain_is_that_of_the_episodes_that_both_drove() -> None:
    found = speeds(
        [
            *(row("planner", seed, speed, "search") for seed, speed in ((1, 25.0), (2, 21.0))),
            *(row("sumo", seed, speed) for seed, speed in ((1, 20.0), (2, 20.0), (3, 90.0))),
            *(row("gap-mobil", seed, 40.0) for seed in (1, 2, 3)),
        ]
    )
    assert best_opponent(found) == "sumo"  # 43.3 m/s over all its episodes, 20 in those of both
    assert gain(found["planner"], found["sumo"]).value == pytest.approx(3.0)


def test_under_strict_our_drivers_are_compared_with_the_rule_under_strict(tmp_path: Path) -> None:
    rows = [
        row(driver, seed, speed, variant) | {"traffic": "calm", "vehicles": vehicles}
        for driver, variant, speed in (
            ("gap-mobil", "paper", 29.0),
            ("gap-mobil", "rule", 20.0),
            ("pretrained", "paper", 28.0),
            ("planner", "search_strict", 21.0),
        )
        for seed, vehicles in ((1, "5"), (2, "5"), (1, "40"), (2, "40"))
    ]
    write_table(tmp_path / OPPONENTS_SWEEP.table, [*rows[0]], rows)
    lines = OPPONENTS_SWEEP.summaries["opponents_same_check"](ResultsFolder(tmp_path)).splitlines()
    gains = " | ".join(["1.00 ± 0.00"] * 3)
    assert lines[2:] == [f"| calm | `planner, strict` | {gains} |"]


def test_every_driver_drives_the_same_seeds_in_its_own_settings(
    tmp_path: Path, short: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opponents, "VEHICLES", (5,))
    few = {name: each._replace(episodes=1) for name, each in VARIANTS.items() if name == "search"}
    monkeypatch.setattr(opponents, "VARIANTS", VARIANTS | few)
    monkeypatch.setattr(opponents, "SINGLE_PRESETS", ("calm", "naturalistic"))
    list(reproduce(OPPONENTS_SWEEP, short))
    results = ResultsFolder(tmp_path)
    rows, made = results.rows("opponents.csv"), results.made_by("opponents.csv")["settings"]
    assert [(each["traffic"], each["variant"], each["driver"], each["seed"]) for each in rows] == [
        (kind, name, driver, str(seed))
        for kind in ("calm", "naturalistic")
        for seed in (910000, 910001)
        for name, each in VARIANTS.items()
        for driver in each.drivers
        if (name, seed) != ("search", 910001)
    ]
    checks = {(each["variant"], each["driver"]): each["safety_check"] for each in rows}
    assert checks["strict", "pretrained"] == "strict"
    assert checks["smooth", "pretrained-smooth"] == checks["rule", "gap-mobil"] == "strict"
    margins = {name: made[f"calm, {name}"]["learning"]["abort_margin"] for name in VARIANTS}
    assert margins == dict.fromkeys(VARIANTS, 0.0) | {"smooth": 0.3}
    assert checks["acc", "idm-sumo"] == checks["search", "planner"] == "paper"
    assert checks["paper", "sumo-tuned"] == "none"
    assert made["naturalistic, acc"]["ego"]["longitudinal_reference"] == "acc"
    assert (
        made["naturalistic, acc"]["traffic"]["truck_share"]
        > made["calm, acc"]["traffic"]["truck_share"]
    )
    assert (tmp_path / "opponents.png").is_file()
    for table in OPPONENTS_SWEEP.summaries.values():
        assert "| naturalistic | `pretrained, strict` | " in table(results)
