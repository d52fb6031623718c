"""Draws the reward functions of a config, learning curves, speeds and speed profiles."""

import math
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drl_av.config import Config
from drl_av.env.reward import gap_reward, lateral_reward, safe_gap, speed_reward
from drl_av.errors import DrlAvError
from drl_av.evaluation.aggregates import performance_profile
from drl_av.evaluation.figure_style import legend_of_names, one_panel, panels
from drl_av.evaluation.statistics import Mean, grouped, mean_with_interval, moving_average
from drl_av.files import PlainNumber, read_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EPISODE_COLUMNS = {"driver": str, "vehicles": PlainNumber, "mean_speed_m_s": PlainNumber}
EVALUATION_COLUMNS = {"episode": PlainNumber, "mean_reward": PlainNumber}
SMOOTHED_OVER = 20
"""Number of training episodes in the moving mean of a learning curve."""
MOST_DRIVERS = 50
"""Largest number of drivers in ``speed_figure``."""
STYLES = {
    "pretrained": ("#d55e00", "o"),
    "idm": ("#000000", "s"),
    "idm-mobil": ("#009e73", "v"),
    "idm-sumo": ("#0072b2", "^"),
    "gap-mobil": ("#cc79a7", "D"),
    "gap-mobil-1.3": ("#882255", "d"),
    "sumo": ("#56b4e9", "<"),
    "sumo-tuned": ("#332288", ">"),
    "random": ("#999999", "x"),
}
"""Colour and marker of each driver's curve; colour-blind readers can distinguish them."""
OTHER_COLORS = ("#e69f00", "#997700", "#999933", "#aa4499", "#44aa99", "#117733", "#661100")
OTHER_STYLES = [(color, mark) for mark in ("D", "P", "X", "*", "p", "h") for color in OTHER_COLORS]
"""The styles of all other drivers."""
BESIDE = 0.15
"""Horizontal offset between two drivers' markers, in vehicles, so that error bars stay apart."""


def learning_figure(runs: Sequence[Path]) -> "Figure":
    """Draw the greedy driver's mean reward per decision against training episodes.

    The figure has one curve for each run's folder, like Fig. 5 of the paper. A second curve in a
    light colour shows the mean reward of the last ``SMOOTHED_OVER`` training episodes, which
    include exploration.

    Raises:
        DrlAvError: a run has no evaluation yet, or a table is damaged.
    """
    figure, axes = one_panel("training episode", "mean reward a decision")
    curves = {}
    for run in runs:
        rows = read_table(run / "evaluations.csv", EVALUATION_COLUMNS, growing=True)
        if not rows:
            raise DrlAvError(f"The run {run} has no evaluation yet: train it for longer.")
        episodes, rewards = ([row[name] for row in rows] for name in EVALUATION_COLUMNS)
        [curve] = axes.plot(episodes, rewards, marker=".", zorder=2)
        if (run / "episodes.csv").is_file():
            driven = read_table(run / "episodes.csv", EVALUATION_COLUMNS, growing=True)
            numbers, rewards = ([row[name] for row in driven] for name in EVALUATION_COLUMNS)
            places = np.arange(1.0, len(driven) + 1)
            training = moving_average(places, np.array(rewards), SMOOTHED_OVER)
            axes.plot(numbers, training, color=curve.get_color(), alpha=0.3, zorder=1)
        curves[run.name if run.name not in curves else str(run)] = curve
    legend_of_names(axes, curves)
    return figure


def reward_figure(config: Config) -> "Figure":
    """Draw the three reward functions for the fixed desired values in the config.

    The figure corresponds to Fig. 4 of the paper.
    """
    reward = config.reward
    y_m, v_m_s = reward.desired_lateral_m, reward.desired_speed_m_s
    safe_m = safe_gap(v_m_s, reward.safe_headway_s, config.safety.minimum_gap_m)
    gaps, sides = np.linspace(0, 60, 241), np.linspace(-1.9, 9.5, 229)
    speeds = np.linspace(15, 40, 251)
    figure, axes = panels((11, 3.2), 1, 3, sharey=True)
    axes[0].plot(gaps, [gap_reward(gap, safe_m) for gap in gaps])
    axes[1].plot(sides, [lateral_reward(side, y_m) for side in sides])
    axes[2].plot(speeds, [speed_reward(speed, v_m_s) for speed in speeds])
    labels = ("gap to the vehicle ahead, m", "lateral position, m", "speed, m/s")
    for panel, label in zip(axes, labels, strict=True):
        panel.set_xlabel(label)
        panel.grid(alpha=0.3)
    axes[0].set_ylabel("reward")
    return figure


