"""The experiments that evaluate drivers of the density sweep with other settings."""

from functools import partial
from operator import itemgetter
from typing import Any

from drl_av.config import Config
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.statistics import grouped
from studies import density_sweep
from studies.barricade import SCENARIO, TRAINED_VEHICLES
from studies.cells import Drives, driven_with
from studies.density_sweep import DRIVER, DRIVERS, GAP_RULES
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import (
    closer_than_safe,
    collisions,
    count,
    markdown_table,
    mean_of,
    mean_speed,
    up_to_30,
)
from studies.options import ReproduceOptions
from studies.plan import Plan, by

CATCH_UP = {
    "longitudinal_reference": "acc",
    "acc_gap_gain_per_s": 1 / Config().reward.catch_up_time_s,
    "reference_standstill_gap_m": 0.0,
}
"""Settings of an adaptive cruise control that keeps d_safe.

It closes larger gaps with the time constant ``reward.catch_up_time_s``, as v_des assumes.
"""


def varied(
    options: ReproduceOptions,
    drivers: tuple[str, ...],
    section: str,
    settings: dict[str, Any],
    densities: tuple[int, ...] = (),
) -> Plan:
    """Return a plan to evaluate drivers with other settings in one section of the config.

    ``densities`` are the numbers of vehicles, by default those of the published tables.
    """
    config = options.settings_of(drivers).updated(section, **settings)
    numbers = densities or DENSITIES
    cells = [Drives(config, drivers, vehicles, options.drives) for vehicles in numbers]
    order = by(vehicles=numbers, seed=int, driver=drivers)
    return Plan(driven_with(config, drivers), [cells], order)


def check_table(results: ResultsFolder) -> str:
    """Return the Markdown table of drivers with and without the check, over all densities."""
    rows = results.rows(CHECK_PAPER.table) + results.rows(CHECK_PERMIT_ALL.table)
    densities = {row["vehicles"] for row in rows}
    rows += [
        row
        for row in results.rows(density_sweep.TABLE)
        if row["driver"] == "idm-sumo" and row["vehicles"] in densities
    ]
    lines = []
    driven = grouped(rows, itemgetter("driver", "safety_check"))
    for driver, check in sorted(driven):
        own = driven[driver, check]
        hits = map(str, (len(own), *collisions(own)))
        lines.append([f"`{driver}`", f"`{check}`", *hits, mean_speed(own)])
    names = ("driver", "check", "episodes", "ego hit something", "was hit", "mean speed, m/s")
    return markdown_table(names, lines)


def reference_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's results under up to three settings.

    The settings are the default (the paper's accelerations), the default without a tolerance of the
    desired speed, and adaptive cruise control as longitudinal reference. A driver has no line for a
    setting in which it has not driven.
    """
    tables = {
        "the paper's accelerations": results.rows(density_sweep.TABLE),
        "the same, v_des exact": results.rows(EXACT_SPEED.table),
        "`acc` as reference": results.rows(REFERENCE_ACC.table),
    }
    lines = []
    for driver in (*DRIVERS, *GAP_RULES):
        for settings, rows in tables.items():
            own = up_to_30(row for row in rows if row["driver"] == driver)
            if own:
                means = [f"{mean_of(own, column):.3f}" for column in ("mean_reward", "mean_r_v")]
                hits = f"{count(own, 'ego_hit')} of {len(own)}"
                cells = [*means, f"{closer_than_safe(own):.1f}", mean_speed(own), hits]
                lines.append([f"`{driver}`", settings, *cells])
    names = ("driver", "settings", "reward per decision", "r_v", "closer than d_safe, %")
    return markdown_table([*names, "mean speed, m/s", "ego hit something"], lines)


def barricade_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the shipped driver beside a closed lane and on the open road."""
    closed, swept = results.rows(BARRICADE_PRETRAINED.table), results.rows(density_sweep.TABLE)
    densities = {row["vehicles"] for row in closed}
    lines = []
    for lane, rows in (("closed", closed), ("open", swept)):
        own = [row for row in rows if row["driver"] == DRIVER and row["vehicles"] in densities]
        lines.append([lane, *map(str, (len(own), *collisions(own))), mean_speed(own)])
    names = ("right lane", "episodes", "ego hit something", "was hit", "mean speed, m/s")
    return markdown_table(names, lines)


CHECK_PAPER = Experiment(
    name="check_paper",
    meaning="the random driver under the check paper",
    row="an episode",
    plan=partial(varied, drivers=("random",), section="safety", settings={"check": "paper"}),
)
CHECK_PERMIT_ALL = Experiment(
    name="check_permit_all",
    meaning="the random driver and idm-sumo without a check",
    row="an episode",
    plan=partial(
        varied, drivers=("random", "idm-sumo"), section="safety", settings={"check": "permit_all"}
    ),
    summaries={"check": check_table},
)
REFERENCE_ACC = Experiment(
    name="reference_acc",
    meaning="the drivers of the density sweep with adaptive cruise control as reference",
    row="an episode",
    plan=partial(varied, drivers=DRIVERS, section="ego", settings=CATCH_UP),
)
EXACT_SPEED = Experiment(
    name="exact_speed",
    meaning="the shipped driver where v_des is exactly the speed that the lane allows",
    row="an episode",
    plan=partial(
        varied, drivers=(DRIVER,), section="reward", settings={"speed_tolerance_m_s": 0.0}
    ),
    summaries={"reference": reference_table},
)
BARRICADE_PRETRAINED = Experiment(
    name="barricade_pretrained",
    meaning="the shipped driver on the road whose right lane is closed",
    row="an episode",
    plan=partial(
        varied,
        drivers=(DRIVER,),
        section="simulation",
        settings={"scenario": SCENARIO},
        densities=(TRAINED_VEHICLES,),
    ),
    summaries={"barricade": barricade_table},
)
