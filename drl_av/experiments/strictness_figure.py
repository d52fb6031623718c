"""The figure of what ``strict`` costs: by density, and as each of its bounds is moved."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drl_av.config import StrictConfig
from drl_av.errors import DrlAvError
from drl_av.evaluation.statistics import Mean, mean_with_interval
from drl_av.experiments.drawing import Column, read_table

COLUMNS: dict[str, Column] = {
    "check": str,
    "bound": str,
    "value": str,
    "vehicles": int,
    "seed": int,
    "mean_speed_m_s": float,
}
WORDS = {
    "braking_m_s2": "braking ahead",
    "acceleration_m_s2": "acceleration behind",
    "lateral_speed_m_s": "lateral speed",
    "follower_response_s": "follower's response",
    "follower_braking_m_s2": "follower's braking",
    "clearance_m": "clearance",
}
MARKS = "ov^sDP"
Rows = Sequence[dict[str, Any]]


def strictness_figure(table: Path) -> Figure:
    """Change of the mean speed under ``strict`` against ``paper``, paired by seed, in percent.

    Raises:
        DrlAvError: the table is missing, or is none of ``reproduction/strictness.py``.
    """
    rows = read_table(table, COLUMNS)
    figure = Figure(figsize=(11.5, 4), layout="constrained")
    by_density, by_bound = figure.subplots(1, 2)
    plain = [row for row in rows if not row["bound"]]
    numbers = sorted({row["vehicles"] for row in plain if row["check"] == "strict"})
    changes = [change(plain, plain, number) for number in numbers]
    _curve(by_density, numbers, changes, color="#d55e00", marker="o")
    by_density.set(xlabel="vehicles on the loop", ylabel="change of the mean speed, %")
    by_density.set_title("the check as it is")
    moved = [row for row in rows if row["bound"]]
    for mark, bound in zip(MARKS, dict.fromkeys(row["bound"] for row in moved), strict=False):
        _bound(by_bound, rows, bound, mark)
    by_bound.set(xlabel="bound, as a multiple of its default", ylabel="change of the mean speed, %")
    by_bound.set_title(f"one bound moved, among {moved[0]['vehicles']} vehicles" if moved else "")
    if moved:
        figure.legend(loc="outside right center", frameon=False)
    for axes in (by_density, by_bound):
        axes.axhline(0.0, color="#999999", linewidth=1)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def change(rows: Rows, plain: Rows, vehicles: int) -> Mean:
    """What ``strict`` rows lose on the ``paper`` ones of the same seeds, percent of those.

    Raises:
        DrlAvError: they are not of the same seeds.
    """
    ours, paper = (
        {
            row["seed"]: float(row["mean_speed_m_s"])
            for row in some
            if row["check"] == check and int(row["vehicles"]) == vehicles
        }
        for some, check in ((rows, "strict"), (plain, "paper"))
    )
    if not ours or ours.keys() != paper.keys():
        raise DrlAvError(
            f"The drives under strict and paper among {vehicles} vehicles are not of the same "
            "seeds: make them anew with drl-av reproduce strict."
        )
    speed = sum(paper.values()) / len(paper)
    return mean_with_interval(100 * (ours[seed] - paper[seed]) / speed for seed in ours)


def _bound(axes: Axes, rows: Rows, bound: str, mark: str) -> None:
    plain = [row for row in rows if not row["bound"]]
    own = [row for row in rows if row["bound"] == bound]
    vehicles, usual = own[0]["vehicles"], float(getattr(StrictConfig(), bound))
    found = {1.0: change(plain, plain, vehicles)}
    for value in {row["value"] for row in own}:
        moved = [row for row in own if row["value"] == value]
        found[float(value) / usual] = change(moved, plain, vehicles)
    places = sorted(found)
    label = WORDS.get(bound, bound)
    _curve(axes, places, [found[place] for place in places], label=label, marker=mark)


def _curve(axes: Axes, x: Sequence[float], means: Sequence[Mean], **looks: Any) -> None:
    values, halves = [mean.value for mean in means], [mean.half_width for mean in means]
    axes.errorbar(x, values, yerr=halves, capsize=3, **looks)
