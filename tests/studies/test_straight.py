"""Speed against flow on a straight highway: the flows, the means by hand, and the episodes."""

from pathlib import Path

import pytest

from drl_av.files import Row, write_table
from studies import straight
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions
from studies.straight import DRIVERS, STRAIGHT, vehicles_at


def test_a_flow_is_speed_times_density() -> None:
    """1,000 vehicles/h at 20 m/s are one each 72 m; three lanes of 2,550 m hold 106 of them."""
    assert vehicles_at(0) == 0
    assert vehicles_at(1000) == 106
    assert vehicles_at(500) == 53


def episode(driver: str, flow: int, seed: int, speed: float, **ended: bool) -> Row:
    cells = {"driver": driver, "flow_per_h": flow, "vehicles": 7, "seed": seed, "decisions": 90}
    cells |= {"mean_speed_m_s": speed, "collided": False, "ego_hit": False} | ended
    return {name: str(value) for name, value in cells.items()}


def test_the_table_has_each_driver_s_mean_speed_at_each_flow(tmp_path: Path) -> None:
    rows = [
        episode("planner", 0, 1, 30.0),
        episode("sumo", 0, 1, 28.0),
        episode("sumo", 0, 2, 28.0),
        episode("planner", 500, 1, 25.0, collided=True, ego_hit=True),
        episode("sumo", 500, 1, 21.0),
        episode("sumo", 500, 2, 23.0),
    ]
    write_table(tmp_path / STRAIGHT.table, [*rows[0]], rows)
    lines = STRAIGHT.summaries["straight"](ResultsFolder(tmp_path)).splitlines()
    assert lines[0] == "| driver | 0 | 500 | ego hit something / was hit |"
    [planner, sumo] = (line.split(" | ") for line in lines[2:])
    assert (planner[0], planner[-1]) == ("| `planner`", "1 / 0 of 2 |")
    assert sumo[1] == "28.00 ± 0.00"
    assert sumo[2].startswith("22.00 ± ")
    assert sumo[3] == "0 / 0 of 4 |"


def test_a_gain_over_gap_mobil_is_paired_by_seed(tmp_path: Path) -> None:
    """The two gain 1 and 2 m/s, although the traffic of seed 2 is 10 m/s slower."""
    rows = [
        episode("planner", 500, 1, 26.0),
        episode("gap-mobil", 500, 1, 25.0),
        episode("planner", 500, 2, 17.0),
        episode("gap-mobil", 500, 2, 15.0),
    ]
    write_table(tmp_path / STRAIGHT.table, [*rows[0]], rows)
    header, _, line = STRAIGHT.summaries["straight_gain"](ResultsFolder(tmp_path)).splitlines()
    assert header == "| driver | 500 |"
    assert line.startswith("| `planner` | 1.50 ± ")


def test_all_drive_the_same_traffic_under_strict(
    tmp_path: Path, short: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(straight, "FLOWS_PER_H", (0, 250))
    monkeypatch.setattr(straight, "DRIVES", 1)
    list(reproduce(STRAIGHT, short))
    results = ResultsFolder(tmp_path)
    rows = results.rows(STRAIGHT.table)
    assert [(each["flow_per_h"], each["vehicles"], each["driver"]) for each in rows] == [
        (flow, number, driver) for flow, number in (("0", "0"), ("250", "27")) for driver in DRIVERS
    ]
    settings = results.made_by(STRAIGHT.table)["settings"]["straight"]
    assert settings["safety"]["check"] == "strict"
    assert settings["simulation"]["scenario"] == "straight"
    alone = {row["driver"]: float(row["mean_speed_m_s"]) for row in rows if row["vehicles"] == "0"}
    assert alone["planner"] == pytest.approx(alone["gap-mobil"], abs=0.1)  # the road is empty
    assert (tmp_path / "straight.png").stat().st_size > 10_000
