"""The cells of tables and the points of figures: worked by hand."""

from pathlib import Path
from typing import Any

import pytest

from drl_av.errors import DrlAvError
from studies.pivot import Pivot, markdown
from studies.plot import curves, figure
from studies.study import FileStudy

STUDY = """
meaning = "by hand"
[rows]
drivers = ["ours", "slow", "quick"]
vehicles = [5, 10]
seeds = { count = 2 }
[variants.plain]
[variants.strict]
label = "`{driver}, strict`"
"""
ROWS = """variant,driver,vehicles,seed,mean_speed_m_s,collided,ego_hit,lane_changes,decisions
plain,ours,5,0,30.0,False,False,2,10
plain,ours,5,1,20.0,True,True,0,30
plain,ours,10,0,12.0,True,False,1,40
plain,ours,10,1,10.0,False,False,0,40
plain,slow,5,0,20.0,False,False,0,40
plain,slow,5,1,16.0,False,False,0,40
plain,slow,10,0,11.0,False,False,0,40
plain,slow,10,1,13.0,False,False,0,40
plain,quick,5,0,27.0,False,False,0,40
plain,quick,5,1,21.0,False,False,0,40
plain,quick,10,0,9.0,False,False,0,40
plain,quick,10,1,9.0,False,False,0,40
strict,ours,5,0,29.0,False,False,0,40
strict,ours,5,1,19.0,False,False,0,40
"""


@pytest.fixture
def study(tmp_path: Path) -> FileStudy:
    (tmp_path / "hand.toml").write_text(STUDY)
    (tmp_path / "hand.csv").write_text(ROWS)
    return FileStudy(tmp_path / "hand.toml")


def lines(study: FileStudy, **spec: Any) -> list[str]:
    text = markdown(study, spec, study.path.parent)
    rows = [line for line in text.splitlines() if not line.startswith("| ---")]
    return [line.removeprefix("| ").removesuffix(" |") for line in rows]


def test_groups_are_lines_and_vehicles_are_columns_with_a_pool_of_several(study: FileStudy) -> None:
    found = lines(
        study,
        rows=["label"],
        heads=["driver"],
        columns="vehicles",
        pool={"up to 9": [0, 9], "all": [0, 99]},
        value={"mean": "mean_speed_m_s"},
        where={"driver": "ours"},
    )
    assert found == [
        "driver | 5 | 10 | up to 9 | all",
        "`ours` | 25.00 | 11.00 | 25.00 | 18.00",
        "`ours, strict` | 24.00 |  | 24.00 | 24.00",
    ]


def test_a_total_is_a_ratio_of_sums_and_a_mean_is_one_of_ratios(study: FileStudy) -> None:
    expression = "100 * lane_changes / decisions"
    found = lines(
        study,
        rows=["label"],
        where={"vehicles": 5, "variant": "plain", "driver": ["ours", "slow"]},
        measures=[
            {"head": "total", "total": expression, "digits": 1},
            {"head": "mean", "mean": expression, "digits": 1},
            {"head": "of nothing", "total": "lane_changes / ego_hit"},
            {"head": "hits", "text": "{ego_hit} / {was_hit} of {episodes}"},
        ],
    )
    assert found == [
        "label | total | mean | of nothing | hits",
        "`ours` | 5.0 | 10.0 | 2.00 | 1 / 0 of 2",
        "`slow` | 0.0 | 0.0 | 0.00 | 0 / 0 of 2",
    ]


def test_a_gain_is_paired_by_vehicles_and_seed_and_the_reference_has_no_cell_of_its_own(
    study: FileStudy,
) -> None:
    spec = {"rows": ["label"], "where": {"variant": "plain"}, "columns": "vehicles"}
    spec["value"] = {"gain": "mean_speed_m_s", "of": {"label": "`ours`"}}
    found = lines(study, **spec)
    # ours minus slow: 10 and 4, mean 7, t(0.975, 1) = 12.706 times 3; among 10 vehicles 1 and -3
    assert found == [
        "label | 5 | 10",
        "`ours` |  | ",
        "`slow` | 7.00 ± 38.12 | -1.00 ± 25.41",
        "`quick` | 1.00 ± 25.41 | 2.00 ± 12.71",
    ]
    spec["value"] = {"gain": "mean_speed_m_s", "over": {"driver": "ours"}}
    assert lines(study, **spec)[2] == "`slow` | -7.00 ± 38.12 | 1.00 ± 25.41"


def test_a_change_is_in_percent_of_the_mean_of_the_other(study: FileStudy) -> None:
    spec = {"rows": ["driver"], "where": {"driver": "ours", "vehicles": 5}}
    spec |= {"without": {"variant": ["plain"]}}
    spec["measures"] = [{"head": "%", "change": "mean_speed_m_s", "over": {"variant": "plain"}}]
    assert lines(study, **spec)[1] == "ours | -4.00 ± 0.00"  # 1 of 25 m/s, twice


def test_the_best_opponent_is_that_of_each_column_and_never_one_of_ours(study: FileStudy) -> None:
    found = lines(
        study,
        rows=["variant", "label"],
        columns="vehicles",
        pool={"all": [0, 99]},
        where={"variant": "plain"},
        ours=["ours"],
        best="the best opponent",
        value={"gain": "mean_speed_m_s", "over": "best", "common": True},
    )
    # means: slow 18 and 12, quick 24 and 9; over both slow 15, quick 16.5. The last column has 3
    # and 0 for the two seeds, the means among 5 and 10: standard error 1.5, t(0.975, 1) = 12.706
    assert found == [
        "variant | label | 5 | 10 | all",
        "plain | the best opponent | `quick` | `slow` | `quick`",
        "plain | `ours` | 1.00 ± 25.41 | -1.00 ± 25.41 | 1.50 ± 19.06",
    ]


