"""Figures come from the CSV files of other verbs; a wrong file is told in one sentence."""

from pathlib import Path

import pytest

from drl_av.config import Config
from drl_av.errors import DrlAvError
from drl_av.experiments.drawing import learning_figure, reward_figure, save_figure, speed_figure

HEADER = "driver,vehicles,mean_speed_m_s\n"


def table(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text)
    return path


def test_speed_figure_has_a_curve_for_each_driver_through_its_means(tmp_path: Path) -> None:
    rows = "idm,5,20\nidm,5,22\nidm,30,18\nmine,5,25\nmine,30,19\n"
    [axes] = speed_figure([table(tmp_path, HEADER + rows)]).axes
    curves = {c.get_label(): c.lines[0] for c in axes.containers}
    assert set(curves) == {"idm", "mine"}
    assert curves["idm"].get_xdata().tolist() == pytest.approx([5, 30], abs=0.1)
    assert curves["idm"].get_ydata().tolist() == [21.0, 18.0]


def test_learning_figure_follows_the_evaluations_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "evaluations.csv").write_text("episode,mean_reward\n100,-0.4\n200,-0.1\n")
    [axes] = learning_figure([tmp_path]).axes
    assert axes.lines[0].get_ydata().tolist() == [-0.4, -0.1]


def test_reward_figure_has_three_panels_with_their_best_at_the_desired_values(
    tmp_path: Path,
) -> None:
    figure = reward_figure(Config())
    best = [
        panel.lines[0].get_xdata()[panel.lines[0].get_ydata().argmax()]
        if hasattr(panel.lines[0].get_ydata(), "argmax")
        else panel.lines[0].get_xdata()[
            max(range(len(panel.lines[0].get_ydata())), key=panel.lines[0].get_ydata().__getitem__)
        ]
        for panel in figure.axes
    ]
    assert best == pytest.approx([39.0, 3.8, 30.0], abs=0.06)
    save_figure(figure, tmp_path / "deep" / "reward.png")
    assert (tmp_path / "deep" / "reward.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (HEADER, "has no rows"),
        ("driver,vehicles\nidm,5\n", "no column 'mean_speed_m_s'"),
        (HEADER + "idm,five,20\n", "line 2: vehicles is 'five', which is no int"),
        (HEADER + "idm,5,20\nidm,5\n", "line 3: there are not as many values as columns"),
        (HEADER + "idm,5,20,x\n", "line 2: there are not as many values as columns"),
    ],
)
def test_a_wrong_table_is_told(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(DrlAvError, match=sentence):
        speed_figure([table(tmp_path, text)])


def test_a_missing_table_is_told(tmp_path: Path) -> None:
    with pytest.raises(DrlAvError, match="cannot be read"):
        speed_figure([tmp_path / "none.csv"])
