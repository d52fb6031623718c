"""The experiment ``density_sweep``: mean speed against the number of vehicles.

It corresponds to Fig. 6 of the paper, and goes on to densities at which the shipped driver and the
paper's baselines are equally fast. Stronger opponents (ours) drive the same traffic.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from operator import itemgetter
from typing import TYPE_CHECKING

from drl_av.config import Config
from drl_av.errors import pluralize
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.figure_style import one_panel
from drl_av.evaluation.figures import curves_by_density, speed_figure
from drl_av.evaluation.paired import PairedGain, Speed, paired
from drl_av.evaluation.statistics import Mean, grouped, mean_difference
from drl_av.files import Row
from studies.cells import Drives, driven_with
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import (
    by_density,
    closer_than_safe,
    collisions_cell,
    columns_by_density,
    markdown_table,
    mean_of,
    mean_speed,
    rows_by_density,
    values_by_traffic,
)
from studies.options import ReproduceOptions
from studies.plan import Cell, Plan, by

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRIVER, BASELINES = "pretrained", ("idm", "idm-mobil", "idm-sumo")
"""The shipped driver, and the drivers that follow by the paper's IDM rule."""
DRIVERS = (DRIVER, *BASELINES)
GAP_RULES = ("gap-mobil", "gap-mobil-1.3")
STRONGER = (*GAP_RULES, "sumo", "sumo-tuned")
"""Stronger rule-based opponents (ours)."""
OPPONENTS = (*BASELINES, *STRONGER)
SWEPT = (DRIVER, *OPPONENTS)
"""All drivers of the table, in the order of its rows."""
STEP = 5
"""Increase of the number of vehicles from one density to the next, beyond DENSITIES."""
UNDER_ACC = ("idm-mobil", "idm-sumo")
"""Baselines that the tables also show under adaptive cruise control, from ``reference_acc.csv``."""


def sweep_plan(options: ReproduceOptions) -> Plan:
    """Return a plan that evaluates all drivers at the published densities, then at higher ones.

    Each further density has ``STEP`` more vehicles. The sweep stops when ``DRIVER`` is no longer
    significantly faster than the fastest of ``BASELINES``: the 95 % confidence interval of its gain
    in mean speed, paired by seed, is not wholly above 0. It also stops when no more vehicles fit on
    the road. Each cell of the plan has the rows of one driver at one density.
    """
    config = options.settings_of(DRIVERS)

    def cell(vehicles: int, driver: str) -> Drives:
        named = (("driver", driver),)
        return Drives(config, (driver,), vehicles, options.drives, named=named)

    def next_cell(rows: list[Row], last: Cell) -> Drives | None:
        vehicles, place = int(last.key["vehicles"]), SWEPT.index(last.key["driver"]) + 1
        if place < len(SWEPT):
            return cell(vehicles, SWEPT[place])
        gains = gains_of(rows, last, BASELINES)
        significant = all(gain.lower_m_s > 0 for gain in gains if gain.best)
        more = significant and vehicles + STEP <= _capacity(config)
        return cell(vehicles + STEP, DRIVER) if more else None

    cells = [cell(vehicles, driver) for vehicles in DENSITIES for driver in SWEPT]
    order = by(vehicles=_density, seed=int, driver=SWEPT)
    return Plan(driven_with(config, DRIVERS), [cells], order, next_cell, _line)


def _capacity(config: Config) -> int:
    from drl_av.env.highway import HighwayEnv

    with closing(HighwayEnv(config=config)) as env:
        return env.simulation.fleet.capacity


def _density(vehicles: str) -> int:
    """Return a number of vehicles; raise ValueError if the sweep has no such number."""
    number, beyond = int(vehicles), int(vehicles) - DENSITIES[-1]
    if number not in DENSITIES and (beyond <= 0 or beyond % STEP):
        raise ValueError(f"vehicles is {vehicles}")
    return number


def gains_of(rows: Iterable[Row], cell: Cell, opponents: Sequence[str]) -> list[PairedGain]:
    """Compute the learned driver's gain over each opponent at the cell's number of vehicles."""
    own = [row for row in rows if row["vehicles"] == cell.key["vehicles"]]
    return paired(map(speed_of, own), DRIVER, opponents)


def _line(rows: list[Row], cell: Cell) -> str:
    if cell.key["driver"] != SWEPT[-1]:
        return ""
    gains = gains_of(rows, cell, OPPONENTS)
    cells = [f"{g.difference_m_s} over {g.baseline}{' (best)' if g.best else ''}" for g in gains]
    return f"{pluralize(gains[0].vehicles, 'vehicle')}: {DRIVER} gains {', '.join(cells)}, m/s"


