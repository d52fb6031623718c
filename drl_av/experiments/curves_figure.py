"""Learning curves as means over seeds with 95 % bands, two variants side by side (Fig. 7 and 9)."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drl_av.errors import DrlAvError
from drl_av.experiments.convergence import converged_at, curve
from drl_av.experiments.drawing import plain
from drl_av.experiments.tables import read_rows
from drl_av.files import Row

PAPER_REWARD = -0.025
"""Reward a decision of the paper's trained driver, Sec. IV-C."""
LABELS = {
    "paper": "two buffers, safety check",
    "permit_all": "two buffers, no safety check",
    "prioritized": "prioritized replay, safety check",
}
COLORS = {"paper": "#d55e00", "permit_all": "#000000", "prioritized": "#0072b2"}
PANELS = {
    "mean_reward": "mean reward a decision, greedy",
    "training_reward": "the same while exploring",
    "training_collisions": "collisions an episode while exploring",
    "safety_triggers": "safety triggers an episode, greedy",
}


def check_figure(table: Path) -> Figure:
    """Learning with the safety check and without it: reward and collisions (Fig. 7)."""
    columns = ("mean_reward", "training_reward", "training_collisions")
    return _figure(table, ("paper", "permit_all"), columns)


def replay_figure(table: Path) -> Figure:
    """Two buffers against prioritized replay: reward and safety triggers (Fig. 9, left)."""
    return _figure(table, ("paper", "prioritized"), ("mean_reward", "safety_triggers"))


def _figure(table: Path, variants: Sequence[str], columns: Sequence[str]) -> Figure:
    rows = read_rows(table)
    variants = [name for name in variants if any(row["variant"] == name for row in rows)]
    if not variants:
        raise DrlAvError(f"{table} has no rows to draw: make it with drl-av reproduce curves.")
    figure = Figure(figsize=(1 + 5 * len(columns), 4.0), layout="constrained")
    panels = figure.subplots(1, len(columns))
    for axes, column in zip(panels, columns, strict=True):
        plain(axes, "training episode", PANELS[column])
        for variant in variants:
            _draw(axes, rows, variant, column)
        if "reward" not in column:
            axes.set_ylim(bottom=-0.02 * axes.get_ylim()[1])
    told = f"the paper's {PAPER_REWARD}"
    panels[0].axhline(PAPER_REWARD, color="#555555", linestyle=":", linewidth=1, label=told)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False)
    return figure


def _draw(axes: Axes, rows: Sequence[Row], variant: str, column: str) -> None:
    """Mean and band as far as all seeds go, a dot where it converged; thin, those that go on."""
    found, color = curve(rows, variant, column), COLORS[variant]
    seeds = len(found.values)
    means = np.array([mean.value for mean in found.means])
    halves = np.array([mean.half_width for mean in found.means])
    label = f"{LABELS[variant]} ({seeds} {'seed' if seeds == 1 else 'seeds'})"
    axes.plot(found.episodes, means, color=color, label=label)
    if np.isfinite(halves).all():
        axes.fill_between(
            found.episodes, means - halves, means + halves, color=color, alpha=0.2, linewidth=0
        )
    own = [r for r in rows if r["variant"] == variant and int(r["episode"]) >= found.episodes[-1]]
    for seed in sorted({row["seed"] for row in own}):
        longer = curve([row for row in own if row["seed"] == seed], variant, column)
        axes.plot(longer.episodes, longer.values[0], color=color, linewidth=0.8, alpha=0.6)
    if column == "mean_reward":
        at = converged_at(found.episodes, means.tolist())
        axes.plot(at, means[found.episodes.index(at)], "o", color=color, markersize=7)
