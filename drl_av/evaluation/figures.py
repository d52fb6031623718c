"""Draws the reward functions of a config, learning curves, speeds and speed profiles."""

import math
import os
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.env.metrics import EpisodeResult
from drl_av.env.reward import gap_reward, lateral_reward, speed_reward
from drl_av.errors import DrlAvError, pluralize
from drl_av.evaluation.aggregates import performance_profile
from drl_av.evaluation.figure_style import legend_of_names, one_panel, panels
from drl_av.evaluation.statistics import Mean, PairedGain, grouped, mean_with_interval, scores
from drl_av.files.table import PlainNumber, read_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EPISODE_REWARDS = {"episode": PlainNumber, "mean_reward": PlainNumber}
SMOOTHED_OVER = 20
"""Number of training episodes, or of updates of PPO, in the moving mean of a learning curve."""
PLOTTED_SAFE_GAP_M = 40.0
"""d_safe in Fig. 4 of the paper, its reward functions; the reward's own is 39 m at 30 m/s."""
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
    "Algorithm 1": ("#d55e00", "o"),
}
"""Colour and marker of each driver's curve; colour-blind readers can distinguish them."""
OTHER_COLORS = ("#e69f00", "#997700", "#999933", "#aa4499", "#4433ff", "#117733", "#661100")
OTHER_STYLES = [(color, mark) for mark in ("D", "P", "X", "*", "p", "h") for color in OTHER_COLORS]
"""The styles of all other drivers."""
LINES = ("-", "--", ":", "-.")
UNBOUNDED = (-math.inf, math.inf)
APART = 0.03
"""Horizontal offset between two drivers' markers, so that error bars stay apart; the unit is the
usual distance between two numbers of vehicles."""


def moving_average(episodes: FloatArray, values: FloatArray, over: int) -> FloatArray:
    """Return the moving average of ``values`` over the last ``over`` episodes, shape (rows,).

    ``values`` and ``episodes`` have shape (rows,). The value of a row is the mean over the episodes
    since the previous row; ``episodes`` holds the last episode of each row. A row counts only if
    all of its episodes are within the window.
    """
    counts = np.diff(episodes, prepend=0.0)
    sums = np.concatenate(([0.0], np.cumsum(values * counts)))
    ends = np.concatenate(([0.0], episodes))
    begins = np.searchsorted(ends, episodes - over)
    return np.asarray((sums[1:] - sums[begins]) / (episodes - ends[begins]))


def learning_figure(
    runs: Sequence[Path], groups: Mapping[str, Sequence[Path]] = MappingProxyType({})
) -> "Figure":
    """Draw the mean reward per decision of trainings by one algorithm.

    The figure has one curve for each run's folder, like Fig. 5 of the paper: the reward of the
    greedy driver against training episodes. A second curve in a light colour shows the mean reward
    of the last ``SMOOTHED_OVER`` training episodes, which include exploration. PPO at scale drives
    no evaluations: its curve is the mean of the last ``SMOOTHED_OVER`` updates against decisions.
    Each group of ``groups``, runs by name, has one curve: their mean, within the band of its 95 %
    interval, at the points that all of them have.

    Raises:
        DrlAvError: a run has no evaluation or update yet, or a table is damaged.
    """
    first, *_ = [*runs, *(run for group in groups.values() for run in group)]
    unit, marker = ("million decisions", "") if is_ppo(first) else ("training episode", ".")
    figure, axes = one_panel(unit, "mean reward a decision")
    labels = dict[str, Path]()
    for run in runs:
        name = run.absolute().name
        labels[name if name not in labels else str(run)] = run
    curves, styles = {}, styles_of([*groups, *labels])
    for name, group in groups.items():
        found = [_evaluations(run) for run in group]
        common = sorted(set.intersection(*({*own} for own in found)))
        if not common:
            raise DrlAvError(f"The runs of {name} have no point in common.")
        means = [mean_with_interval(own[episode] for own in found) for episode in common]
        label = _of_trainings(name, len(group))
        style = {"color": styles[name][0], "marker": marker, "zorder": 2}
        curves[label] = banded_curve(axes, common, means, UNBOUNDED, **style)
    for label, run in labels.items():
        evaluated, color = _evaluations(run), styles[label][0]
        [curve] = axes.plot(
            [*evaluated], [*evaluated.values()], color=color, marker=marker, zorder=2
        )
        if (run / "episodes.csv").is_file():
            driven = read_table(run / "episodes.csv", EPISODE_REWARDS, growing=True)
            numbers, rewards = ([row[name] for row in driven] for name in EPISODE_REWARDS)
            places = np.arange(1.0, len(driven) + 1)
            training = moving_average(places, np.array(rewards), SMOOTHED_OVER)
            axes.plot(numbers, training, color=color, alpha=0.3, zorder=1)
        curves[label] = curve
    legend_of_names(axes, curves)
    return figure


