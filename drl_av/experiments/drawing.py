"""The paper's figures from the CSV files of the other verbs; the only user of matplotlib."""

import csv
import io
from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drl_av.config import Config
from drl_av.env.reward import gap_reward, lateral_reward, safe_gap, speed_reward
from drl_av.errors import DrlAvError
from drl_av.evaluation.statistics import mean_with_interval
from drl_av.files import write_whole
from drl_av.traffic.road import FloatArray

matplotlib.use("Agg")

Column = type[int] | type[float] | type[str]
EPISODE_COLUMNS: dict[str, Column] = {"driver": str, "vehicles": int, "mean_speed_m_s": float}
EVALUATION_COLUMNS: dict[str, Column] = {"episode": int, "mean_reward": float}
STYLES = {
    "pretrained": ("#d55e00", "o"),
    "idm": ("#000000", "s"),
    "idm-mobil": ("#009e73", "v"),
    "idm-sumo": ("#0072b2", "^"),
    "random": ("#999999", "x"),
}
"""Colour, told apart by the colour-blind, and mark of the drivers that have one of their own."""
OTHER_COLORS = ("#e69f00", "#cc79a7", "#56b4e9", "#f0e442")
BESIDE = 0.15
"""Vehicles by which the marks of two drivers are set apart, so that their intervals are seen."""


def speed_figure(tables: Sequence[Path]) -> Figure:
    """Mean speed against the number of vehicles, a curve a driver, with 95 % intervals (Fig. 8)."""
    rows = [row for table in tables for row in read_table(table, EPISODE_COLUMNS)]
    figure, axes = plain_figure("vehicles on the loop", "mean speed of the ego, m/s")
    drivers = list(dict.fromkeys(row["driver"] for row in rows))
    unknown = cycle(OTHER_COLORS)
    for place, driver in enumerate(drivers):
        own = [row for row in rows if row["driver"] == driver]
        numbers = sorted({row["vehicles"] for row in own})
        means = [
            mean_with_interval(row["mean_speed_m_s"] for row in own if row["vehicles"] == number)
            for number in numbers
        ]
        color, mark = STYLES[driver] if driver in STYLES else (next(unknown), "D")
        aside = BESIDE * (place - (len(drivers) - 1) / 2)
        axes.errorbar(
            [number + aside for number in numbers],
            [mean.value for mean in means],
            yerr=[mean.half_width if np.isfinite(mean.half_width) else 0.0 for mean in means],
            label=driver,
            color=color,
            marker=mark,
            capsize=3,
        )
    axes.legend(frameon=False)
    return figure


def learning_figure(runs: Sequence[Path]) -> Figure:
    """Mean reward a decision of the greedy driver against training episodes (Fig. 7)."""
    figure, axes = plain_figure("training episode", "mean reward a decision")
    for run in runs:
        rows = read_table(run / "evaluations.csv", EVALUATION_COLUMNS)
        axes.plot(
            [row["episode"] for row in rows],
            [row["mean_reward"] for row in rows],
            marker=".",
            label=run.name,
        )
    axes.legend(frameon=False)
    return figure


def reward_figure(config: Config) -> Figure:
    """The three reward functions at the paper's desired values (Fig. 6)."""
    reward = config.reward
    safe_m = safe_gap(reward.desired_speed_m_s, reward.safe_headway_s, config.safety.minimum_gap_m)
    figure = Figure(figsize=(11, 3.2), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    gaps = np.linspace(0, 60, 241)
    _panel(panels[0], "gap to the vehicle ahead, m", gaps, [gap_reward(x, safe_m) for x in gaps])
    sides = np.linspace(-1.9, 9.5, 229)
    lateral = [lateral_reward(y, reward.desired_lateral_m) for y in sides]
    _panel(panels[1], "lateral position, m", sides, lateral)
    speeds = np.linspace(15, 40, 251)
    speed = [speed_reward(v, reward.desired_speed_m_s) for v in speeds]
    _panel(panels[2], "speed, m/s", speeds, speed)
    panels[0].set_ylabel("reward")
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all; raises DrlAvError where the disk refuses."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DrlAvError(
            f"The folder {path.parent} cannot be made ({error.strerror}): choose another one with "
            "--out."
        ) from error
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=150, metadata={"Software": None})
    write_whole(path, data.getvalue())


def read_table(path: Path, columns: Mapping[str, Column]) -> list[dict[str, Any]]:
    """Those columns of a CSV file, each value read by its column's type.

    Raises:
        DrlAvError: the file is missing, empty, lacks a column, or holds a value of another type.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DrlAvError(f"The table {path} cannot be read: {error}.") from error
    if not rows:
        raise DrlAvError(f"The table {path} has no rows: there is nothing to draw.")
    for column in columns:
        if column not in rows[0]:
            raise DrlAvError(
                f"{path} has no column {column!r}: give a file that drl-av evaluate wrote, "
                "or the folder of a run."
            )
    for line, row in enumerate(rows, start=2):
        if None in row or None in row.values():
            raise DrlAvError(f"{path}, line {line}: there are not as many values as columns.")
    return [
        {column: _value(path, line, row, column, kind) for column, kind in columns.items()}
        for line, row in enumerate(rows, start=2)
    ]


def _value(path: Path, line: int, row: dict[str, str], column: str, kind: Column) -> Any:
    try:
        return kind(row[column])
    except ValueError as error:
        raise DrlAvError(
            f"{path}, line {line}: {column} is {row[column]!r}, which is no {kind.__name__}."
        ) from error


def plain_figure(x: str, y: str) -> tuple[Figure, Axes]:
    """A figure of one panel, with what its axes are."""
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.subplots()
    plain(axes, x, y)
    return figure, axes


def plain(axes: Axes, x: str, y: str) -> None:
    """Say what the axes of a panel are, and keep its frame light."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def _panel(axes: Axes, x: str, places: FloatArray, values: list[float]) -> None:
    axes.plot(places, values)
    axes.set_xlabel(x)
    axes.grid(alpha=0.3)
