"""The figure of the barricaded lane: what learning without a safety check costs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drl_av.experiments.drawing import Column, read_table

COLUMNS: dict[str, Column] = {
    "safety_check": str,
    "seed": int,
    "phase": str,
    "episode": int,
    "decisions": int,
    "barricade_proposals": int,
    "hit": str,
}
LOOKS = {"permit_all": ("#c2185b", "without a check"), "paper": ("#1976d2", "with the check")}
Rows = Sequence[dict[str, Any]]


def barricade_figure(table: Path) -> Figure:
    """Collisions with the barricade while learning, and what the trained drivers propose.

    Raises:
        DrlAvError: the table is missing, or none that ``write_barricade_rows`` wrote.
    """
    rows = read_table(table, COLUMNS)
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    learning, trained = figure.subplots(1, 2, width_ratios=(3, 2))
    for place, check in enumerate(dict.fromkeys(row["safety_check"] for row in rows)):
        own = [row for row in rows if row["safety_check"] == check]
        color, label = LOOKS.get(check, ("#546e7a", check))
        _learning(learning, [row for row in own if row["phase"] == "training"], color, label)
        _trained(trained, [row for row in own if row["phase"] == "trained"], (place, label, color))
    learning.set(xlabel="training episode", ylabel="collisions with the barricade so far")
    learning.set_title("while learning")
    learning.set_ylim(bottom=-0.5)
    learning.legend(frameon=False)
    trained.set(ylabel="decisions for the barricaded lane, %", title="the trained drivers")
    trained.set_xlim(-0.6, trained.get_xlim()[1] + 0.2)
    for axes in (learning, trained):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _by_seed(rows: Rows) -> list[Rows]:
    return [[row for row in rows if row["seed"] == seed] for seed in {row["seed"] for row in rows}]


def _learning(axes: Axes, rows: Rows, color: str, label: str) -> None:
    """A line a training, their mean in bold."""
    runs = [np.cumsum([row["hit"] == "barricade" for row in own]) for own in _by_seed(rows)]
    episodes = np.arange(1, len(runs[0]) + 1)
    for run in runs:
        axes.plot(episodes, run, color=color, alpha=0.35, linewidth=1)
    axes.plot(episodes, np.mean(runs, axis=0), color=color, linewidth=2, label=label)


def _trained(axes: Axes, rows: Rows, bar: tuple[int, str, str]) -> None:
    """A dot a driver, and how many episodes of all ended in a collision of its own making."""
    place, label, color = bar
    shares = [
        100 * sum(row["barricade_proposals"] for row in own) / sum(row["decisions"] for row in own)
        for own in _by_seed(rows)
    ]
    hits = sum(row["hit"] not in ("", "by vehicle") for row in rows)
    axes.bar(place, float(np.mean(shares)), width=0.6, color=color, alpha=0.35)
    axes.plot([place] * len(shares), shares, "o", color=color)
    axes.set_xticks([*range(place + 1)])
    names = [*axes.get_xticklabels()][:place]
    told = f"{label}\nhit something in\n{hits} of {len(rows)} episodes"
    axes.set_xticklabels([*(name.get_text() for name in names), told])