def is_ppo(run: Path) -> bool:
    """Whether a folder is that of a training by PPO at scale."""
    return (run / "updates.csv").is_file()


def _evaluations(run: Path) -> dict[float, float]:
    """Return the mean reward of each evaluation by its episode, or by million decisions of PPO."""
    place, table = ("decisions", "updates") if is_ppo(run) else ("episode", "evaluations")
    columns = {place: PlainNumber, "mean_reward": PlainNumber}
    rows = read_table(run / f"{table}.csv", columns, growing=True)
    if not rows:
        raise DrlAvError(f"The run {run} has no {table[:-1]} yet: train it for longer.")
    places, rewards = (np.array([row[name] for row in rows]) for name in columns)
    if is_ppo(run):
        places = places / 1e6
        rewards = moving_average(np.arange(1.0, len(rows) + 1), rewards, SMOOTHED_OVER)
    return dict(zip(places.tolist(), rewards.tolist(), strict=True))


def _of_trainings(name: str, trainings: int) -> str:
    return f"{name}, {pluralize(trainings, 'training')}"


def banded_curve(
    axes: "Axes",
    x: Sequence[float],
    means: Sequence[Mean],
    bounds: tuple[float, float],
    **style: Any,
) -> Any:
    """Draw a curve through ``means`` in the band of their intervals, which is within ``bounds``.

    Return the curve.
    """
    [curve] = axes.plot(x, [mean.value for mean in means], **style)
    values, halves = np.array(means).T
    halves[~np.isfinite(halves)] = 0.0
    step: Any = "post" if curve.get_drawstyle() == "steps-post" else None
    low, high = np.clip((values - halves, values + halves), *bounds)
    axes.fill_between(x, low, high, step=step, color=curve.get_color(), alpha=0.2, linewidth=0)
    return curve


def reward_figure(config: Config) -> "Figure":
    """Draw the three reward functions (eq. 7 to 9) for the fixed desired values in the config.

    d_safe is ``PLOTTED_SAFE_GAP_M``, as in Fig. 4 of the paper.
    """
    y_m, v_m_s = config.reward.desired_lateral_m, config.reward.desired_speed_m_s
    gaps, sides = np.linspace(0, 60, 241), np.linspace(-1.9, 9.5, 229)
    speeds = np.linspace(15, 40, 251)
    figure, axes = panels((11, 3.2), 1, 3, sharey=True)
    axes[0].plot(gaps, [gap_reward(gap, PLOTTED_SAFE_GAP_M) for gap in gaps])
    axes[1].plot(sides, [lateral_reward(side, y_m) for side in sides])
    axes[2].plot(speeds, [speed_reward(speed, v_m_s) for speed in speeds])
    labels = ("gap to the vehicle ahead, m", "lateral position, m", "speed, m/s")
    for panel, label in zip(axes, labels, strict=True):
        panel.set_xlabel(label)
        panel.grid(alpha=0.3)
    axes[0].set_ylabel("reward")
    return figure


