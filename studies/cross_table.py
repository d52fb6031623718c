"""Drivers that were trained in one kind of traffic or in all, evaluated in each kind (ours)."""

from collections.abc import Iterable, Sequence
from functools import partial

from drl_av.config import SINGLE_PRESETS
from drl_av.config.presets import preset
from drl_av.evaluation.statistics import Mean, mean_difference
from drl_av.files import Row
from studies.cells import Drives, TableDriver, made_with
from studies.density_sweep import DRIVER
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import (
    collisions_cell,
    markdown_table,
    mean_speed,
    values_by_traffic,
)
from studies.options import ReproduceOptions
from studies.plan import Plan, by
from studies.training_jobs import TrainingJob

REFERENCE = "gap-mobil"
"""The driver to which the table compares the others."""
UNTRAINED = (REFERENCE, "gap-mobil-1.3", "sumo-tuned")
"""The strongest rule-based driver, and two others (see the experiment ``opponents``)."""
NAME = "cross_table-"
"""Beginning of the names of the trained drivers; the kind of traffic of the training follows."""
TRAINED_IN = (*SINGLE_PRESETS, "all")
"""The kinds of traffic in which drivers are trained."""
ORDER = (*UNTRAINED, DRIVER, *(NAME + kind for kind in TRAINED_IN))
DENSITIES = (10, 15, 20, 25)
DRIVES = 25
"""Largest number of episodes of a driver at one density in one kind of traffic."""
FIRST_SEED = 950_000
COLUMNS = ("seed", "mean_speed_m_s", "mean_reward", "collided", "ego_hit", "safety_triggers")


def trainings(options: ReproduceOptions) -> list[TrainingJob]:
    """Return a training with the preset ``fast`` in each kind of ``TRAINED_IN``."""
    config = options.with_files(preset("fast").updated("learning", evaluate_every=100))
    return [
        TrainingJob.whole(kind, config.with_traffic(kind), options.runs / (NAME + kind))
        for kind in TRAINED_IN
    ]


def cross_table_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to evaluate drivers in each kind of traffic, all on the same seeds.

    The drivers are ``UNTRAINED``, the shipped and the trained ones.
    """
    jobs = trainings(options)
    config = options.settings_of([DRIVER])
    drivers = [TableDriver(name, name, config) for name in (*UNTRAINED, DRIVER)]
    drivers += [TableDriver(job.name, str(job.folder), job.config, job) for job in jobs]
    cells = in_each_kind(drivers, DENSITIES, FIRST_SEED, min(options.drives, DRIVES), COLUMNS)
    order = by(driver=ORDER, traffic=SINGLE_PRESETS, vehicles=DENSITIES, seed=int)
    return Plan(made_with(drivers), [cells], order, named="driver")


def in_each_kind(
    drivers: Iterable[TableDriver],
    densities: Iterable[int],
    first_seed: int,
    seeds: int,
    columns: tuple[str, ...],
) -> list[Drives]:
    """Return the cells in which each driver drives in each kind of traffic at each density.

    Each cell has ``seeds`` consecutive traffic seeds. A row holds the fields ``columns``.
    """
    in_kinds = [
        each._replace(
            config=each.config.with_traffic(kind), named=(("driver", each.name), ("traffic", kind))
        )
        for each in drivers
        for kind in SINGLE_PRESETS
    ]
    return [
        each.drives(vehicles, seeds, columns, first_seed)
        for each in in_kinds
        for vehicles in densities
    ]


def gains(rows: Sequence[Row], driver: str) -> dict[str, Mean]:
    """Return a driver's gain over ``REFERENCE`` in each kind of traffic, m/s.

    The gains are paired by traffic, over all densities; they have 95 % intervals. Raises DrlAvError
    if the two did not drive the same traffic.
    """
    found = {}
    for kind in SINGLE_PRESETS:
        ours, theirs = (values_by_traffic(_cell(rows, name, kind)) for name in (driver, REFERENCE))
        found[kind] = mean_difference(ours, theirs, f"{driver} and {REFERENCE}")
    return found


def gain_over_reference_table(results: ResultsFolder, table: str) -> str:
    """Return the Markdown table of the speed of ``REFERENCE``, and of each driver's gain over it.

    ``table`` is the file name of a results table whose first rows are those of ``REFERENCE``. The
    last column names the kind of traffic with the smallest gain.
    """
    rows = results.rows(table)
    speeds = (mean_speed(_cell(rows, REFERENCE, kind)) for kind in SINGLE_PRESETS)
    lines = [[f"speed of `{REFERENCE}`", *speeds, ""]]
    for driver in _drivers(rows)[1:]:
        found = gains(rows, driver)
        worst = min(found, key=lambda kind: found[kind].value)
        lines.append([_label(driver), *map(str, found.values()), f"{worst}: {found[worst]}"])
    return markdown_table(["driver", *SINGLE_PRESETS, "worst"], lines)


def hits_table(results: ResultsFolder, table: str) -> str:
    """Return the Markdown table of each driver's collisions in each kind of traffic."""
    rows = results.rows(table)
    lines = [
        [_label(name), *(collisions_cell(_cell(rows, name, kind)) for kind in SINGLE_PRESETS)]
        for name in _drivers(rows)
    ]
    return markdown_table(["driver", *SINGLE_PRESETS], lines)


def _drivers(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row["driver"] for row in rows))


def _cell(rows: Sequence[Row], driver: str, kind: str) -> list[Row]:
    return [row for row in rows if row["driver"] == driver and row["traffic"] == kind]


def _label(driver: str) -> str:
    if driver.startswith(NAME):
        return f"trained in {driver.removeprefix(NAME)}"
    return driver if " " in driver else f"`{driver}`"


CROSS_TABLE = Experiment(
    name="cross_table",
    meaning="drivers trained in one kind of traffic or in all, evaluated in each kind",
    row="an episode of a driver in a kind of traffic",
    plan=cross_table_plan,
    summaries={
        "cross_table": partial(gain_over_reference_table, table="cross_table.csv"),
        "cross_table_hits": partial(hits_table, table="cross_table.csv"),
    },
)
