"""The experiment ``density_sweep``: mean speed against the number of vehicles.

It corresponds to Fig. 8 of the paper, and goes on to densities at which the drivers are equally
fast.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from drl_av.config import Config
from drl_av.drivers.registry import default_config, find_drivers
from drl_av.errors import DrlAvError, counted
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.paired import Paired, Speed, paired
from drl_av.evaluation.statistics import Mean, mean_with_interval
from drl_av.experiments.canvas import legend_of_names, one_panel
from drl_av.experiments.cells import Drives, driven_with
from drl_av.experiments.experiment import Experiment, Results
from drl_av.experiments.markdown import (
    PAPER_VEHICLES,
    by_density,
    closer_than_safe,
    collisions_cell,
    densities_of,
    markdown_table,
    mean_of,
    mean_speed,
)
from drl_av.experiments.options import ReproduceOptions
from drl_av.experiments.plan import Cell, Plan
from drl_av.files import Row

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRIVER, BASELINES = "pretrained", ("idm", "idm-mobil", "idm-sumo")
DRIVERS = (DRIVER, *BASELINES)
MOST_DRIVERS = 50
"""Largest number of drivers in the figure."""
STEP = 5
"""Increase of the number of vehicles from one density to the next, beyond DENSITIES."""
STYLES = {
    "pretrained": ("#d55e00", "o"),
    "idm": ("#000000", "s"),
    "idm-mobil": ("#009e73", "v"),
    "idm-sumo": ("#0072b2", "^"),
    "random": ("#999999", "x"),
}
"""Colour and marker of each driver's curve; colour-blind readers can distinguish them."""
OTHER_COLORS = ("#e69f00", "#cc79a7", "#56b4e9", "#f0e442")
BESIDE = 0.15
"""Horizontal offset between two drivers' markers, in vehicles, so that error bars stay apart."""


def sweep_plan(options: ReproduceOptions) -> Plan:
    """Plan to evaluate all drivers at the published densities, then at higher and higher ones.

    The sweep stops when the learned driver's mean speed is not significantly above that of the best
    baseline (95 %), or when no more vehicles fit on the road.
    """
    config = options.laid_over(default_config(find_drivers(DRIVERS)))

    def cell(vehicles: int) -> Drives:
        return Drives(config, DRIVERS, vehicles, options.drives)

    def next_cell(rows: list[Row], last: Cell) -> Drives | None:
        vehicles = int(last.key["vehicles"]) + STEP
        significant = all(gain.lower_m_s > 0 for gain in gains_of(rows, last) if gain.best)
        return cell(vehicles) if significant and vehicles <= _capacity(config) else None

    cells = [cell(vehicles) for vehicles in DENSITIES]
    return Plan(driven_with(config, DRIVERS), [cells], _place, next_cell, _line)


def _capacity(config: Config) -> int:
    from drl_av.env.highway import HighwayEnv

    with closing(HighwayEnv(config=config)) as env:
        return env.simulation.fleet.capacity


def _place(row: Row) -> tuple[int, int, int]:
    return int(row["vehicles"]), int(row["seed"]), DRIVERS.index(row["driver"])


def gains_of(rows: Iterable[Row], cell: Cell) -> list[Paired]:
    """Compute the learned driver's gain over each baseline at the cell's number of vehicles."""
    own = [row for row in rows if row["vehicles"] == cell.key["vehicles"]]
    return paired(map(speed_of, own), DRIVER, BASELINES)


def _line(rows: list[Row], cell: Cell) -> str:
    gains = gains_of(rows, cell)
    cells = [f"{g.difference_m_s} over {g.baseline}{' (best)' if g.best else ''}" for g in gains]
    return f"{counted(gains[0].vehicles, 'vehicle')}: {DRIVER} gains {', '.join(cells)}, m/s"


def paired_rows(rows: Iterable[Row]) -> list[Row]:
    """Compute ``paired.csv``, the learned driver's gain over each baseline at each density.

    Raises ValueError or LookupError if a row is damaged.
    """
    return [gain.row() for gain in paired(map(speed_of, rows), DRIVER, BASELINES)]


def speed_of(row: Row) -> Speed:
    """Return the mean speed in a row's episode; raises ValueError or LookupError if damaged."""
    vehicles, seed, speed_m_s = (row[name] for name in ("vehicles", "seed", "mean_speed_m_s"))
    return Speed(row["driver"], int(vehicles), int(seed), float(speed_m_s))


