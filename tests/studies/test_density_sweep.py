"""The density sweep: driven once, to the density where the drivers meet."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drl_av.errors import DrlAvError
from drl_av.evaluation.comparison import Evaluation
from drl_av.evaluation.paired import PairedGain
from drl_av.files import Row
from studies import cells, density_sweep
from studies.density_sweep import DENSITY_SWEEP, STRONGER, paired_rows, sweep_plan
from studies.experiment import ResultsFolder, reproduce
from studies.options import Progress, ReproduceOptions

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
    return ReproduceOptions(drives=2, jobs=1, out=tmp_path, config=(config,))


def sweep(options: ReproduceOptions) -> list[Progress]:
    return list(reproduce(DENSITY_SWEEP, options))


def densities(options: ReproduceOptions, table: str = "density_sweep.csv") -> list[str]:
    return list(dict.fromkeys(row["vehicles"] for row in ResultsFolder(options.out).rows(table)))


def drivers_gain(monkeypatch: pytest.MonkeyPatch, lower_m_s: float) -> None:
    """Lower end of the interval of every gain."""
    monkeypatch.setattr(PairedGain, "lower_m_s", property(lambda gain: lower_m_s))


def test_continues_to_a_full_road_while_the_gain_is_significant(
    options: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers_gain(monkeypatch, 0.1)
    steps = sweep(options)
    assert densities(options) == densities(options, "paired.csv") == ["1", "30", "35", "40"]
    rows = ResultsFolder(options.out).rows("density_sweep.csv")
    assert len({(r["driver"], r["vehicles"], r["seed"]) for r in rows}) == len(rows) == 4 * 8 * 2
    [*_, last] = [step for step in steps if "gains" in step.line]
    assert (last.done, last.total) == (64, 64)
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
    assert counts == [1] * 16  # eight drivers on the third seed, among 1 and 30 vehicles
    sweep(options)  # fewer are there already
    assert counts == [1] * 16
    assert json.loads((options.out / "density_sweep.json").read_text())["seeds"] == "0 to 2"


def test_a_table_without_the_stronger_opponents_gets_their_rows_alone(
    options: ReproduceOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    drivers_gain(monkeypatch, 0.0)
    sweep(options)
    table = options.out / "density_sweep.csv"
    whole = table.read_bytes()
    heading, *rows = whole.decode().splitlines(keepends=True)
    older = [row for row in rows if row.startswith(("pretrained", "idm"))]
    assert len(older) == 4 * 2 * 2
    table.write_text("".join([heading, *older]))
    assert [step.done for step in sweep(options) if step.label] == [*range(1, 17)]
    assert table.read_bytes() == whole


def speeds(**drivers: tuple[float, ...]) -> list[Row]:
    """The episodes of these drivers among 30 vehicles; the place of a speed is its seed."""
    return [
        {"driver": name.replace("_", "-"), "vehicles": "30", "seed": str(seed)}
        | {"mean_speed_m_s": str(speed)}
        for name, own in drivers.items()
        for seed, speed in enumerate(own)
    ]


def test_the_sweep_stops_by_the_baselines_of_the_paper_alone(options: ReproduceOptions) -> None:
    plan = sweep_plan(options)
    last = plan.stages[0][-1]
    assert last.key == {"driver": "sumo-tuned", "vehicles": "30"}
    rows = speeds(
        pretrained=(20.0, 21.0, 22.0),
        idm=(18.0, 19.1, 20.0),
        idm_mobil=(19.0, 20.1, 21.0),
        idm_sumo=(18.0, 19.1, 20.0),
    )
    rows += [row | {"driver": name} for name in STRONGER for row in speeds(any=(29.0,) * 3)]
    following = plan.next_cell(rows, last)  # 1 m/s over idm-mobil, though 8 below gap-mobil
    assert following is not None
    assert following.key == {"driver": "pretrained", "vehicles": "35"}
    equal = [row | {"mean_speed_m_s": "20"} for row in rows]
    assert plan.next_cell(equal, last) is None


def test_an_opponent_is_compared_once_it_has_driven_as_many_episodes() -> None:
    rows = speeds(pretrained=(20.0, 22.0), idm=(19.0, 20.0), gap_mobil=(25.0,), sumo=(20.0, 23.0))
    found = paired_rows(rows)
    # gains of 1 and 2 over idm; of 0 and -1 over sumo, which is the fastest that has driven both
    assert [(row["baseline"], row["best"], row["difference_m_s"]) for row in found] == [
        ("idm", "False", "1.5"),
        ("sumo", "True", "-0.5"),
    ]
    assert paired_rows(speeds(pretrained=(20.0, 22.0))) == []


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
