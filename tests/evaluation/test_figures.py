"""The figures: what is drawn is what the tables say, each with its interval."""

from pathlib import Path

import numpy as np
import pytest
from drives import rows_of
from runs import error_message

from drl_av.cli import main
from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.evaluation.figure_style import save_figure
from drl_av.evaluation.figures import (
    learning_figure,
    profile_figure,
    reward_figure,
    speed_figure,
)
from drl_av.evaluation.statistics import moving_average
from studies.adaptation import adaptation_figure, adaptation_table
from studies.curves import check_figure, replay_figure
from studies.experiment import ResultsFolder, draw_results
from studies.registry import EXPERIMENTS
from studies.values import require_values

HEADER = "driver,vehicles,mean_speed_m_s\n"


CURVES = """
variant,seed,episode,mean_reward,training_reward,training_collisions,safety_triggers
""" + "".join(
    f"{variant},{seed},{episode},{base - seed / 10},-0.9,{0.4 + seed / 10},7\n"
    for variant, base in (("paper", -0.1), ("permit_all", -0.5))
    for seed, last in ((0, 500), (1, 300))
    for episode in range(100, last + 1, 100)
)
"""Two seeds to episode 300, the first to 500; no row of the third variant."""


def test_speed_figure_has_a_curve_for_each_driver_through_its_means() -> None:
    rows = rows_of(HEADER + "idm,5,20\nidm,5,22\nidm,30,18\nmine,5,25\nmine,30,19\n")
    [axes] = speed_figure(rows).axes
    curves = {c.get_label(): c.lines[0] for c in axes.containers}
    assert set(curves) == {"idm", "mine"}
    assert curves["idm"].get_xdata().tolist() == pytest.approx([5, 30], abs=0.1)
    assert curves["idm"].get_ydata().tolist() == [21.0, 18.0]


def test_the_profile_falls_at_each_speed_of_the_driver() -> None:
    rows = [
        {"driver": driver, "vehicles": 5.0, "mean_speed_m_s": speed}
        for driver, speed in (("idm", 20.0), ("mine", 25.0), ("idm", 22.0), ("mine", 25.0))
    ]
    idm, mine = profile_figure(rows).axes[0].lines
    assert idm.get_xdata().tolist() == [0, 20, 22, 25]
    assert idm.get_ydata().tolist() == [1, 0.5, 0, 0]
    assert mine.get_ydata().tolist() == [1, 1, 1, 0]
    assert idm.get_drawstyle() == "steps-post"


def test_learning_figure_follows_the_evaluations_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n100,-0.4\n200,-0.1\n")
    [axes] = learning_figure([tmp_path]).axes
    assert axes.lines[0].get_ydata().tolist() == [-0.4, -0.1]


def test_the_training_reward_is_drawn_behind_as_a_mean_of_the_last_20_episodes(
    tmp_path: Path,
) -> None:
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n20,-0.4\n40,-0.1\n")
    rewards = [-1.0] * 20 + [-0.5] * 20
    rows = (f"{episode},{reward}\n" for episode, reward in enumerate(rewards, 1))
    (tmp_path / "episodes.csv").write_text("episode,mean_reward\n" + "".join(rows))
    evaluated, training = learning_figure([tmp_path]).axes[0].lines
    assert training.get_xdata().tolist() == list(range(1, 41))
    drawn = training.get_ydata()
    assert [drawn[place] for place in (0, 19, 29, 39)] == pytest.approx([-1, -1, -0.75, -0.5])
    assert training.get_zorder() < evaluated.get_zorder()
    assert training.get_color() == evaluated.get_color()


NAMES = ["_mine", "$x", r"$\frac{$", "a_$b_$", "__"]


def test_names_are_in_the_legend_as_they_are(tmp_path: Path) -> None:
    speeds = rows_of(HEADER + "".join(f"{name},5,20\n" for name in NAMES))
    runs = [tmp_path / name for name in NAMES]
    for run in runs:
        run.mkdir()
        # a table that a spreadsheet saved begins with a byte-order mark
        (run / "evaluations.csv").write_text("\ufeffepisode,mean_reward\n100,-0.4\n")
    for figure in (speed_figure(speeds), learning_figure(runs)):
        [axes] = figure.axes
        legend = axes.get_legend()
        assert legend is not None
        assert [text.get_text() for text in legend.get_texts()] == NAMES
        save_figure(figure, tmp_path / "figure.png")


