"""The figures of results: what is drawn is what the tables say, each with its interval."""

import csv
from pathlib import Path

import numpy as np
import pytest

from drl_av.errors import DrlAvError
from drl_av.experiments.adaptation_figure import adaptation_figure, moving_average
from drl_av.experiments.curves_figure import check_figure, replay_figure
from drl_av.experiments.figures import published


def curves_table(folder: Path) -> Path:
    """Two seeds to episode 300, the first to 500; no row of the third variant."""
    names = "variant,seed,episode,mean_reward,training_reward,training_collisions,safety_triggers"
    rows = [
        (variant, seed, episode, base - seed / 10, -0.9, 0.4 + seed / 10, 7)
        for variant, base in (("paper", -0.1), ("permit_all", -0.5))
        for seed, last in ((0, 500), (1, 300))
        for episode in range(100, last + 1, 100)
    ]
    with (folder / "curves.csv").open("w", newline="") as file:
        csv.writer(file).writerows([names.split(","), *rows])
    return folder / "curves.csv"


def test_check_figure_has_means_over_seeds_and_goes_on_with_the_longer_one(tmp_path: Path) -> None:
    reward, exploring, collisions = check_figure(curves_table(tmp_path)).axes
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


def test_replay_figure_draws_the_variants_there_are(tmp_path: Path) -> None:
    reward, triggers = replay_figure(curves_table(tmp_path)).axes
    labels = [line.get_label() for line in reward.lines]
    assert "two buffers, safety check (2 seeds)" in labels
    assert not any("no safety check" in str(label) for label in labels)
    assert triggers.lines[0].get_ydata() == pytest.approx([7] * 3)


def test_moving_average_weighs_rows_by_their_episodes_and_looks_back_only() -> None:
    episodes, values = np.array([100.0, 200, 300, 350]), np.array([4.0, 8, 0, 6])
    # 350 looks back to 150: the row of 200 is not wholly within; 300 counts twice as much as 350
    assert moving_average(episodes, values, 200) == pytest.approx([4, 6, 4, 2])
    assert moving_average(episodes, values, 10_000) == pytest.approx([4, 6, 4, 1500 / 350])


def test_adaptation_figure_draws_both(tmp_path: Path) -> None:
    lines = [
        f"{v},0,{e},{t}\n" for v, t in (("adaptation", 3), ("no_adaptation", 5)) for e in (100, 200)
    ]
    table = tmp_path / "adaptation.csv"
    table.write_text("variant,seed,episode,training_safety_triggers\n" + "".join(lines))
    [axes] = adaptation_figure(table).axes
    drawn = {line.get_label(): list(line.get_ydata()) for line in axes.lines}
    assert drawn["goes on learning"] == [3, 3]
    assert drawn["does not"] == [5, 5]


def test_a_folder_yields_the_figures_whose_tables_it_has(tmp_path: Path) -> None:
    with pytest.raises(DrlAvError, match="neither a run nor results"):
        dict(published(tmp_path))
    curves_table(tmp_path)
    assert set(dict(published(tmp_path))) == {"learning_check", "learning_replay"}