def profile_figure(rows: Sequence[EpisodeResult]) -> "Figure":
    """Draw performance profiles: the share of episodes with a mean speed above v, for each speed v.

    Each driver has one curve, over all its numbers of vehicles. That of a group is the mean of its
    trainings, within the band of its 95 % interval.
    """
    figure, axes = one_panel("speed v, m/s", "share of episodes faster than v")
    thresholds = sorted({0.0, *(row.mean_speed_m_s for row in rows)})
    curves, drivers = {}, grouped(rows, lambda row: row.compared_as)
    styles, lines = styles_of(drivers), lines_of(drivers)
    for name, driven in drivers.items():
        profiles = [
            performance_profile([np.array([row.mean_speed_m_s for row in own])], thresholds)
            for own in grouped(driven, lambda row: row.driver).values()
        ]
        means = [mean_with_interval(shares) for shares in zip(*profiles, strict=True)]
        style = {"color": styles[name][0], "linestyle": lines[name], "drawstyle": "steps-post"}
        curves[_label(driven)] = banded_curve(axes, thresholds, means, (0.0, 1.0), **style)
    legend_of_names(axes, curves)
    return figure


def speed_figure(rows: Sequence[EpisodeResult]) -> "Figure":
    """Draw mean speed against the number of vehicles, with 95 % intervals (Fig. 6 of the paper).

    There is one curve for each driver. The intervals are over the episodes; those of a group, which
    are a band, are over the means of its trainings, at the numbers that all of them have.

    Raises:
        DrlAvError: there are more than ``MOST_DRIVERS`` drivers, or the trainings of a group have
            no number of vehicles in common.
    """
    drivers = list(grouped(rows, lambda row: row.compared_as).values())
    if len(drivers) > MOST_DRIVERS:
        raise DrlAvError(
            f"The tables hold {len(drivers)} drivers, but a figure shows at most {MOST_DRIVERS}: "
            "draw some of them."
        )
    means = {}
    for driven in drivers:
        cells = grouped(driven, lambda row: row.vehicles)
        means[_label(driven)] = [
            (number, mean_with_interval(scores(own, "mean_speed_m_s")))
            for number, own in sorted(cells.items())
            if _trainings(own) == _trainings(driven)
        ]
        if not means[_label(driven)]:
            raise DrlAvError(
                f"The trainings of {driven[0].compared_as} have no number of vehicles in common: "
                "evaluate them together."
            )
    figure, axes = one_panel("vehicles around the ego", "mean speed of the ego, m/s")
    banded = [_label(driven) for driven in drivers if driven[0].is_training]
    legend_of_names(axes, curves_by_density(axes, means, lowest=0.0, banded=banded))
    return figure


def gain_figure(gains: Iterable[PairedGain], rows: Sequence[EpisodeResult]) -> "Figure":
    """Draw gains in mean speed over the fastest rule-based driver, with their 95 % intervals.

    The gains, of the episodes ``rows``, are paired by traffic, so that their intervals are far
    smaller than the differences between those of ``speed_figure``. There is one curve for each
    driver; zero is the rule. The intervals of a group, over its trainings, are a band.
    """
    drivers = grouped(rows, lambda row: row.compared_as)
    labels = {name: _label(own) for name, own in drivers.items()}
    banded = [labels[name] for name, own in drivers.items() if own[0].is_training]
    means: dict[str, list[tuple[float, Mean]]] = {}
    for gain in gains:
        points = means.setdefault(labels[gain.driver], [])
        points.append((gain.vehicles, gain.difference_m_s))
    figure, axes = one_panel("vehicles around the ego", "gain over the fastest rule, m/s")
    axes.axhline(0.0, color="#555555", linewidth=1)
    legend_of_names(axes, curves_by_density(axes, means, banded=banded))
    return figure


def _label(rows: Sequence[EpisodeResult]) -> str:
    """Return the name of the driver of these rows, or that of a group with its trainings."""
    name = rows[0].compared_as
    return _of_trainings(name, len(_trainings(rows))) if rows[0].is_training else name