def paired_rows(rows: Iterable[Row]) -> list[Row]:
    """Compute ``paired.csv``, the learned driver's gain over each opponent at each density.

    An opponent that has not driven as many episodes of a density as the learned driver is left out
    there.

    Raises ValueError or LookupError if a row is damaged.
    """
    gains: list[PairedGain] = []
    for episodes in grouped(map(speed_of, rows), lambda episode: episode.vehicles).values():
        driven = Counter(episode.driver for episode in episodes)
        complete = [name for name in OPPONENTS if driven[name] == driven[DRIVER]]
        gains += paired(episodes, DRIVER, complete)
    return [gain.row() for gain in gains]


def speed_of(row: Row) -> Speed:
    """Return the mean speed in a row's episode; raises ValueError or LookupError if damaged."""
    vehicles, seed, speed_m_s = (row[name] for name in ("vehicles", "seed", "mean_speed_m_s"))
    return Speed(row["driver"], int(vehicles), int(seed), float(speed_m_s))


def rows_with_acc(results: ResultsFolder) -> list[Row]:
    """Read the rows of the sweep, then those of ``UNDER_ACC`` under adaptive cruise control.

    The latter have ", acc" after the driver's name: "idm-mobil, acc".
    """
    acc = [row for row in results.rows("reference_acc.csv") if row["driver"] in UNDER_ACC]
    return results.rows(TABLE) + [row | {"driver": f"{row['driver']}, acc"} for row in acc]


def speed_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's mean speed at each density, m/s."""
    return by_density(rows_with_acc(results), "driver", mean_speed)


def collision_table(results: ResultsFolder) -> str:
    """Return the Markdown table of episode counts: the ego hit something / was hit."""
    return by_density(rows_with_acc(results), "driver", collisions_cell)


def driving_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the shipped driver's statistics, one column for each density.

    The last column is over all densities up to 30 vehicles.
    """
    driven = [row for row in results.rows(TABLE) if row["driver"] == DRIVER]
    columns = columns_by_density(driven)
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
        means = (
            mean_of(rows, column) if column else closer_than_safe(rows) for rows in columns.values()
        )
        lines.append([name, *(f"{mean:.{digits}f}" for mean in means)])
    return markdown_table(["vehicles", *columns], lines)


def gains_over_all(rows: Iterable[Row]) -> dict[str, Mean]:
    """Compute the shipped driver's mean gain over each other driver in these rows, m/s.

    The gains are paired by traffic. Raises DrlAvError if a driver did not drive the same traffic.
    """
    driven = grouped(rows, itemgetter("driver"))
    ours = values_by_traffic(driven.pop(DRIVER))
    return {
        name: mean_difference(ours, values_by_traffic(theirs), f"{DRIVER} and {name}")
        for name, theirs in driven.items()
    }


def gains_by_opponent_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the shipped driver's gain over each opponent, m/s.

    The smallest gain of each density, over the fastest opponent, is bold; a cell is empty if the
    opponent has not driven there. The last column is over all densities up to 30 vehicles.
    """
    columns = columns_by_density(rows_with_acc(results))
    gains = [gains_over_all(rows) for rows in columns.values()]
    lines = [[f"over `{name}`", *(_gain(name, each) for each in gains)] for name in gains[0]]
    return markdown_table(["vehicles", *columns], lines)


def _gain(name: str, gains: Mapping[str, Mean]) -> str:
    if name not in gains:
        return ""
    best = name == min(gains, key=lambda other: gains[other].value)
    return f"**{gains[name]}**" if best else str(gains[name])


def gain_figure(rows: Sequence[Row]) -> "Figure":
    """Draw the shipped driver's gain over each opponent, with 95 % intervals, by density."""
    figure, axes = one_panel("vehicles on the loop", f"gain of {DRIVER} over each opponent, m/s")
    axes.axhline(0.0, color="#999999", linewidth=1)
    gains: dict[str, dict[int, Mean]] = {}
    for density, own in rows_by_density(rows).items():
        for name, gain in gains_over_all(own).items():
            gains.setdefault(name, {})[density] = gain
    curves_by_density(axes, gains)
    return figure


DENSITY_SWEEP = Experiment(
    name="density_sweep",
    meaning="mean speed against the number of vehicles, up to where the baselines catch up",
    row="an episode of the shipped driver under the check paper, or of an opponent",
    plan=sweep_plan,
    derived={"paired.csv": paired_rows},
    summaries={
        "speed": speed_table,
        "gain": gains_by_opponent_table,
        "driving": driving_table,
        "collisions": collision_table,
    },
    figures={"mean_speed": speed_figure, "gain": gain_figure},
)
TABLE = DENSITY_SWEEP.table
