"""Safety triggers of a driver that goes on learning, and of one that does not (Fig. 9, right)."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from drl_av.errors import DrlAvError
from drl_av.experiments.drawing import plain_figure
from drl_av.experiments.tables import read_rows
from drl_av.files import Row
from drl_av.traffic.road import FloatArray

FILTERED_OVER = 10_000
"""Episodes of the paper's moving average, Sec. IV-D."""
LABELS = {"adaptation": "goes on learning", "no_adaptation": "does not"}
COLORS = {"adaptation": "#d55e00", "no_adaptation": "#000000"}


def adaptation_figure(table: Path) -> Figure:
    """Mean over the episodes before, 10,000 or as many as there are; faint, what it is made of."""
    rows = read_rows(table)
    if not rows:
        raise DrlAvError(f"{table} has no rows to draw: make it with drl-av reproduce adaptation.")
    figure, axes = plain_figure(
        "episode", f"safety triggers an episode\n(mean of the last {FILTERED_OVER:,} episodes)"
    )
    for variant, label in LABELS.items():
        episodes, triggers = _over_seeds([row for row in rows if row["variant"] == variant])
        if len(episodes):
            axes.plot(episodes, triggers, color=COLORS[variant], alpha=0.2, linewidth=0.7)
            filtered = moving_average(episodes, triggers, FILTERED_OVER)
            axes.plot(episodes, filtered, color=COLORS[variant], label=label, linewidth=2)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)
    return figure


def _over_seeds(rows: list[Row]) -> tuple[FloatArray, FloatArray]:
    """Episodes that every seed has, and the mean over the seeds of their triggers."""
    seeds: dict[str, dict[int, float]] = {}
    for row in rows:
        own = seeds.setdefault(row["seed"], {})
        own[int(row["episode"])] = float(row["training_safety_triggers"])
    episodes = sorted(set.intersection(*map(set, seeds.values()))) if seeds else []
    means = [np.mean([seed[episode] for seed in seeds.values()]) for episode in episodes]
    return np.array(episodes, float), np.array(means, float)


def moving_average(episodes: FloatArray, values: FloatArray, over: int) -> FloatArray:
    """At each row the mean of the last ``over`` episodes, of rows that are wholly among them."""
    counts = np.diff(episodes, prepend=0.0)
    sums = np.concatenate(([0.0], np.cumsum(values * counts)))
    ends = np.concatenate(([0.0], episodes))
    begins = np.searchsorted(ends, episodes - over)
    return np.asarray((sums[1:] - sums[begins]) / (episodes - ends[begins]))
