"""The cost of ``strict`` with the bounds of real traffic, from rows worked by hand."""

from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.files import write_table
from studies import real_bounds
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions
from studies.real_bounds import (
    REAL_BOUNDS,
    cost,
    real_bounds_figure,
    real_bounds_table,
)
from studies.strictness import under

SHORT = """
[simulation]
decisions_per_episode = 4
[learning]
episodes = 2
evaluate_every = 2
evaluation_episodes = 1
"""


def drives(driver: str, bounds: str, *speeds: float, hits: int = 0) -> list[dict[str, str]]:
    return [
        {"driver": driver, "bounds": bounds, "vehicles": "5", "seed": str(920_000 + number)}
        | {"mean_speed_m_s": str(speed), "collided": str(number < hits), "ego_hit": "False"}
        for number, speed in enumerate(speeds)
    ]


PLAIN = drives("pretrained", "paper", 20.0, 30.0)


def test_real_traffic_brakes_and_moves_sideways_harder_than_ours() -> None:
    assert under(Config(), "paper").safety.check == "paper"
    ours, real = under(Config(), "strict"), under(Config(), "real")
    assert (ours.safety.check, real.safety.check) == ("strict", "strict")
    assert (ours.strict.braking_m_s2, ours.strict.lateral_speed_m_s) == (4.0, 0.76)
    assert (real.strict.braking_m_s2, real.strict.lateral_speed_m_s) == (9.0, 2.1)


def test_the_cost_is_paired_by_traffic_and_for_several_drivers_their_mean() -> None:
    rows = PLAIN + drives("pretrained", "real", 19.0, 29.0)
    # 1 m/s less in both traffics, of 25 m/s
    assert cost(rows, "pretrained", "real", 5).value == pytest.approx(-4.0)
    rows += drives("real_bounds-0", "real", 22.0, 30.0) + drives("real_bounds-1", "real", 21, 31)
    # both gain 1 m/s on the mean: 4 % each, whatever the traffic gave to either
    found = cost(rows, "trained", "real", 5)
    assert (found.value, found.half_width) == (pytest.approx(4.0), pytest.approx(0.0))


def test_drivers_of_other_traffic_are_not_compared() -> None:
    with pytest.raises(DrlAvError, match="not of the same seeds"):
        cost(PLAIN + drives("pretrained", "real", 19.0), "pretrained", "real", 5)


def test_the_table_has_a_line_for_each_driver_that_was_driven(tmp_path: Path) -> None:
    rows = PLAIN + drives("pretrained", "real", 19.0, 29.0, hits=1)
    write_table(tmp_path / REAL_BOUNDS.table, [*rows[0]], rows)
    table = real_bounds_table(ResultsFolder(tmp_path)).splitlines()
    assert table[2:] == ["| shipped driver, bounds of real traffic | -4.00 ± 0.00 | 0 / 1 of 2 |"]


def test_the_figure_shows_the_share_of_episodes_with_a_collision() -> None:
    rows = PLAIN + drives("pretrained", "strict", 19.0, 29.0, 20.0, 20.0)[:2]
    rows += drives("pretrained", "real", 18.0, 28.0, hits=1)
    speeds, shares = real_bounds_figure(rows).axes
    assert speeds.get_ylabel() == "change of the mean speed, %"
    # one of the two episodes under the real bounds, none under the others
    assert [list(line.get_ydata()) for line in shares.get_lines()] == [[0.0], [50.0]]


def test_each_driver_is_driven_in_the_same_traffic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(real_bounds, "DENSITIES", (2,))
    (tmp_path / "short.toml").write_text(SHORT)
    usual = ReproduceOptions(seeds=1, drives=2, jobs=1, engine="here")
    options = usual._replace(
        out=tmp_path / "out", runs=tmp_path / "runs", config=(str(tmp_path / "short.toml"),)
    )
    list(reproduce(REAL_BOUNDS, options))
    rows = ResultsFolder(options.out).rows("real_bounds.csv")
    assert [(row["driver"], row["bounds"], row["seed"]) for row in rows] == [
        (driver, bounds, str(920_000 + seed))
        for driver, bounds in (
            *(("pretrained", bounds) for bounds in ("paper", "strict", "real")),
            ("real_bounds-0", "real"),
        )
        for seed in (0, 1)
    ]
