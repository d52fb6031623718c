"""The figures: what is drawn is what the tables say, each with its interval."""

import re
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from drives import episode
from runs import Capsys, error_message

from drl_av.cli import main
from drl_av.config import Config
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError
from drl_av.evaluation.figure_style import save_figure
from drl_av.evaluation.figures import (
    STYLES,
    gain_figure,
    learning_figure,
    moving_average,
    profile_figure,
    reward_figure,
    speed_figure,
    styles_of,
)
from drl_av.evaluation.statistics import gains_over_fastest
from drl_av.evaluation.table import require_values, results_of
from drl_av.files.table import read_table, write_table

SHORT = ["-o", "simulation.decisions_per_episode=4"]


def write_rows(path: Path, *rows: EpisodeResult) -> None:
    write_table(path, EpisodeResult, rows)


def test_speed_figure_has_a_curve_for_each_driver_through_its_means() -> None:
    rows = [
        *(episode("idm", seed, speed) for seed, speed in enumerate((20.0, 22.0))),
        episode("idm", 0, 18.0, vehicles=30),
        episode("mine", 0, 25.0),
        episode("mine", 0, 19.0, vehicles=30),
    ]
    [axes] = speed_figure(rows).axes
    curves = {c.get_label(): c.lines[0] for c in axes.containers}
    assert set(curves) == {"idm", "mine"}
    # two curves are 3 % of 25 vehicles apart, each half of it from the number
    assert curves["idm"].get_xdata().tolist() == pytest.approx([4.625, 29.625])
    assert curves["mine"].get_xdata().tolist() == pytest.approx([5.375, 30.375])
    assert curves["idm"].get_ydata().tolist() == [21.0, 18.0]


def test_the_gain_is_paired_by_traffic_and_over_the_fastest_rule(
    here: Path, capsys: Capsys
) -> None:
    words = ["evaluate", "idm", "gap-mobil", "pretrained", "--vehicles", "3", "5", "--episodes"]
    assert main([*words, "2", *SHORT, "--out", "rows.csv"]) == 0
    rows = read_table(here / "rows.csv")
    for row in rows:  # 20 m/s in the first traffic, 30 in the second; the rule idm is slower by 3
        first = row["seed"] == rows[0]["seed"]
        gain = {"idm": -3.0, "gap-mobil": 0.0, "pretrained": 0.5 if first else 0.7}[row["driver"]]
        row["mean_speed_m_s"] = (20.0 if first else 30.0) + gain
    write_table(here / "set.csv", rows[0], rows)
    assert main(["figures", "set.csv", "--out", "drawn"]) == 0
    assert (here / "drawn" / "gain.png").is_file()
    results = results_of(read_table(here / "set.csv"), EpisodeResult)
    gains = gains_over_fastest(results, ["idm", "gap-mobil"])
    [axes] = gain_figure(gains, results).axes
    [curve] = axes.containers
    assert curve.get_label() == "pretrained"
    assert curve.lines[0].get_ydata().tolist() == pytest.approx([0.6, 0.6])
    # half of 0.2 m/s times 12.706; over the speeds it would be 63 m/s
    ends = curve.lines[2][0].get_segments()[0][:, 1]
    assert (ends - 0.6).tolist() == pytest.approx([-1.2706, 1.2706], abs=1e-4)
    capsys.readouterr()
    # the rule and the driver in different traffic
    write_table(here / "apart.csv", rows[0], [r for r in rows if r is not rows[0]])
    assert main(["figures", "apart.csv", "--out", "apart"]) == 0
    assert "not drawn: " in capsys.readouterr().out
    drawn = {path.name for path in (here / "apart").iterdir()}
    assert drawn == {"mean_speed.png", "speed_profile.png"}


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (["--traffic", "hazards"], "traffic.speed_gain_min is 0.0 and 1.0"),
        (["--world", "twin"], "simulation.world is sumo and twin"),
        (["--scenario", "straight"], "simulation.scenario is circular_three_lane and straight"),
        (["-o", "ego.max_speed_m_s=33"], "ego.max_speed_m_s is 30.0 and 33.0"),
    ],
)
def test_tables_of_different_traffic_are_not_drawn_together(
    other: list[str], words: str, here: Path, capsys: Capsys
) -> None:
    given = [*SHORT, "--vehicles", "3", "--episodes", "1", "--out"]
    assert main(["evaluate", "idm", "--traffic", "calm", *given, "a.csv"]) == 0
    calm = ["--traffic", "calm"] if "--traffic" not in other else []
    assert main(["evaluate", "random", *calm, *other, *given, "b.csv"]) == 0
    capsys.readouterr()
    assert main(["figures", "a.csv", "b.csv", "--out", "drawn"]) == 1
    assert f"a.csv and b.csv are of different episodes ({words}): draw" in error_message(capsys)
    assert not (here / "drawn").exists()
    assert main(["evaluate", "random", "--traffic", "calm", *given, "c.csv"]) == 0
    assert main(["figures", "a.csv", "c.csv", "--out", "drawn"]) == 0
    (here / "a.provenance.json").write_text('{"settings": 7}')
    assert main(["figures", "a.csv"]) == 1
    assert "a.csv, or the file beside it, is damaged" in error_message(capsys)


