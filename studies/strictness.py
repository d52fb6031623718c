"""The experiment ``strict`` (ours): what the check ``strict`` costs the shipped driver in speed."""

from collections.abc import Iterable, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from drl_av.config import Config, StrictConfig
from drl_av.errors import DrlAvError
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.evaluation.statistics import Mean, grouped, mean_with_interval
from drl_av.files import Row
from studies import density_sweep
from studies.cells import Drives, driven_with
from studies.density_sweep import DRIVER
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import (
    collisions_cell,
    count,
    densities_of,
    markdown_table,
    mean_of,
    rows_by_density,
    up_to_30,
    values_by_traffic,
)
from studies.options import ReproduceOptions
from studies.plan import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = ("seed", "mean_speed_m_s", "collided", "ego_hit", "safety_triggers")
VEHICLES = 15
"""Number of vehicles in the evaluations with one changed bound."""
BOUNDS: dict[str, tuple[float, ...]] = {
    "braking_m_s2": (6.0, 9.0),
    "acceleration_m_s2": (4.0,),
    "lateral_speed_m_s": (1.52,),
    "follower_response_s": (1.0,),
    "follower_braking_m_s2": (3.0,),
    "clearance_m": (0.1, 2.0),
}
"""The values to which each bound of [strict] is changed; our traffic obeys the defaults."""
LABELS = {
    "braking_m_s2": "braking ahead",
    "acceleration_m_s2": "acceleration behind",
    "lateral_speed_m_s": "lateral speed",
    "follower_response_s": "follower's response",
    "follower_braking_m_s2": "follower's braking",
    "clearance_m": "clearance",
}
MARKS = "ov^sDP"
REAL_TRAFFIC = {"braking_m_s2": 9.0, "lateral_speed_m_s": 2.1}
"""Bounds of real traffic: braking on a dry road; the mean maximum lateral speed in exiD, plus two
standard deviations."""


def under(config: Config, bounds: str) -> Config:
    """Return the settings with another safety check.

    Args:
        config: The settings to change.
        bounds: ``"paper"`` for the check ``paper``, ``"strict"`` for the check ``strict`` with the
            bounds of ``config``, or ``"real"`` for ``strict`` with ``REAL_TRAFFIC``.
    """
    if bounds == "paper":
        return config.updated("safety", check="paper")
    strict = config.updated("safety", check="strict")
    return strict.updated("strict", **REAL_TRAFFIC) if bounds == "real" else strict


def strict_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to evaluate the shipped driver under ``paper`` and ``strict`` at each density.

    It is also evaluated among 15 vehicles under ``strict``, with one bound changed at a time.
    """
    config = options.settings_of([DRIVER])
    keys = [(check, "", "", n) for n in DENSITIES for check in ("paper", "strict")]
    keys += [
        ("strict", bound, f"{value:g}", VEHICLES)
        for bound, values in BOUNDS.items()
        for value in values
    ]
    cells = []
    for check, bound, value, vehicles in keys:
        own = config.updated("safety", check=check)
        if bound:
            own = own.updated("strict", **{bound: float(value)})
        named = (("check", check), ("bound", bound), ("value", value))
        cells.append(Drives(own, (DRIVER,), vehicles, options.drives, COLUMNS, named))

    def place(row: Row) -> tuple[int, int]:
        key = (row["check"], row["bound"], row["value"], int(row["vehicles"]))
        return keys.index(key), int(row["seed"])

    return Plan(driven_with(config, [DRIVER]), [cells], place)


def strict_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the speed change from ``paper`` to ``strict``, and collisions.

    It has one column for each density.
    """
    rows = [row for row in results.rows("strict.csv") if not row["bound"]]
    strict = rows_by_density(row for row in rows if row["check"] == "strict")
    lines = [
        ["change, %", *(str(change(rows, rows, density)) for density in strict)],
        ["collisions", *map(collisions_cell, strict.values())],
    ]
    return markdown_table(["vehicles", *map(str, strict)], lines)


