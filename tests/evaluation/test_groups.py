"""Trainings of one kind with several seeds, compared as one driver."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import episode
from runs import SHORT, Capsys, run_folder

from drl_av.cli import main
from drl_av.drivers.groups import trainings_of
from drl_av.drivers.registry import baselines, find_drivers, load_driver
from drl_av.errors import ConfigError, DrlAvError
from drl_av.evaluation.criterion import judge
from drl_av.evaluation.evaluate import evaluate
from drl_av.evaluation.figures import (
    gain_figure,
    learning_figure,
    profile_figure,
    speed_figure,
    styles_of,
)
from drl_av.evaluation.statistics import gains_over_fastest, overall, summarize
from drl_av.evaluation.table import read_rows

SPEEDS = {"ppo/seed-1": (20.0, 24.0), "ppo/seed-2": (26.0, 30.0), "ppo/seed-10": (30.0, 38.0)}
"""In two episodes; the means of the trainings are 22, 28 and 34 m/s."""
ROWS = [
    *(
        episode(driver, seed, speed, group="ppo")
        for driver, speeds in SPEEDS.items()
        for seed, speed in enumerate(speeds)
    ),
    episode("idm", 0, 27.0, group="idm"),
    episode("idm", 1, 23.0, group="idm"),
]


def test_beside_a_group_another_driver_has_one_score_at_each_number_of_vehicles() -> None:
    _, idm = overall(ROWS, ["idm"])
    # the mean of 27 and 23; as two scores the interval would reach from 23 to 27
    assert idm.speed_m_s == (25.0, -np.inf, np.inf)


def test_the_interval_of_a_group_is_over_the_means_of_its_trainings() -> None:
    ppo, idm = summarize(ROWS)
    assert (ppo.driver, ppo.trainings, ppo.episodes) == ("ppo", 3, 6)
    # 22, 28, 34: standard error 6 / sqrt(3), t(0.975, 2) = 4.3027; over 6 episodes it were 6.7
    assert ppo.speed_m_s == pytest.approx((28, 4.3027 * 6 / 3**0.5), abs=1e-3)
    # the rule-based driver has no trainings: 27 and 23, t(0.975, 1) = 12.706, standard error 2
    assert (idm.driver, idm.trainings) == ("idm", None)
    assert idm.speed_m_s == pytest.approx((25, 12.706 * 2), abs=1e-2)


def test_one_training_of_a_group_has_no_interval() -> None:
    [ppo] = summarize(ROWS[:2])
    assert ppo.trainings == 1
    assert ppo.speed_m_s.half_width == np.inf


def test_the_gain_of_a_group_is_that_of_its_trainings() -> None:
    [gain] = gains_over_fastest(ROWS, ["idm"])
    assert (gain.driver, gain.baseline, gain.episodes) == ("ppo", "idm", 6)
    # -3, 3 and 9: of 22, 28 and 34 against 25 m/s
    assert gain.difference_m_s == pytest.approx((3, 4.3027 * 6 / 3**0.5), abs=1e-3)


def test_the_probability_of_improvement_counts_trainings() -> None:
    ppo, idm = overall(ROWS, ["idm"])
    # two of three trainings are faster than 25 m/s; of their episodes 7 of 12 pairs would be
    assert ppo.improvement.value == pytest.approx(2 / 3)
    assert (ppo.speed_m_s.value, ppo.episodes, ppo.trainings) == (28, 6, 3)
    assert (idm.speed_m_s.value, idm.improvement) == (25, None)
    assert ppo.speed_m_s.low >= 22


def test_a_group_is_no_single_driver(here: Path, capsys: Capsys) -> None:
    for seed in (1, 2):
        run_folder(here / f"seed-{seed}")
    with pytest.raises(ConfigError, match=r"mine=seed-\* names 2 trainings: name one of them"):
        load_driver("mine=seed-*")
    assert main(["adapt", "mine=seed-*", "--out", "new"]) == 1
    assert "names 2 trainings" in capsys.readouterr().err


def test_each_training_is_judged() -> None:
    assert [each.driver for each in judge(ROWS)] == [*SPEEDS]


def test_figures_have_a_curve_and_a_band_for_a_group() -> None:
    [axes] = speed_figure(ROWS).axes
    labels = [line.get_label() for line in axes.lines]
    assert axes.lines[0].get_ydata().tolist() == [28.0]
    [band] = axes.collections[:1]
    ends = band.get_paths()[0].get_extents()
    assert (ends.y0, ends.y1) == pytest.approx((28 - 14.905, 28 + 14.905), abs=1e-2)
    assert "ppo, 3 trainings" in labels
    apart = [replace(row, vehicles=place) for place, row in enumerate(ROWS)]
    with pytest.raises(DrlAvError, match="trainings of ppo have no number of vehicles in common"):
        speed_figure(apart)
    [gains] = gain_figure(gains_over_fastest(ROWS, ["idm"]), ROWS).axes
    assert "ppo, 3 trainings" in [line.get_label() for line in gains.lines]
    assert gains.collections[0].get_paths()[0].get_extents().y1 == pytest.approx(
        3 + 14.905, abs=1e-2
    )
    [profile] = profile_figure(ROWS).axes
    [shares, other] = profile.lines
    assert shares.get_ydata()[0] == 1
    # at 24 m/s: none of two, two of two and two of two episodes are faster
    at = shares.get_xdata().tolist().index(24)
    assert shares.get_ydata()[at] == pytest.approx(2 / 3)
    assert other.get_ydata()[at] == 0.5
    for place in profile.collections[0].get_paths():
        assert 0 <= place.vertices[:, 1].min() <= place.vertices[:, 1].max() <= 1


def test_the_learning_curve_of_a_group_is_the_mean_of_its_runs(tmp_path: Path) -> None:
    runs = [tmp_path / f"seed-{seed}" for seed in (1, 2)]
    for run, last in zip(runs, ("40,-0.1\n", "40,-0.3\n60,0.0\n"), strict=True):
        run.mkdir()
        (run / "evaluations.csv").write_text(f"episode,mean_reward\n20,-0.5\n{last}")
    [axes] = learning_figure([], {"ppo": runs}).axes
    [curve] = axes.lines
    assert curve.get_xdata().tolist() == [20, 40]  # at 60 there is one run only
    assert curve.get_ydata().tolist() == pytest.approx([-0.5, -0.2])
    assert curve.get_color() == styles_of(["idm", "ppo"])["ppo"][0]  # as in figures of speeds


def test_a_pattern_names_the_trainings_in_the_order_of_their_numbers(here: Path) -> None:
    for seed in (10, 2, 1):
        run_folder(Path(f"runs/seed-{seed}"))
    specs = find_drivers(["ppo=runs/*", "idm"])
    trainings = [(f"ppo/seed-{seed}", "ppo") for seed in (1, 2, 10)]
    assert [(spec.name, spec.group) for spec in specs] == [*trainings, ("idm", "idm")]
    assert baselines(spec.name for spec in specs) == ["idm"]
    assert {spec.group for spec in find_drivers(["runs/seed-1", "idm"])} == {""}
    [first, *_] = find_drivers(["ppo=runs/*@paper"])
    assert (first.group, first.under) == ("ppo@paper", "paper")
    for name in ("other/ppo", "ppo/seed-2", "seed-2"):
        run_folder(Path(name))
    run_folder(Path("rate=1"))  # a folder with such a name is no pattern
    assert trainings_of("rate=1") == ("", ["rate=1"])
    for words, why in (
        (["ppo=gone/*"], "No file or folder matches 'gone/\\*'"),
        (["idm=runs/*"], r"idm is the name of a driver that ships: rename idm=runs/\*"),
        (
            ["ppo=runs/*", "dqn=runs/seed-2"],
            "runs/seed-2 is named twice, in the group dqn and in the group ppo: name it once",
        ),
        (["ppo=runs/*", "runs/seed-2"], "is named twice, alone and in the group ppo"),
        (["ppo=runs/*", "other/ppo"], "other/ppo would be called ppo, as another driver or a gr"),
        (["ppo=runs/*", "ppo/seed-2", "seed-2"], "seed-2 would be called ppo/seed-2, as anoth"),
    ):
        with pytest.raises(ConfigError, match=why):
            find_drivers(words)


def test_the_table_of_an_evaluation_has_a_column_for_the_group(here: Path, capsys: Capsys) -> None:
    for seed in (1, 2):
        run_folder(Path(f"runs/seed-{seed}"), SHORT)
    words = ["evaluate", "mine=runs/*", "idm", "--vehicles", "0", "--episodes", "1"]
    assert main([*words, "--out", "rows.csv"]) == 0
    rows = read_rows(Path("rows.csv"))
    named = [("mine/seed-1", "mine"), ("mine/seed-2", "mine"), ("idm", "idm")]
    assert [(row["driver"], row["group"]) for row in rows] == named
    printed = capsys.readouterr().out
    assert "over trainings: 2 of mine" in printed
    assert "mine: 0 of 2 trainings pass" in printed
    assert max(map(len, printed.splitlines())) <= 80
    assert main([*words, "--out", "rows.csv"]) == 0  # nothing is driven again
    assert main(["figures", "rows.csv", "--out", "figures"]) == 0
    words, own = ["mine=runs/*", "idm"], {"object": load_driver("gap-mobil")}
    found = evaluate(words, own=own, vehicles=0, episodes=1, config=SHORT)
    assert [row.group for row in found] == ["mine", "mine", "idm", "object"]
