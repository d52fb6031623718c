"""Measures mean speed against flow on a straight highway, like Fig. 6 of the paper on a loop."""

from collections.abc import Iterable
from operator import itemgetter
from typing import TYPE_CHECKING

from drl_av.config import TrafficConfig
from drl_av.evaluation.figure_style import one_panel
from drl_av.evaluation.figures import curves_by_density
from drl_av.evaluation.statistics import Mean, grouped, mean_difference, mean_with_interval
from drl_av.files import Row
from drl_av.scenarios.highways import StraightDescription
from drl_av.simulation.inflow import vehicles_of_flow
from studies.cells import Drives, policies_of
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import collisions_cell, markdown_table, values_by_traffic
from studies.opponents import LEARNED
from studies.options import ReproduceOptions
from studies.plan import Plan, by
from studies.store import MadeWith

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCENARIO = "straight"
DRIVERS = (*LEARNED, "planner", "gap-mobil", "gap-mobil-1.3", "idm-mobil", "sumo", "sumo-tuned")
FLOWS_PER_H = (0, 250, 500, 750, 1000, 1250, 1500, 2000)
"""Vehicles per hour that enter each lane, as far as there is room for them."""
DRIVES = 30
"""Largest number of episodes of a driver at one flow."""
REFERENCE = "gap-mobil"
"""The driver to which the second table compares the others."""
FIRST_SEED = 980_000
COLUMNS = ("driver", "seed", "decisions", "mean_speed_m_s", "collided", "ego_hit")


def vehicles_at(flow_per_h: float) -> int:
    """Return the number of vehicles on the highway that corresponds to a flow in each lane."""
    plan = StraightDescription(flow_per_h=flow_per_h).plan()
    return vehicles_of_flow(plan.start, TrafficConfig())


def straight_plan(options: ReproduceOptions) -> Plan:
    """Return a plan that evaluates every driver on the straight highway at each flow.

    All drivers use the safety check ``strict``, and the same traffic seeds at each flow.
    """
    config = options.settings_of(LEARNED[:1]).updated("safety", check="strict")
    config = config.updated("simulation", scenario=SCENARIO)
    seeds = min(options.drives, DRIVES)
    cells = [
        Drives(
            config,
            DRIVERS,
            vehicles_at(flow),
            seeds,
            COLUMNS,
            (("flow_per_h", str(flow)),),
            first_seed=FIRST_SEED,
        )
        for flow in FLOWS_PER_H
    ]
    order = by(flow_per_h=FLOWS_PER_H, seed=int, driver=DRIVERS)
    return Plan(MadeWith({SCENARIO: config}, policies_of(LEARNED)), [cells], order)


def _means(rows: Iterable[Row]) -> dict[str, dict[int, Mean]]:
    """Return the mean speeds by driver and by flow, m/s."""
    cells = grouped(rows, lambda row: (row["driver"], int(row["flow_per_h"])))
    means: dict[str, dict[int, Mean]] = {}
    for (driver, flow), own in cells.items():
        speeds = (float(row["mean_speed_m_s"]) for row in own)
        means.setdefault(driver, {})[flow] = mean_with_interval(speeds)
    return means


def straight_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's mean speed at each flow, m/s, and collisions."""
    rows = results.rows(STRAIGHT.table)
    means = _means(rows)
    lines = [
        [f"`{driver}`", *map(str, means[driver].values()), collisions_cell(own)]
        for driver, own in grouped(rows, itemgetter("driver")).items()
    ]
    flows = map(str, next(iter(means.values())))
    return markdown_table(["driver", *flows, "ego hit something / was hit"], lines)


def straight_gain_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's gain over ``REFERENCE``, paired by seed, m/s."""
    speeds = {
        driver: {
            flow: values_by_traffic(rows)
            for flow, rows in grouped(own, itemgetter("flow_per_h")).items()
        }
        for driver, own in grouped(results.rows(STRAIGHT.table), itemgetter("driver")).items()
    }
    theirs = speeds.pop(REFERENCE)
    lines = [
        [f"`{driver}`", *(str(mean_difference(own[flow], theirs[flow], driver)) for flow in own)]
        for driver, own in speeds.items()
    ]
    return markdown_table(["driver", *theirs], lines)


def straight_figure(rows: list[Row]) -> "Figure":
    """Draw each driver's mean speed against the flow, with 95 % intervals."""
    figure, axes = one_panel("inflow, vehicles/h/lane", "mean speed of the ego, m/s")
    curves_by_density(axes, _means(rows))
    return figure


STRAIGHT = Experiment(
    name="straight",
    meaning="mean speed against the flow on a straight highway, under strict",
    row="an episode of a driver at a flow",
    plan=straight_plan,
    summaries={"straight": straight_table, "straight_gain": straight_gain_table},
    figures={"straight": straight_figure},
)