def test_the_profile_falls_at_each_speed_of_the_driver() -> None:
    drives = ("idm", 20.0), ("mine", 25.0), ("idm", 22.0), ("mine", 25.0)
    rows = [episode(driver, seed, speed) for seed, (driver, speed) in enumerate(drives)]
    idm, mine = profile_figure(rows).axes[0].lines
    assert idm.get_xdata().tolist() == [0, 20, 22, 25]
    assert idm.get_ydata().tolist() == [1, 0.5, 0, 0]
    assert mine.get_ydata().tolist() == [1, 1, 1, 0]
    assert idm.get_drawstyle() == "steps-post"


def test_the_learning_curve_of_ppo_is_the_mean_of_its_last_20_updates(
    tmp_path: Path, capsys: Capsys
) -> None:
    large, paper = tmp_path / "large", tmp_path / "paper"
    rewards = [-1.0] * 20 + [-0.5] * 20
    rows = (f"{1_000_000 * update},{reward},0\n" for update, reward in enumerate(rewards, 1))
    for run in (large, paper):
        run.mkdir()
        (run / "config.toml").touch()
    (large / "updates.csv").write_text("decisions,mean_reward,collisions\n" + "".join(rows))
    (paper / "evaluations.csv").write_text("episode,mean_reward\n100,-0.4\n")
    [axes] = learning_figure([large]).axes
    [curve] = axes.lines
    drawn = curve.get_ydata()
    assert curve.get_xdata()[[0, 39]].tolist() == [1.0, 40.0]
    assert drawn[[0, 19, 29, 39]] == pytest.approx([-1, -1, -0.75, -0.5])
    assert axes.get_xlabel() == "million decisions"
    assert learning_figure([paper]).axes[0].get_xlabel() == "training episode"
    assert main(["figures", str(large), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "learning.png").stat().st_size > 0
    assert main(["figures", str(paper), str(large), "--out", str(tmp_path / "out")]) == 1
    assert f"{large} is a training by PPO and {paper} one by Alg" in error_message(capsys)
    assert not (tmp_path / "out").exists()


def test_the_training_reward_is_drawn_behind_as_a_mean_of_the_last_20_episodes(
    tmp_path: Path,
) -> None:
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n20,-0.4\n40,-0.1\n")
    rewards = [-1.0] * 20 + [-0.5] * 20
    rows = (f"{episode},{reward}\n" for episode, reward in enumerate(rewards, 1))
    (tmp_path / "episodes.csv").write_text("episode,mean_reward\n" + "".join(rows))
    evaluated, training = learning_figure([tmp_path]).axes[0].lines
    assert evaluated.get_ydata().tolist() == [-0.4, -0.1]
    assert training.get_xdata().tolist() == list(range(1, 41))
    drawn = training.get_ydata()
    assert drawn[[0, 19, 29, 39]] == pytest.approx([-1, -1, -0.75, -0.5])
    assert training.get_zorder() < evaluated.get_zorder()
    assert training.get_color() == evaluated.get_color()


NAMES = ["_mine", "$x", r"$\frac{$", "a_$b_$", "__"]


def test_names_are_in_the_legend_as_they_are(tmp_path: Path) -> None:
    speeds = [episode(name, 0, 20.0) for name in NAMES]
    runs = [tmp_path / name for name in NAMES]
    for run in runs:
        run.mkdir()
        # a table that a spreadsheet saved begins with a byte-order mark
        (run / "evaluations.csv").write_text("\ufeffepisode,mean_reward\n100,-0.4\n")
    for figure in (speed_figure(speeds), learning_figure(runs)):
        [axes] = figure.axes
        legend = axes.get_legend()
        assert [text.get_text() for text in legend.get_texts()] == NAMES
        save_figure(figure, tmp_path / "figure.png")


def test_one_driver_in_the_same_traffic_twice_or_under_two_checks_is_not_one_curve(
    here: Path, capsys: Capsys
) -> None:
    write_rows(here / "first", episode("idm", 1, 20.0))
    write_rows(here / "again", episode("idm", 2, 20.0), episode("idm", 1, 10.0))
    write_rows(here / "strict", episode("idm", 2, 20.0, safety_check="strict"))
    assert main(["figures", "first", "--out", "."]) == 0
    assert main(["figures", "first", "again", "--out", "."]) == 1
    assert "idm drove seed 1 among 5 vehicles twice" in error_message(capsys)
    assert main(["figures", "first", "strict", "--out", "."]) == 1
    assert "rows of idm under the checks paper and strict" in error_message(capsys)


@pytest.mark.parametrize(
    ("given", "file", "text", "sentence"),
    [
        (
            "table.csv",
            "table.csv",
            "traffic,driver,vehicles,mean_speed_m_s\ncalm,idm,5,20\n",
            "has no column 'safety_check': name a table of another kind",
        ),
        (".", "evaluations.csv", "episode,mean_reward\n", "has no evaluation yet: train it for"),
        (".", "updates.csv", "decisions,mean_reward,collisions\n", "has no update yet: train it"),
        (".", "notes.txt", "", "not a run, it has neither evaluations.csv nor updates.csv: name"),
    ],
)
def test_a_run_or_a_table_without_anything_to_draw_is_refused(
    given: str, file: str, text: str, sentence: str, here: Path, capsys: Capsys
) -> None:
    (here / file).write_text(text)
    assert main(["figures", given, "--out", "out"]) == 1
    assert sentence in error_message(capsys)
    assert not (here / "out").exists()


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e400", "1e308", "9" * 400])
def test_a_number_that_cannot_be_drawn_is_one_sentence(
    number: str, tmp_path: Path, capsys: Capsys
) -> None:
    (tmp_path / "evaluations.csv").write_text(f"episode,mean_reward\n{number},-0.4\n")
    assert main(["figures", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    assert "must be a finite number" in error_message(capsys)
    table = tmp_path / "table.csv"
    for column in ("mean_speed_m_s", "vehicles", "seed"):
        write_table(table, EpisodeResult, [{**asdict(episode("idm", 0, 20.0)), column: number}])
        assert main(["figures", str(table), "--out", str(tmp_path / "out")]) == 1
        assert f"(line 2: {column} is {number[:60]})" in error_message(capsys)


def test_a_time_to_collision_of_the_results_may_be_infinite_and_no_other_number() -> None:
    fits = {"min_ttc_s": "inf", "mean_speed_m_s": "1e9", "ego_hit": "True", "mine": "nothing"}
    require_values([fits, fits | {"min_headway_s": "inf"}])
    for column, cell in (("mean_speed_m_s", "inf"), ("min_ttc_s", "nan"), ("ego_hit", "no")):
        with pytest.raises(ValueError, match=f"line 3: {column} is {cell}"):
            require_values([fits, fits | {column: cell}])


def test_a_long_name_is_shortened_in_the_legend_and_51_drivers_are_too_many(tmp_path: Path) -> None:
    name = "x" * 100_000
    figure = speed_figure([episode(name, 0, 20.0)])
    [text] = figure.axes[0].get_legend().get_texts()  # type: ignore[union-attr]
    assert text.get_text() == "x" * 77 + "..."
    save_figure(figure, tmp_path / "figure.png")  # no warning
    many = [episode(f"d{number}", 0, 20.0) for number in range(51)]
    assert len(speed_figure(many[:50]).axes[0].containers) == 50
    with pytest.raises(DrlAvError, match="hold 51 drivers, but a figure shows at most 50"):
        speed_figure(many)


def test_reward_figure_has_three_panels_with_their_best_at_the_desired_values(
    tmp_path: Path,
) -> None:
    figure = reward_figure(Config())
    curves = [panel.lines[0] for panel in figure.axes]
    best = [curve.get_xdata()[np.argmax(curve.get_ydata())] for curve in curves]
    assert best == pytest.approx([40.0, 3.8, 30.0], abs=0.06)  # as in Fig. 4 of the paper
    save_figure(figure, tmp_path / "deep" / "reward.png")
    assert (tmp_path / "deep" / "reward.png").stat().st_size > 10_000


def test_moving_average_weighs_rows_by_their_episodes_and_looks_back_only() -> None:
    episodes, values = np.array([100.0, 200, 300, 350]), np.array([4.0, 8, 0, 6])
    # 350 looks back to 150: the row of 200 is not wholly within; 300 counts twice as much as 350
    assert moving_average(episodes, values, 200) == pytest.approx([4, 6, 4, 2])
    assert moving_average(episodes, values, 10_000) == pytest.approx([4, 6, 4, 1500 / 350])


def test_a_driver_has_one_colour_and_no_interval_reaches_below_a_standstill() -> None:
    rows = [
        episode(driver, seed, speed)
        for driver, speeds in (("mine", (1.0, 9.0)), ("idm", (20.0, 21.0)), ("run.zip", (5.0, 6.0)))
        for seed, speed in enumerate(speeds)
    ]
    colors = []
    for some in (rows, rows[::-1], rows[:2] + rows[4:]):
        for draw in (speed_figure, profile_figure):
            axes = draw(some).axes[0]
            names = [text.get_text() for text in axes.get_legend().get_texts()]
            lines = axes.lines
            if draw is speed_figure:
                lines = [bar.lines[0] for bar in axes.containers]
                ends = [bar.lines[2][0].get_segments()[0][:, 1] for bar in axes.containers]
                assert min(end.min() for end in ends) == 0.0  # 5 +- 51 m/s
            colors.append({name: line.get_color() for name, line in zip(names, lines, strict=True)})
    assert all(found.items() <= colors[0].items() for found in colors)
    assert len({*colors[0].values()}) == 3


@pytest.mark.parametrize("suffix", [".pdf", ".svg", ".PNG"])
def test_a_file_is_drawn_by_its_suffix_and_says_the_check(
    suffix: str, here: Path, capsys: Capsys
) -> None:
    rows = [episode("idm", seed, 20.0 + seed, safety_check="strict") for seed in range(2)]
    write_rows(Path("rows.csv"), *rows)
    for _ in range(2):
        assert main(["figures", "rows.csv", "--out", f"f{suffix}"]) == 0
        made = {path.name: path.read_bytes() for path in here.glob(f"f*{suffix}")}
    printed = capsys.readouterr().out.splitlines()[-len(made) :]
    if suffix == ".pdf":
        assert [*made] == ["f.pdf"]
        assert made["f.pdf"].count(b"/Type /Page\n") + made["f.pdf"].count(b"/Type /Page ") == 2
        assert printed == ["f.pdf: mean_speed, speed_profile"]
        return
    assert sorted(made) == [f"f_mean_speed{suffix}", f"f_speed_profile{suffix}"]
    if suffix == ".svg":
        assert all(b"safety check: strict" in data for data in made.values())


def test_a_kind_of_file_that_is_not_drawn_is_refused_and_makes_no_folder(
    here: Path, capsys: Capsys
) -> None:
    assert main(["figures", "--out", "reward.jpg"]) == 1
    assert "ends in .png, .pdf, .svg: name such a file" in capsys.readouterr().err
    assert not Path("reward.jpg").exists()
    assert main(["figures", "--out", "v1.2"]) == 0  # a number is no kind of file
    assert Path("v1.2/reward.png").exists()


def test_a_figure_of_runs_says_their_names_and_their_check(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["train", "--out", "run", "--episodes", "1", *SHORT]
    assert main([*words, "--safety-check", "permit_all"]) == 0
    assert main(["figures", "run", "--out", "learning.svg"]) == 0
    assert "safety check: permit_all" in Path("learning.svg").read_text()
    shutil.copytree("run", "again")
    assert main(["figures", "both=run", "both=again", "--out", "both.svg"]) == 0
    assert "both, 2 trainings" in Path("both.svg").read_text()
    monkeypatch.chdir("run")
    assert main(["figures", ".", "--out", "../own.svg"]) == 0
    assert ">run<" in Path("../own.svg").read_text()


def test_no_two_drivers_of_a_figure_share_a_style_and_a_name_alone_keeps_its_own() -> None:
    names = [f"run{number}" for number in range(30)]
    alone = {name: styles_of([name])[name] for name in names}
    assert len({*alone.values()}) < 30  # checksums meet
    together = styles_of([*names, "idm", "pretrained@paper"])
    assert len({*together.values()}) == 32
    assert together == styles_of(["pretrained@paper", "idm", *names[::-1]])
    assert (together["idm"], together["pretrained@paper"]) == (STYLES["idm"], STYLES["pretrained"])
    seven = {color for color, _ in styles_of(names[:7]).values()}
    assert len(seven) == 7  # a profile shows colours only
    first, second = next(
        (a, b) for a in names for b in names if a < b and alone[a][0] == alone[b][0]
    )
    pair = styles_of([second, first])
    assert pair[first] == alone[first]
    assert pair[second][0] != alone[second][0]


def test_one_driver_under_two_checks_has_two_lines_and_a_single_number_its_own_tick() -> None:
    names = ("mine", "mine@paper", "mine@strict", "idm", "idm, strict")
    rows = [episode(name, 0, 20.0, vehicles=71) for name in names]
    [axes] = speed_figure(rows).axes
    curves = [curve.lines[0] for curve in axes.containers]
    assert [line.get_linestyle() for line in curves] == ["-", "--", ":", "-", "--"]
    mine, *_, idm, strict = (line.get_color() for line in curves)
    assert mine != idm == strict
    profile = profile_figure(rows).axes[0].lines[:4]
    assert [line.get_linestyle() for line in profile] == ["-", "--", ":", "-"]
    assert (axes.get_xticks().tolist(), axes.get_xlim()) == ([71.0], (70.0, 72.0))


@pytest.mark.parametrize(("columns", "width_in"), [("1", 3.5), ("2", 7.16)])
def test_a_figure_is_as_wide_as_columns_of_a_paper_and_its_text_is_read(
    columns: str, width_in: float, here: Path
) -> None:
    write_rows(Path("rows.csv"), episode("idm", 0, 20.0), episode("idm", 1, 21.0))
    words = ["figures", "rows.csv", "--columns", columns]
    assert main([*words, "--out", "f.svg"]) == 0
    text = Path("f_mean_speed.svg").read_text()
    [width] = re.findall(r'<svg .*?width="([\d.]+)pt"', text, re.DOTALL)
    assert float(width) == pytest.approx(72 * width_in, abs=0.5)
    assert {*re.findall(r"font-size: ([\d.]+)px", text)} == {"8"}
