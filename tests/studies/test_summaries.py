"""The tables of the documentation, from rows worked by hand."""

import json
from pathlib import Path

import pytest
from drives import rows_of

from drl_av.errors import DrlAvError
from studies.adaptation import adaptation_table
from studies.curves import cost_table
from studies.density_sweep import (
    collision_table,
    driving_table,
    gain_figure,
    gains_by_opponent_table,
    gains_over_all,
    speed_table,
)
from studies.experiment import ResultsFolder
from studies.fast import FAST, fast_table, whole_schedule_table
from studies.final_policies import final_table
from studies.strictness import summary_table


def results(folder: Path, **tables: str) -> ResultsFolder:
    """A folder with these tables, whose lines are parted by spaces."""
    for name, lines in tables.items():
        (folder / f"{name}.csv").write_text("\n".join(lines.split()) + "\n")
    return ResultsFolder(folder)


def body(table: str) -> list[str]:
    """The rows of a table without its heading."""
    return [line.strip("| ") for line in table.splitlines()[2:]]


def test_drivers_stand_in_the_rows_and_densities_in_the_columns(tmp_path: Path) -> None:
    found = results(
        tmp_path,
        density_sweep="""driver,vehicles,mean_speed_m_s,collided,ego_hit
        idm,10,20,True,True idm,10,22,True,False idm,10,24,False,False
        idm,5,30,False,False idm,5,30,False,False""",
    )
    # 20, 22, 24: standard error 2 / sqrt(3), t(0.975, 2) = 4.3027
    assert body(speed_table(found)) == ["`idm` | 30.00 ± 0.00 | 22.00 ± 4.97"]
    assert body(collision_table(found)) == ["`idm` | 0 / 0 of 2 | 1 / 1 of 3"]


def test_the_driving_of_the_shipped_driver_is_summed_up_to_30_vehicles(tmp_path: Path) -> None:
    names = "mean_reward,mean_r_v,mean_r_y,mean_r_x,lane_changes,aborted_lane_changes"
    found = results(
        tmp_path,
        density_sweep=f"""driver,vehicles,decisions,d_safe_violations,{names}
        pretrained,10,200,20,-0.1,-0.2,-0.3,-0.4,1,2 pretrained,30,100,30,-0.3,-0.4,-0.5,-0.6,3,0
        pretrained,35,100,90,-9,-9,-9,-9,9,9 idm,10,200,200,-7,-7,-7,-7,7,7""",
    )
    assert body(driving_table(found)) == [
        "reward per decision | -0.100 | -0.300 | -9.000 | -0.200",
        "r_v | -0.200 | -0.400 | -9.000 | -0.300",
        "r_y | -0.300 | -0.500 | -9.000 | -0.400",
        "r_x | -0.400 | -0.600 | -9.000 | -0.500",
        "closer than d_safe, % | 10.0 | 30.0 | 90.0 | 20.0",
        "lane changes | 1.0 | 3.0 | 9.0 | 2.0",
        "aborted lane changes | 2.0 | 0.0 | 9.0 | 1.0",
    ]


SWEPT = """driver,vehicles,seed,mean_speed_m_s,ego_hit
    pretrained,5,0,25,False pretrained,5,1,27,False pretrained,35,0,15,False pretrained,35,1,17,True
    idm-mobil,5,0,20,True idm-mobil,5,1,20,True idm-mobil,35,0,18,False idm-mobil,35,1,19,False
    gap-mobil,5,0,26,False gap-mobil,5,1,28,False gap-mobil,35,0,14,True gap-mobil,35,1,16,False"""
"""Speeds of three drivers on two seeds, among 5 and among 35 vehicles."""
ACC = """driver,vehicles,seed,mean_speed_m_s,ego_hit
    pretrained,5,0,1,True idm,5,0,1,True
    idm-mobil,5,0,23,False idm-mobil,5,1,25,False"""
"""Speeds under adaptive cruise control; those of ``pretrained`` and ``idm`` are not shown."""


