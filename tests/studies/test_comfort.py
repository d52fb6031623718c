"""How smoothly drivers drive: the measures by hand, and which drivers meet which traffic."""

from pathlib import Path

import pytest

from drl_av.files import Row, write_table
from studies import comfort
from studies.comfort import COMFORT, DRIVERS
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions


def episode(traffic: str, driver: str, seed: int, **measured: object) -> Row:
    still: dict[str, object] = {
        "mean_speed_m_s": 20.0,
        "decisions": 200,
        "driven_m": 4000.0,
        "lane_changes": 0,
        "aborted_lane_changes": 0,
        "reversals": 0,
        "comfortable_decisions": 200,
        "short_headways": 0,
        "forced_brakes": 0,
        "collided": False,
        "ego_hit": False,
    }
    key = {"driver": driver, "traffic": traffic, "vehicles": "5", "seed": str(seed)}
    return key | {name: str(value) for name, value in (still | measured).items()}


def test_shares_are_of_all_decisions_kilometres_and_lane_changes_of_a_driver(
    tmp_path: Path,
) -> None:
    long = {"lane_changes": 3, "aborted_lane_changes": 1, "reversals": 9, "forced_brakes": 1}
    # a collision ends the second episode after 50 decisions and 1 km
    short = {"mean_speed_m_s": 10.0, "decisions": 50, "driven_m": 1000.0, "reversals": 1}
    short |= {"comfortable_decisions": 25, "short_headways": 1, "aborted_lane_changes": 1}
    rows = [
        episode("calm", "pretrained", 1, **long),
        episode("calm", "pretrained", 2, **short, collided=True, ego_hit=True),
        episode("calm", "planner", 1),
        episode("hazards", "planner", 1, reversals=8, mean_speed_m_s=10.0),
    ]
    write_table(tmp_path / COMFORT.table, [*rows[0]], rows)
    lines = COMFORT.summaries["comfort"](ResultsFolder(tmp_path)).splitlines()[2:]
    # 10 reversals in 5 km; 2 aborts of 5; 225 and 1 of 250 decisions; 1 of 250 is 4 of 1,000
    measured = "15.00 | 2.0 | 40 | 90.0 | 0.40 | 4.0 | 1 / 0 of 2 |"
    assert lines == [
        f"| calm | `pretrained` | {measured}",
        "| calm | `planner` | 20.00 | 0.0 | 0 | 100.0 | 0.00 | 0.0 | 0 / 0 of 1 |",
        "| hazards | `planner` | 10.00 | 2.0 | 0 | 100.0 | 0.00 | 0.0 | 0 / 0 of 1 |",
        f"| all | `pretrained` | {measured}",
        "| all | `planner` | 15.00 | 1.0 | 0 | 100.0 | 0.00 | 0.0 | 0 / 0 of 2 |",
    ]


def test_all_drive_the_same_traffic_under_strict_each_with_its_own_margins(
    tmp_path: Path, short: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comfort, "SINGLE_PRESETS", ("calm", "hazards"))
    monkeypatch.setattr(comfort, "DENSITIES", (5,))
    monkeypatch.setattr(comfort, "DRIVES", 1)
    list(reproduce(COMFORT, short))
    results = ResultsFolder(tmp_path)
    rows = results.rows(COMFORT.table)
    assert [(each["traffic"], each["seed"], each["driver"]) for each in rows] == [
        (kind, "970000", driver) for kind in ("calm", "hazards") for driver in DRIVERS
    ]
    settings = results.made_by(COMFORT.table)["settings"]
    assert settings["calm"]["safety"]["check"] == "strict"
    assert settings["hazards"]["traffic"]["standing_share"] > 0
    driven = {each["driver"]: each["driven_m"] for each in rows if each["traffic"] == "calm"}
    assert driven["pretrained"] != driven["pretrained-smooth"]