def test_drivers_that_met_different_traffic_are_not_compared(study: FileStudy) -> None:
    path = study.path.with_suffix(".csv")
    path.write_text(ROWS.replace("plain,slow,5,1", "plain,slow,5,2"))
    spec = {"rows": ["label"], "where": {"variant": "plain"}, "columns": "vehicles"}
    spec["value"] = {"gain": "mean_speed_m_s", "over": {"driver": "ours"}}
    with pytest.raises(DrlAvError, match="did not drive the same traffic"):
        lines(study, **spec)
    spec["value"] |= {"common": True}
    assert lines(study, **spec)[2].startswith("`slow` | -10.00 | 1.00")  # seed 0 alone


def test_units_are_averaged_first_and_the_slowest_of_them_has_a_line(study: FileStudy) -> None:
    found = lines(
        study,
        rows=["variant"],
        where={"vehicles": 5, "variant": "plain"},
        units="driver",
        slowest="the slowest, {}",
        columns="vehicles",
        value={"interval": "mean_speed_m_s"},
        measures=[{"head": "n", "text": "{units} of {each}"}],
    )
    # drivers' means 25, 18, 24: standard error 2.186, t(0.975, 2) = 4.303
    assert found[1] == "plain | 22.33 ± 9.40 | 3 of 2"
    assert found[2] == "the slowest, slow | 18.00 ± 25.41 | 1 of 2"


def test_the_curves_of_a_figure_are_the_cells_of_the_table(study: FileStudy) -> None:
    spec: dict[str, Any] = {"x": "vehicles", "value": {"interval": "mean_speed_m_s"}}
    spec |= {"panels": "variant", "labels": ["x", "y"]}
    drawn = figure(study, spec, study.path.parent)
    assert [axes.get_title() for axes in drawn.axes] == ["plain", "strict"]
    [legend] = drawn.legends
    names = ["ours", "slow", "quick", "ours, strict"]
    assert [text.get_text() for text in legend.get_texts()] == names
    found = curves(Pivot(study, spec, study.path.parent), {"variant": "plain"})
    assert {name: [mean.value for _, mean in own] for name, own in found.items()} == {
        "ours": [25, 11],
        "slow": [18, 12],
        "quick": [24, 9],
    }


def test_a_curve_of_one_measure_against_another_has_a_point_for_each_value_of_a_column(
    study: FileStudy,
) -> None:
    spec: dict[str, Any] = {"x": {"total": "10 * lane_changes / decisions"}, "along": "vehicles"}
    spec |= {"value": {"interval": "mean_speed_m_s"}, "labels": ["x", "y"]}
    spec |= {"where": {"variant": "plain", "driver": ["ours", "slow"]}}
    found = curves(Pivot(study, spec, study.path.parent), {})
    # ours: 2 lane changes in 40 decisions among 5 vehicles, 1 in 80 among 10
    points = {name: [(at, mean.value) for at, mean in own] for name, own in found.items()}
    assert points["ours"] == [(0.5, 25), (0.125, 11)]
    assert points["slow"] == [(0.0, 18), (0.0, 12)]  # no lane changes at all: both points remain
    drawn = figure(study, spec, study.path.parent)
    [axes] = drawn.axes
    [ours, *_] = axes.lines
    assert sorted(ours.get_xdata()) == [0.125, 0.5]  # not moved aside, as numbers of vehicles are


def test_episodes_in_two_kinds_of_traffic_are_pairs_of_their_own(study: FileStudy) -> None:
    """With the same seed, a kind of traffic is another episode."""
    head, *rows = ROWS.splitlines()
    calm = [f"{row},calm" for row in rows if row.startswith(("plain,ours", "plain,slow"))]
    slower = [row.replace("30.0", "24.0").replace("calm", "paper") for row in calm]
    path = study.path.with_suffix(".csv")
    path.write_text("\n".join([f"{head},traffic", *calm, *slower]) + "\n")
    spec = {"rows": ["label"], "where": {"vehicles": 5}, "without": {"driver": ["slow"]}}
    spec["measures"] = [{"head": "gain", "gain": "mean_speed_m_s", "over": {"driver": "slow"}}]
    # calm: 10 and 4, paper: 4 and 4; of paper alone it would be 4.00
    assert lines(study, **spec)[1].startswith("`ours` | 5.50 ")
    path.write_text("\n".join([f"{head}", *rows[:12], *rows[:12]]) + "\n")
    with pytest.raises(DrlAvError, match="4 rows have 2 kinds of traffic: group them further"):
        lines(study, **spec)


def test_an_improvement_is_over_the_same_kind_of_traffic_and_has_no_units(study: FileStudy) -> None:
    kinds = (("calm", 28.5, 28.0), ("hazards", 20.5, 20.0))
    rows = [
        f"plain,{driver},5,{seed},{speed},False,False,0,40,{traffic}"
        for traffic, *speeds in kinds
        for driver, speed in zip(("ours", "slow"), speeds, strict=True)
        for seed in (0, 1)
    ]
    study.path.with_suffix(".csv").write_text("\n".join([f"{ROWS.splitlines()[0]},traffic", *rows]))
    spec = {"rows": ["label"], "without": {"driver": ["slow"]}, "measures": []}
    better = {"head": "p", "improvement": "mean_speed_m_s", "over": {"driver": "slow"}}
    assert lines(study, **spec | {"measures": [better]})[1] == "`ours` | 1.00 [1.00, 1.00]"
    middle = [{"head": "m", "iqm": "mean_speed_m_s"}]
    with pytest.raises(DrlAvError, match="is one of episodes: leave units out"):
        lines(study, rows=["variant"], units="driver", measures=middle)