def profile_figure(rows: Sequence[Mapping[str, Any]]) -> "Figure":
    """Draw performance profiles: the share of episodes with a mean speed above v, for each speed v.

    Each driver has one curve, over all its numbers of vehicles.
    """
    figure, axes = one_panel("speed v, m/s", "share of episodes faster than v")
    thresholds = sorted({0.0, *(row["mean_speed_m_s"] for row in rows)})
    curves, drivers = {}, grouped(rows, itemgetter("driver"))
    styles = styles_of(drivers)
    for driver, own in drivers.items():
        speeds = np.array([row["mean_speed_m_s"] for row in own])
        profile = performance_profile([speeds], thresholds)
        color, _ = styles[driver]
        [curves[driver]] = axes.step(thresholds, profile, where="post", color=color)
    legend_of_names(axes, curves)
    return figure


def speed_figure(rows: Sequence[Mapping[str, Any]]) -> "Figure":
    """Draw mean speed against the number of vehicles, with 95 % intervals (Fig. 6 of the paper).

    There is one curve for each driver. The rows need at least the columns ``driver``, ``vehicles``
    and ``mean_speed_m_s``.

    Raises:
        DrlAvError: there are more than ``MOST_DRIVERS`` drivers.
    """
    drivers = grouped(rows, itemgetter("driver"))
    if len(drivers) > MOST_DRIVERS:
        raise DrlAvError(
            f"The tables hold {len(drivers)} drivers, but a figure shows at most {MOST_DRIVERS}: "
            "draw some of them."
        )
    means = {}
    for driver, driven in drivers.items():
        cells = grouped(driven, lambda row: int(row["vehicles"]))
        means[driver] = {
            number: mean_with_interval(float(row["mean_speed_m_s"]) for row in cells[number])
            for number in sorted(cells)
        }
    figure, axes = one_panel("vehicles around the ego", "mean speed of the ego, m/s")
    legend_of_names(axes, curves_by_density(axes, means, lowest=0.0))
    return figure


def styles_of(drivers: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the colour and marker of each driver of a figure; @CHECK has no effect.

    A driver in ``STYLES`` has the same in every figure. Each other one has those of the checksum of
    its name, unless an earlier one of this figure has the same colour: then the next free colour.
    """
    names = {driver: driver.partition("@")[0] for driver in drivers}
    styles, used = dict(STYLES), Counter[str]()
    for name in sorted({*names.values()} - STYLES.keys()):
        first = zlib.crc32(name.encode()) % len(OTHER_STYLES)
        turn = OTHER_STYLES[first:] + OTHER_STYLES[:first]
        taken = {*styles.values()}
        styles[name] = min(turn, key=lambda style: (style in taken, used[style[0]]))
        used[styles[name][0]] += 1
    return {driver: styles[name] for driver, name in names.items()}


def _ends(mean: Mean, lowest: float) -> tuple[float, float]:
    """Return how far an interval reaches down, at most to ``lowest``, and up."""
    half = mean.half_width if np.isfinite(mean.half_width) else 0.0
    return min(half, max(mean.value - lowest, 0.0)), half


def curves_by_density(
    axes: "Axes",
    means: Mapping[str, Mapping[int, Mean]],
    joined: bool = True,
    lowest: float = -math.inf,
) -> dict[str, Any]:
    """Draw a curve for each driver with its 95 % intervals; return the curves by driver.

    ``means`` holds the values by driver and by number of vehicles; an infinite interval is left
    out. A driver has one colour; its curve under another check, such as "idm, strict", is dashed.
    With ``joined`` false there are only points. No interval reaches below ``lowest``, which is 0
    for a speed.
    """
    curves = dict[str, Any]()
    styles = styles_of(driver.partition(", ")[0] for driver in means)
    for place, (driver, own) in enumerate(means.items()):
        name, _, check = driver.partition(", ")
        color, mark = styles[name]
        aside = BESIDE * (place - (len(means) - 1) / 2)
        curves[driver] = axes.errorbar(
            [number + aside for number in own],
            [mean.value for mean in own.values()],
            yerr=np.array([_ends(mean, lowest) for mean in own.values()]).T,
            color=color,
            marker=mark,
            markersize=4,
            linewidth=1.2,
            linestyle=("--" if check == "strict" else "-") if joined else "",
            elinewidth=1.2,
            capsize=2,
        )
        curves[driver].set_label(driver)
    return curves
