"""Measures how smoothly and how close to others drivers drive, in each kind of traffic (ours)."""

from collections.abc import Iterable, Sequence

from drl_av.config import SINGLE_PRESETS
from drl_av.evaluation.criticality import CriticalityMetrics
from drl_av.evaluation.statistics import grouped
from drl_av.files import Row
from studies.cells import Drives, policies_of
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import collisions_cell, markdown_table
from studies.opponents import LEARNED
from studies.options import ReproduceOptions
from studies.plan import Plan, by
from studies.store import MadeWith

DRIVERS = (*LEARNED, "gap-mobil", "gap-mobil-1.3", "sumo-tuned", "planner")
DENSITIES = (5, 10, 15, 20, 25)
DRIVES = 20
"""Largest number of episodes of a driver at one density in one kind of traffic."""
FIRST_SEED = 970_000
COLUMNS = (
    "driver",
    "seed",
    "decisions",
    "mean_speed_m_s",
    "collided",
    "ego_hit",
    "lane_changes",
    "aborted_lane_changes",
    "driven_m",
    "reversals",
    "comfortable_decisions",
    "short_headways",
    "forced_brakes",
)


def comfort_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to evaluate every driver under ``strict`` in each kind, on the same seeds."""
    shipped = options.settings_of(LEARNED[:1]).updated("safety", check="strict")
    configs = {kind: shipped.with_traffic(kind) for kind in SINGLE_PRESETS}
    seeds = min(options.drives, DRIVES)
    cells = [
        Drives(
            config,
            DRIVERS,
            vehicles,
            seeds,
            COLUMNS,
            (("traffic", kind),),
            first_seed=FIRST_SEED,
            metrics=CriticalityMetrics,
        )
        for kind, config in configs.items()
        for vehicles in DENSITIES
    ]
    order = by(traffic=SINGLE_PRESETS, vehicles=DENSITIES, seed=int, driver=DRIVERS)
    return Plan(MadeWith(configs, policies_of(LEARNED)), [cells], order, named="traffic")


def _total(rows: Iterable[Row], column: str) -> float:
    return sum(float(row[column]) for row in rows)


def _measures(rows: Sequence[Row]) -> list[str]:
    """Return the cells of the table after the driver, from the driver's episodes."""
    decisions, aborts = _total(rows, "decisions"), _total(rows, "aborted_lane_changes")
    begun = max(aborts + _total(rows, "lane_changes"), 1)
    return [
        f"{_total(rows, 'mean_speed_m_s') / len(rows):.2f}",
        f"{1000 * _total(rows, 'reversals') / _total(rows, 'driven_m'):.1f}",
        f"{100 * aborts / begun:.0f}",
        f"{100 * _total(rows, 'comfortable_decisions') / decisions:.1f}",
        f"{100 * _total(rows, 'short_headways') / decisions:.2f}",
        f"{1000 * _total(rows, 'forced_brakes') / decisions:.1f}",
        collisions_cell(rows),
    ]


def comfort_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each driver's comfort and safety in each kind, and in all."""
    rows = results.rows(COMFORT.table)
    kinds = grouped(rows, lambda row: row["traffic"]) | {"all": rows}
    lines = [
        [kind, f"`{driver}`", *_measures(episodes)]
        for kind, own in kinds.items()
        for driver, episodes in grouped(own, lambda row: row["driver"]).items()
    ]
    header = ["traffic", "driver", "speed, m/s", "reversals a km", "lane changes aborted, %"]
    header += ["comfortable decisions, %", "headways below 1 s, %", "forced brakings of 1,000"]
    return markdown_table([*header, "ego hit something / was hit"], lines)


COMFORT = Experiment(
    name="comfort",
    meaning="how smoothly drivers drive, and how close to others, under strict",
    row="an episode of a driver in a kind of traffic",
    plan=comfort_plan,
    summaries={"comfort": comfort_table},
)
