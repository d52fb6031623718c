"""Makes the table and the figure of ``verification/shielding.py``."""

from operator import itemgetter
from pathlib import Path

import numpy as np

from drl_av.evaluation.figure_style import label_axes, panels, save_figure
from drl_av.evaluation.statistics import Mean, grouped, mean_with_interval
from drl_av.evaluation.table import read_rows
from drl_av.files.table import Row
from studies.results import markdown_table

METHODS = ("masking", "replacement", "replacement and penalty")
TRAINING, FINAL = "training", "final"
COLUMNS = (
    *("method", "seed", "stage", "step"),
    *("mean_reward", "mean_speed_m_s", "refused_share", "ego_hits"),
)
"""The columns of the table. In a row of a training, ``step`` is the last decision; in a row of an
evaluation, it is the number of vehicles."""
CURVES = {
    "mean_reward": ("reward per decision", 1.0),
    "mean_speed_m_s": ("mean speed, m/s", 1.0),
    "refused_share": ("refused actions, %", 100.0),
}
"""The columns in the figure, each with its label and the factor that converts it to its unit."""


def over_seeds(rows: list[Row], column: str) -> Mean:
    """Return the mean of a column over trainings, with its 95 % interval.

    For each training the mean over its rows is computed first.
    """
    trainings = grouped(rows, itemgetter("seed")).values()
    values = ([float(row[column]) for row in own] for own in trainings)
    return mean_with_interval(sum(own) / len(own) for own in values)


def table(rows: list[Row]) -> str:
    """Return the Markdown table of each method, during the trainings and in the evaluation.

    The values are means over the trainings with 95 % intervals.
    """
    lines = []
    for method in METHODS:
        for stage in (TRAINING, FINAL):
            own = [row for row in rows if (row["method"], row["stage"]) == (method, stage)]
            if not own:
                continue
            cells = [method, stage, str(len({row["seed"] for row in own}))]
            for column, (_, factor) in CURVES.items():
                mean = over_seeds(own, column)
                places = 3 if column == "mean_reward" else 2
                value, half = factor * mean.value, factor * mean.half_width
                cells.append(f"{value:.{places}f} ± {half:.{places}f}")
            lines.append([*cells, str(sum(int(row["ego_hits"]) for row in own))])
    names = ["method", "stage", "trainings", *(label for label, _ in CURVES.values()), "ego hits"]
    return markdown_table(names, lines)


def section(folder: Path) -> str:
    """Return the table of ``shielding.csv`` as Markdown, or a note without rows."""
    rows = read_rows(folder / "shielding.csv")
    return table(rows) if rows else "*The trainings have not been made yet.*"


def figure(rows: list[Row], path: Path) -> None:
    """Draw the learning curves with 95 % intervals to a PNG file; raises DrlAvError on failure."""
    drawing, axes = panels((12, 4), 1, len(CURVES))
    learning = [row for row in rows if row["stage"] == TRAINING]
    for axis, (column, (label, factor)) in zip(axes, CURVES.items(), strict=True):
        for method in METHODS:
            own = [row for row in learning if row["method"] == method]
            steps = sorted({int(row["step"]) for row in own})
            groups = ([row for row in own if int(row["step"]) == step] for step in steps)
            means = np.array([over_seeds(group, column) for group in groups])
            value, half = means.reshape(-1, 2).T
            [line] = axis.plot(steps, factor * value, label=method)
            band = factor * (value - half), factor * (value + half)
            axis.fill_between(steps, *band, color=line.get_color(), alpha=0.2, linewidth=0)
        label_axes(axis, "decisions of training", label)
    handles, labels = axes[0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    save_figure(drawing, path)