def _trainings(rows: Iterable[EpisodeResult]) -> set[str]:
    return {row.driver for row in rows}


def styles_of(drivers: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the colour and marker of each driver of a figure; @CHECK has no effect on them.

    A driver in ``STYLES`` has the same in every figure. Each other one has those of the checksum of
    its name, unless an earlier one of this figure has the same colour: then the next free colour.
    """
    names = {driver: driver.partition("@")[0] for driver in drivers}
    styles, used = dict(STYLES), Counter[str]()
    for name in sorted({*names.values()} - STYLES.keys()):
        first = zlib.crc32(os.fsencode(name)) % len(OTHER_STYLES)
        turn = OTHER_STYLES[first:] + OTHER_STYLES[:first]
        taken = {*styles.values()}
        styles[name] = min(turn, key=lambda style: (style in taken, used[style[0]]))
        used[styles[name][0]] += 1
    return {driver: styles[name] for driver, name in names.items()}


def lines_of(drivers: Iterable[str]) -> dict[str, str]:
    """Return the line of each driver of a figure; under a second check, NAME@CHECK, it differs."""
    lines, used = dict[str, str](), Counter[str]()
    for driver in dict.fromkeys(drivers):
        name = driver.partition("@")[0]
        lines[driver] = LINES[min(used[name], len(LINES) - 1)]
        used[name] += 1
    return lines


def _ends(mean: Mean, lowest: float) -> tuple[float, float]:
    """Return how far an interval reaches down, at most to ``lowest``, and up."""
    half = mean.half_width if np.isfinite(mean.half_width) else 0.0
    return min(half, max(mean.value - lowest, 0.0)), half


def curves_by_density(
    axes: "Axes",
    means: Mapping[str, Sequence[tuple[float, Mean]]],
    joined: bool = True,
    lowest: float = -math.inf,
    banded: Sequence[str] = (),
    apart: float = APART,
) -> dict[str, Any]:
    """Draw a curve for each driver with its 95 % intervals; return the curves by driver.

    ``means`` holds the points of each driver: numbers of vehicles with their values; an infinite
    interval is left out. A driver has one colour; its curve under another check, such as
    "idm, strict", is dashed. With ``joined`` false there are only points. No interval reaches below
    ``lowest``, which is 0 for a speed. The intervals of the drivers ``banded`` are a band. The
    points of two drivers at the same number are ``apart``, in usual distances between two numbers.
    """
    curves = dict[str, Any]()
    numbers = sorted({number for own in means.values() for number, _ in own})
    usual = float(np.median(np.diff(numbers))) if len(numbers) > 1 else 1.0
    names = [driver.partition(", ")[0] for driver in means]
    styles, lines = styles_of(names), lines_of(names)
    for place, (driver, own) in enumerate(means.items()):
        name, _, check = driver.partition(", ")
        color, mark = styles[name]
        if driver in banded:
            style = {"color": color, "marker": mark, "linestyle": lines[name], "label": driver}
            x, values = zip(*own, strict=True)
            bounds = lowest, math.inf
            curves[driver] = banded_curve(axes, x, values, bounds, markersize=4, **style)
            continue
        aside = apart * usual * (place - (len(means) - 1) / 2)
        curves[driver] = axes.errorbar(
            [number + aside for number, _ in own],
            [mean.value for _, mean in own],
            yerr=np.array([_ends(mean, lowest) for _, mean in own]).T,
            color=color,
            marker=mark,
            markersize=4,
            linewidth=1.2,
            linestyle=("--" if check == "strict" else lines[name]) if joined else "",
            elinewidth=1.2,
            capsize=2,
        )
        curves[driver].set_label(driver)
    if len(numbers) == 1:
        axes.set_xticks(numbers)
        axes.set_xlim(numbers[0] - 1, numbers[0] + 1)
    return curves