def test_the_gain_over_the_fastest_opponent_is_bold(tmp_path: Path) -> None:
    found = results(tmp_path, density_sweep=SWEPT, reference_acc=ACC)
    # differences 5 and 7: standard error 1, t(0.975, 1) = 12.706; up to 30 are the 5 alone
    assert body(gains_by_opponent_table(found)) == [
        "over `idm-mobil` | 6.00 ± 12.71 | **-2.50 ± 6.35** | 6.00 ± 12.71",
        "over `gap-mobil` | **-1.00 ± 0.00** | 1.00 ± 0.00 | **-1.00 ± 0.00**",
        "over `idm-mobil, acc` | 2.00 ± 0.00 |  | 2.00 ± 0.00",
    ]
    assert speed_table(found).splitlines()[-1] == "| `idm-mobil, acc` | 24.00 ± 12.71 |  |"


def test_the_summary_has_the_shipped_driver_under_both_checks_beside_all_opponents(
    tmp_path: Path,
) -> None:
    found = results(
        tmp_path,
        density_sweep=SWEPT,
        reference_acc=ACC,
        strict="""check,bound,driver,vehicles,seed,mean_speed_m_s,ego_hit
        strict,,pretrained,5,0,24,False strict,,pretrained,5,1,26,True
        paper,,pretrained,5,0,9,True strict,clearance_m,pretrained,5,0,9,True""",
    )
    assert body(summary_table(found)) == [
        "`pretrained` | 26.00 |  | 0/2",
        "`pretrained, strict` | 25.00 | 1.00 ± 0.00 | 1/2",
        "`idm-mobil` | 20.00 | 6.00 ± 12.71 | 2/2",
        "`gap-mobil` | 27.00 | -1.00 ± 0.00 | 0/2",
        "`idm-mobil, acc` | 24.00 | 2.00 ± 0.00 | 0/2",
    ]


def test_the_figure_of_gains_has_a_curve_for_each_opponent() -> None:
    [axes] = gain_figure(rows_of(SWEPT)).axes
    curves = {c.get_label(): c.lines[0].get_ydata().tolist() for c in axes.containers}
    assert curves == {"idm-mobil": [6.0, -2.5], "gap-mobil": [-1.0, 1.0]}


def test_a_seed_among_more_vehicles_is_other_traffic() -> None:
    rows = rows_of(
        """driver,vehicles,seed,mean_speed_m_s
        pretrained,5,0,30 pretrained,10,0,20 idm,5,0,29 idm,10,0,17"""
    )
    assert gains_over_all(rows)["idm"].value == 2.0


def test_a_driver_of_other_traffic_is_not_compared() -> None:
    rows = rows_of("driver,vehicles,seed,mean_speed_m_s pretrained,5,0,20 idm,5,1,20")
    with pytest.raises(DrlAvError, match="pretrained and idm did not drive the same traffic"):
        gains_over_all(rows)


def test_the_cost_is_that_of_the_longest_trainings_alone(tmp_path: Path) -> None:
    found = results(tmp_path, curves="variant,seed,episode paper,0,100 paper,0,200 paper,1,100")
    facts = {"wall_time_s": {"paper-0": 72.0, "paper-1": 9000.0}, "settings": {}}
    (tmp_path / "curves.json").write_text(json.dumps(facts))
    # 0.36 s an episode, 10,000 episodes, 200 seeds: 720,000 s, 200 h
    assert body(cost_table(found)) == ["`paper` | 0.36 | 200 | 4.2 days | 1.0 hours"]


def test_final_performance_is_the_mean_over_the_policies_of_the_mean_of_each(
    tmp_path: Path,
) -> None:
    found = results(
        tmp_path,
        final_policies="""training,mean_reward,mean_speed_m_s,collided,ego_hit
        paper-1,-1,20,True,True paper-1,-3,22,False,False
        paper-2,-4,25,False,False paper-2,-4,25,False,False""",
    )
    # policies' rewards -2 and -4, speeds 21 and 25; t(0.975, 1) = 12.706
    [line] = body(final_table(found))
    assert line.startswith("`paper` | 2 | 2 | -3.000 ± 12.706 | 23.00 ± 25.41 | 0.250 ± 3.177")