def speed_table(results: Results) -> str:
    """Return the Markdown table of each driver's mean speed at each density, m/s."""
    return by_density(results.rows(TABLE), "driver", mean_speed)


def collision_table(results: Results) -> str:
    """Return the Markdown table of the episodes in which the ego hit something / was hit."""
    return by_density(results.rows(TABLE), "driver", collisions_cell)


def driving_table(results: Results) -> str:
    """Return the Markdown table of the shipped driver's statistics, one column for each density.

    The last column is over all densities up to 30 vehicles.
    """
    driven = [row for row in results.rows(TABLE) if row["driver"] == DRIVER]
    densities = densities_of(driven)
    columns = [[r for r in driven if int(r["vehicles"]) == density] for density in densities]
    columns.append([r for r in driven if int(r["vehicles"]) <= PAPER_VEHICLES])
    values = {
        "reward per decision": ("mean_reward", 3),
        "r_v": ("mean_r_v", 3),
        "r_y": ("mean_r_y", 3),
        "r_x": ("mean_r_x", 3),
        "closer than d_safe, %": ("", 1),
        "lane changes": ("lane_changes", 1),
        "aborted lane changes": ("aborted_lane_changes", 1),
    }
    lines = []
    for name, (column, digits) in values.items():
        means = [mean_of(rows, column) if column else closer_than_safe(rows) for rows in columns]
        lines.append([name, *(f"{mean:.{digits}f}" for mean in means)])
    names = ["vehicles", *map(str, densities), f"up to {PAPER_VEHICLES}"]
    return markdown_table(names, lines)


def gain_table(results: Results) -> str:
    """Return the Markdown table of the shipped driver's gain over each baseline, m/s.

    The gain over the fastest baseline of each density is bold.
    """
    rows = results.rows("paired.csv")
    lines = [
        [f"over `{baseline}`", *(_gain(row) for row in rows if row["baseline"] == baseline)]
        for baseline in dict.fromkeys(row["baseline"] for row in rows)
    ]
    return markdown_table(["vehicles", *map(str, densities_of(rows))], lines)


def _gain(row: Row) -> str:
    gain = str(Mean(float(row["difference_m_s"]), float(row["ci95_half_width_m_s"])))
    return f"**{gain}**" if row["best"] == "True" else gain


def speed_figure(rows: Sequence[Mapping[str, Any]]) -> "Figure":
    """Draw mean speed against the number of vehicles, with 95 % intervals (Fig. 8 of the paper).

    There is one curve for each driver. The rows need at least the columns ``driver``, ``vehicles``
    and ``mean_speed_m_s``.

    Raises:
        DrlAvError: there are more than ``MOST_DRIVERS`` drivers.
    """
    figure, axes = one_panel("vehicles on the loop", "mean speed of the ego, m/s")
    drivers = list(dict.fromkeys(row["driver"] for row in rows))
    if len(drivers) > MOST_DRIVERS:
        raise DrlAvError(
            f"The tables hold {len(drivers)} drivers, but a figure shows at most {MOST_DRIVERS}: "
            "draw some of them."
        )
    other_colors, curves = cycle(OTHER_COLORS), {}
    for place, driver in enumerate(drivers):
        speeds: dict[int, list[float]] = {}
        for row in rows:
            if row["driver"] == driver:
                speeds.setdefault(int(row["vehicles"]), []).append(float(row["mean_speed_m_s"]))
        means = {number: mean_with_interval(speeds[number]) for number in sorted(speeds)}
        color, mark = STYLES[driver] if driver in STYLES else (next(other_colors), "D")
        aside = BESIDE * (place - (len(drivers) - 1) / 2)
        curves[driver] = axes.errorbar(
            [number + aside for number in means],
            [mean.value for mean in means.values()],
            yerr=[m.half_width if np.isfinite(m.half_width) else 0.0 for m in means.values()],
            color=color,
            marker=mark,
            capsize=3,
        )
        curves[driver].set_label(driver)
    legend_of_names(axes, curves)
    return figure


DENSITY_SWEEP = Experiment(
    name="density_sweep",
    meaning="mean speed against the number of vehicles, up to where the drivers meet",
    row="an episode of the shipped driver or of a baseline, under the check paper",
    plan=sweep_plan,
    derived={"paired.csv": paired_rows},
    summaries={
        "speed": speed_table,
        "gain": gain_table,
        "driving": driving_table,
        "collisions": collision_table,
    },
    figures={"mean_speed": speed_figure},
)
TABLE = DENSITY_SWEEP.table