def summary_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's results over all densities up to 30 vehicles.

    The shipped driver has a second row, under ``strict``. The gain is that of the shipped driver
    under ``paper`` over the driver of the row, paired by traffic.
    """
    strict = [row for row in results.rows("strict.csv") if row["check"] == "strict"]
    strict = [row | {"driver": f"{DRIVER}, strict"} for row in strict if not row["bound"]]
    driven: dict[str, list[Row]] = {DRIVER: [], f"{DRIVER}, strict": strict}
    driven |= grouped(up_to_30(density_sweep.rows_with_acc(results)), itemgetter("driver"))
    gains = density_sweep.gains_over_all(row for rows in driven.values() for row in rows)
    lines = [
        [
            f"`{name}`",
            f"{mean_of(rows, 'mean_speed_m_s'):.2f}",
            str(gains.get(name, "")),
            f"{count(rows, 'ego_hit')}/{len(rows)}",
        ]
        for name, rows in driven.items()
    ]
    names = ("driver", "mean speed, m/s", f"gain of `{DRIVER}`, m/s", "ego hit")
    return markdown_table(names, lines)


def strict_figure(rows: list[Row]) -> "Figure":
    """Draw the change in mean speed from ``paper`` to ``strict``, %, by density and by bound."""
    figure, (by_density, by_bound) = panels((11.5, 4), 1, 2)
    plain = [row for row in rows if not row["bound"]]
    numbers = densities_of(row for row in plain if row["check"] == "strict")
    changes = [change(plain, plain, number) for number in numbers]
    draw_changes(by_density, numbers, changes, color="#d55e00", marker="o")
    by_density.set_title("the check as it is")
    changed = [row for row in rows if row["bound"]]
    for mark, own in zip(MARKS, grouped(changed, itemgetter("bound")).values(), strict=False):
        _bound(by_bound, plain, own, mark)
    if changed:
        by_bound.set_title(f"one bound moved, among {changed[0]['vehicles']} vehicles")
        figure.legend(loc="outside right center", frameon=False)
    labels = ("vehicles on the loop", "bound, as a multiple of its default")
    for axes, label in zip((by_density, by_bound), labels, strict=True):
        label_axes(axes, label, "change of the mean speed, %")
        axes.axhline(0.0, color="#999999", linewidth=1)
    return figure


def change(rows: Iterable[Row], plain: Iterable[Row], vehicles: int) -> Mean:
    """Return the change in mean speed from ``paper`` to ``strict`` at a number of vehicles, %.

    It compares the rows of ``rows`` under ``strict`` with those of ``plain`` under ``paper``, and
    ignores all others.

    Raises:
        DrlAvError: the episodes do not have the same traffic seeds.
    """
    ours, paper = (
        [row for row in some if row["check"] == check and int(row["vehicles"]) == vehicles]
        for some, check in ((rows, "strict"), (plain, "paper"))
    )
    return speed_change(ours, paper)


def speed_change(changed: Iterable[Row], plain: Iterable[Row]) -> Mean:
    """Return the mean change of the speed from ``plain`` to ``changed``, percent.

    100 % is the mean speed in ``plain``; a negative change is a loss of speed. Episodes with the
    same number of vehicles and traffic seed are compared.

    Raises:
        DrlAvError: ``changed`` and ``plain`` are not episodes in the same traffic.
    """
    after, before = values_by_traffic(changed), values_by_traffic(plain)
    if not after or after.keys() != before.keys():
        raise DrlAvError(
            "The drives under strict and paper are not of the same seeds: make them again with "
            "python -m studies."
        )
    speed = sum(before.values()) / len(before)
    return mean_with_interval(100 * (after[seed] - before[seed]) / speed for seed in after)


def _bound(axes: "Axes", plain: Sequence[Row], own: Sequence[Row], mark: str) -> None:
    bound, vehicles = own[0]["bound"], int(own[0]["vehicles"])
    usual = float(getattr(StrictConfig(), bound))
    found = {1.0: change(plain, plain, vehicles)}
    for value, changed in grouped(own, itemgetter("value")).items():
        found[float(value) / usual] = change(changed, plain, vehicles)
    places = sorted(found)
    label = LABELS.get(bound, bound)
    draw_changes(axes, places, [found[place] for place in places], label=label, marker=mark)


def draw_changes(axes: "Axes", x: Sequence[float], means: Sequence[Mean], **looks: Any) -> None:
    """Draw a curve of changes with their 95 % intervals; ``looks`` go to ``axes.errorbar``."""
    values, halves = [mean.value for mean in means], [mean.half_width for mean in means]
    axes.errorbar(x, values, yerr=halves, capsize=3, **looks)


STRICT = Experiment(
    name="strict",
    meaning="the speed that the check strict costs the shipped driver, with each of its bounds",
    row="an episode under paper or strict, or under strict with one bound changed",
    plan=strict_plan,
    summaries={"strict": strict_table, "summary": summary_table},
    figures={"strict": strict_figure},
)