def test_gains_of_fast_are_paired_with_the_whole_schedule(tmp_path: Path) -> None:
    found = results(
        tmp_path,
        fast="""training,vehicles,seed,mean_reward,mean_speed_m_s,ego_hit
        paper-0,5,0,-0.1,20,False paper-0,5,1,-0.3,30,False
        fast-0,5,1,-0.2,31,False fast-0,5,0,0.0,21,True""",
    )
    facts = {"wall_time_s": {"paper-0": 1271.7, "fast-0": 102.0}, "settings": {}}
    (tmp_path / "fast.json").write_text(json.dumps(facts))
    whole, fast = body(fast_table(found))
    assert whole.startswith("`paper-0` | 1,272 | 0 of 2 | -0.200 ± 1.271 | 0.000 ± 0.000 | 25.00")
    assert fast.startswith("`fast-0` | 102 | 1 of 2 | -0.100 ± 1.271 | 0.100 ± 0.000 | 26.00")
    assert fast.endswith("| 1.00 ± 0.00")


def test_speeds_of_the_whole_schedule_are_means_over_seeds_with_the_slowest_seed(
    tmp_path: Path,
) -> None:
    found = results(
        tmp_path,
        fast="""training,vehicles,mean_speed_m_s
        paper-0,5,29 paper-0,5,31 paper-0,10,20 paper-0,10,20
        paper-1,5,28 paper-1,5,28 paper-1,10,19 paper-1,10,19 fast-0,5,27 fast-0,5,29""",
        density_sweep="driver,vehicles,mean_speed_m_s idm,5,20 idm,5,22 idm,35,1 sumo,5,40",
    )
    # means of the seeds 30 and 28, 20 and 19, 25 and 23.5; t(0.975, 1) = 12.706
    paper, slowest, fast, idm = body(whole_schedule_table(found))
    assert paper == "paper, 2 seeds | 29.00 ± 12.71 | 19.50 ± 6.35 | 24.25 ± 9.53"
    assert slowest.startswith("the slowest of them, paper-1 | 28.00 ± 0.00 | 19.00 ± 0.00 | 23.50")
    assert fast.startswith("fast, 1 seed | 28.00 ± 12.71 | ")
    assert idm == "idm | 21.00 ± 12.71 | 21.00 ± 12.71"
    [(name, figure)] = FAST.draw(tmp_path)
    shown = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]  # type: ignore[union-attr]
    assert (name, shown) == (
        "whole_schedule",
        ["paper, 2 seeds", "fast, 1 seed", "idm"],
    )


def test_adaptation_is_compared_as_far_as_both_are_driven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("studies.adaptation.SUMMED_OVER", 200)
    names = "training_reward,training_collisions,training_ego_hits,training_safety_triggers"
    found = results(
        tmp_path,
        adaptation=f"""variant,seed,episode,{names}
        adaptation,0,100,-0.1,0.03,0.01,4 adaptation,0,200,-0.1,0,0,2
        adaptation,0,300,-0.1,0,0,0 adaptation,0,400,-0.1,0,0,0
        no_adaptation,0,100,-0.2,0,0,5 no_adaptation,0,200,-0.2,0.01,0,5
        no_adaptation,0,300,-0.2,0,0,5""",
    )
    first, second, *others = body(adaptation_table(found))
    assert first.startswith("on | 1 to 200 | 3.0000 ± 12.7062 | -0.1000 ± 0.0000 | 1 | 2")
    assert second == "off | 1 to 200 | 5.0000 ± 0.0000 | -0.2000 ± 0.0000 | 0 | 1"
    assert [line.split(" | ")[1] for line in others] == ["201 to 300", "201 to 300"]
