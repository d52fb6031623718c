"""The density sweep: driven once, to the density where the drivers meet."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drl_av.errors import DrlAvError
from drl_av.evaluation.comparison import Evaluation
from drl_av.evaluation.paired import Paired
from drl_av.experiments import cells, density_sweep
from drl_av.experiments.density_sweep import DENSITY_SWEEP
from drl_av.experiments.experiment import Results, reproduce
from drl_av.experiments.options import Progress, ReproduceOptions

SETTINGS = """
[simulation]
decisions_per_episode = 10
[traffic]
start_gap_m = 30.0
"""


@pytest.fixture
def options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ReproduceOptions:
    """Two densities of the tables, on a road that takes 41 vehicles and the ego."""
    monkeypatch.setattr(density_sweep, "DENSITIES", (1, 30))
    (tmp_path / "settings.toml").write_text(SETTINGS)
    config = str(tmp_path / "settings.toml")
    return ReproduceOptions(drives=2, jobs=1, out=tmp_path, config=config)


def sweep(options: ReproduceOptions) -> list[Progress]:
    return list(reproduce(DENSITY_SWEEP, options))


def densities(options: ReproduceOptions, table: str = "density_sweep.csv") -> list[str]:
    return list(dict.fromkeys(row["vehicles"] for row in Results(options.out).rows(table)))


def drivers_gain(monkeypatch: pytest.MonkeyPatch, lower_m_s: float) -> None:
    """Lower end of the interval of every gain."""
    monkeypatch.setattr(Paired, "lower_m_s", property(lambda gain: lower_m_s))


def test_continues_to_a_full_road_while_the_gain_is_significant(
    options: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers_gain(monkeypatch, 0.1)
    steps = sweep(options)
    assert densities(options) == densities(options, "paired.csv") == ["1", "30", "35", "40"]
    rows = Results(options.out).rows("density_sweep.csv")
    assert len({(r["driver"], r["vehicles"], r["seed"]) for r in rows}) == len(rows) == 4 * 4 * 2
    [*_, last] = [step for step in steps if "gains" in step.line]
    assert (last.done, last.total) == (32, 32)
    assert "40 vehicles: pretrained gains" in last.line
    assert (options.out / "mean_speed.png").exists()


def test_stops_where_the_drivers_meet_and_drives_nothing_twice(
    options: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers_gain(monkeypatch, 0.0)
    sweep(options)
    assert densities(options) == ["1", "30"]
    counts: list[int] = []
    rows = Evaluation.rows

    def counted(evaluation: Any, jobs: int) -> Iterator[Any]:
        counts.append(len(evaluation))
        return rows(evaluation, jobs)

    monkeypatch.setattr(Evaluation, "rows", counted)
    sweep(options)
    assert not counts
    sweep(options._replace(drives=3))
    assert counts == [4, 4]  # four drivers on the third seed
    sweep(options)  # fewer are there already
    assert counts == [4, 4]
    assert json.loads((options.out / "density_sweep.json").read_text())["seeds"] == "0 to 2"


def test_episodes_of_another_policy_are_not_mixed(
    options: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers_gain(monkeypatch, 0.0)
    sweep(options)
    whole = (options.out / "density_sweep.csv").read_bytes()
    monkeypatch.setattr(cells, "checksum", lambda file: "that of another policy")
    with pytest.raises(DrlAvError, match=r"density_sweep\.csv was made with .* another driver"):
        sweep(options)
    assert (options.out / "density_sweep.csv").read_bytes() == whole