def test_episodes_of_one_driver_in_the_same_traffic_are_not_mixed_into_one_curve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, rows in (("paper", "idm,5,1,20\n"), ("strict", "idm,5,2,20\nidm,5,1,10\n")):
        (tmp_path / name).write_text(f"driver,vehicles,seed,mean_speed_m_s\n{rows}")
    tables, out = [str(tmp_path / name) for name in ("paper", "strict")], str(tmp_path)
    assert main(["figures", tables[0], "--out", out]) == 0
    assert main(["figures", *tables, "--out", out]) == 1
    assert "2 rows of idm with seed 1 among 5 vehicles" in error_message(capsys)


def test_a_run_without_an_evaluation_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n")
    assert main(["figures", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    assert "has no evaluation yet: train it for longer" in error_message(capsys)


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e400", "1e308", "9" * 400])
def test_a_number_that_cannot_be_drawn_is_one_sentence(
    number: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text in (
        ("table.csv", f"{HEADER}idm,5,{number}\n"),
        ("table.csv", f"{HEADER}idm,{number},20\n"),
        ("evaluations.csv", f"episode,mean_reward\n{number},-0.4\n"),
    ):
        (tmp_path / name).write_text(text)
        source = tmp_path if name == "evaluations.csv" else tmp_path / name
        assert main(["figures", str(source), "--out", str(tmp_path / "out")]) == 1
        assert "must be a finite number" in error_message(capsys)


@pytest.mark.parametrize("number", ["nan", "inf", "1e308", "9" * 400])
@pytest.mark.parametrize("column", ["episode", "mean_reward"])
def test_a_number_of_the_results_that_cannot_be_drawn_is_one_sentence(
    number: str, column: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, *rows = [line.split(",") for line in CURVES.strip().splitlines()]
    rows[0][first.index(column)] = number
    (tmp_path / "curves.csv").write_text("".join(",".join(row) + "\n" for row in [first, *rows]))
    assert main(["figures", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    message = error_message(capsys)
    assert "curves.csv, or the file beside it, is damaged or of another version" in message
    assert f"(ValueError('line 2: {column} is" in message
    assert len(message) < 300 + len(str(tmp_path))


def test_a_time_to_collision_of_the_results_may_be_infinite_and_no_other_number() -> None:
    fits = {"min_ttc_s": "inf", "mean_speed_m_s": "1e9", "ego_hit": "True", "mine": "nothing"}
    require_values([fits])
    for column, cell in (("mean_speed_m_s", "inf"), ("min_ttc_s", "nan"), ("ego_hit", "no")):
        with pytest.raises(ValueError, match=f"line 3: {column} is {cell}"):
            require_values([fits, fits | {column: cell}])


def test_a_long_name_is_shortened_in_the_legend_and_51_drivers_are_too_many(tmp_path: Path) -> None:
    name = "x" * 100_000
    figure = speed_figure(rows_of(f"{HEADER}{name},5,20\n"))
    [text] = figure.axes[0].get_legend().get_texts()  # type: ignore[union-attr]
    assert text.get_text() == "x" * 77 + "..."
    save_figure(figure, tmp_path / "figure.png")  # no warning
    many = HEADER + "".join(f"d{number},5,20\n" for number in range(51))
    assert len(speed_figure(rows_of(many.rpartition("d50")[0])).axes[0].containers) == 50
    with pytest.raises(DrlAvError, match="hold 51 drivers, but a figure shows at most 50"):
        speed_figure(rows_of(many))


def test_reward_figure_has_three_panels_with_their_best_at_the_desired_values(
    tmp_path: Path,
) -> None:
    figure = reward_figure(Config())
    curves = [panel.lines[0] for panel in figure.axes]
    best = [curve.get_xdata()[np.argmax(curve.get_ydata())] for curve in curves]
    assert best == pytest.approx([39.0, 3.8, 30.0], abs=0.06)
    save_figure(figure, tmp_path / "deep" / "reward.png")
    assert (tmp_path / "deep" / "reward.png").stat().st_size > 10_000


def test_check_figure_has_means_over_seeds_and_continues_with_the_longer_one() -> None:
    figure = check_figure(rows_of(CURVES))
    assert figure is not None
    reward, exploring, collisions = figure.axes
    mean = reward.lines[0]
    assert mean.get_label() == "two buffers, safety check (2 seeds)"
    assert list(mean.get_xdata()) == [100, 200, 300]
    assert mean.get_ydata() == pytest.approx([-0.15] * 3)
    lone = [line for line in reward.lines if list(line.get_xdata()) == [300, 400, 500]]
    assert [line.get_ydata()[0] for line in lone] == pytest.approx([-0.1, -0.5])
    assert exploring.lines[0].get_ydata() == pytest.approx([-0.9] * 3)
    assert collisions.lines[0].get_ydata() == pytest.approx([0.45] * 3)
    band = reward.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((-0.78531, 0.48531))  # t = 12.706


def test_replay_figure_draws_the_variants_there_are() -> None:
    rows = rows_of(CURVES)
    figure = replay_figure(rows)
    assert figure is not None
    reward, triggers = figure.axes
    labels = [line.get_label() for line in reward.lines]
    assert "two buffers, safety check (2 seeds)" in labels
    assert not any("no safety check" in str(label) for label in labels)
    assert triggers.lines[0].get_ydata() == pytest.approx([7] * 3)
    assert replay_figure([row for row in rows if row["variant"] == "permit_all"]) is None


def test_moving_average_weighs_rows_by_their_episodes_and_looks_back_only() -> None:
    episodes, values = np.array([100.0, 200, 300, 350]), np.array([4.0, 8, 0, 6])
    # 350 looks back to 150: the row of 200 is not wholly within; 300 counts twice as much as 350
    assert moving_average(episodes, values, 200) == pytest.approx([4, 6, 4, 2])
    assert moving_average(episodes, values, 10_000) == pytest.approx([4, 6, 4, 1500 / 350])


def test_adaptation_figure_draws_both() -> None:
    names = "variant,seed,episode,training_safety_triggers\n"
    lines = [
        f"{v},0,{e},{t}\n" for v, t in (("adaptation", 3), ("no_adaptation", 5)) for e in (100, 200)
    ]
    [axes] = adaptation_figure(rows_of(names + "".join(lines))).axes
    drawn = {line.get_label(): list(line.get_ydata()) for line in axes.lines}
    assert drawn["continual adaptation"] == [3, 3]
    assert drawn["no adaptation"] == [5, 5]


def test_the_hits_of_a_short_last_block_are_those_of_its_episodes(tmp_path: Path) -> None:
    names = "variant,seed,episode,training_reward,training_safety_triggers,"
    lines = [
        f"{variant},0,{episode},-0.1,2,{hits},{hits}\n"
        for variant in ("adaptation", "no_adaptation")
        for episode, hits in ((100, 0.02), (150, 0.04))
    ]
    text = f"{names}training_ego_hits,training_collisions\n{''.join(lines)}"
    (tmp_path / "adaptation.csv").write_text(text)
    table = adaptation_table(ResultsFolder(tmp_path))
    # 2 of 100 and 2 of 50 episodes
    assert [row.split(" | ")[-2:] for row in table.splitlines()[2:]] == [["4", "0 |"]] * 2


def test_two_figures_of_one_name_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "curves.csv").write_text(CURVES.lstrip())
    out = tmp_path / "out"
    words = ["figures", str(tmp_path / "one"), str(tmp_path / "two"), "--out", str(out)]
    assert main(words) == 1
    assert f"draw {tmp_path / 'two'} by itself" in error_message(capsys)
    assert not out.exists()


def test_a_folder_yields_the_figures_whose_tables_it_has(tmp_path: Path) -> None:
    with pytest.raises(DrlAvError, match="neither a run nor results"):
        dict(draw_results(EXPERIMENTS, tmp_path))
    (tmp_path / "curves.csv").write_text(CURVES.lstrip())
    assert set(dict(draw_results(EXPERIMENTS, tmp_path))) == {"learning_check", "learning_replay"}
    (tmp_path / "strict.csv").write_text("check,bound\nstrict,\n")
    with pytest.raises(DrlAvError, match=r"strict\.csv, or the file beside it, is damaged"):
        dict(draw_results(EXPERIMENTS, tmp_path))
