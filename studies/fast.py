"""The experiment ``fast`` compares the preset ``fast`` (ours) with the paper's whole schedule.

The drivers of the whole schedule correspond to those in Fig. 6 of the paper.
"""

from collections.abc import Iterable, Sequence
from operator import itemgetter
from typing import TYPE_CHECKING

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.errors import pluralize
from drl_av.evaluation.figure_style import one_panel
from drl_av.evaluation.figures import curves_by_density
from drl_av.evaluation.statistics import Mean, grouped, mean_difference, mean_with_interval
from drl_av.files import Row
from studies import density_sweep
from studies.cells import trained_drives
from studies.curves import variant_config
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import (
    PAPER_VEHICLES,
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
from studies.training_jobs import TrainingJob

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("seed", "mean_reward", "mean_speed_m_s", "ego_hit")
TRAINED = ("paper", "fast")


def fast_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to train by the paper's whole schedule and by the preset ``fast``.

    The schedule has ``options.full_seeds`` trainings, at least one, and ``fast`` has
    ``options.seeds``. The drivers of all trainings are evaluated.
    """
    whole = options.with_files(Config())
    short = options.with_files(preset("fast").updated("learning", evaluate_every=100))
    configs = {
        f"paper-{seed}": variant_config(whole, "paper", seed)
        for seed in range(max(1, options.full_seeds))
    } | {f"fast-{seed}": short.updated("learning", seed=seed) for seed in range(options.seeds)}
    jobs = [
        TrainingJob.whole(name.partition("-")[0], config, options.runs / name)
        for name, config in configs.items()
    ]
    return trained_drives(jobs, options, COLUMNS)


def fast_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the results, one row for each training's driver.

    Each gain compares the driver with ``paper-0``, which was trained by the paper's whole schedule:
    the mean difference in the same traffic, in the unit of the column before it.
    """
    seconds = results.made_by("fast.csv")["wall_time_s"]
    driven, lines = grouped(results.rows("fast.csv"), itemgetter("training")), []
    first = next(iter(driven))
    for name, own in driven.items():
        cells = [f"`{name}`", f"{seconds[name]:,.0f}", f"{count(own, 'ego_hit')} of {len(own)}"]
        for column, digits in (("mean_reward", 3), ("mean_speed_m_s", 2)):
            here, there = (values_by_traffic(side, column) for side in (own, driven[first]))
            gain = mean_difference(here, there, f"{name} and {first}")
            for mean in (mean_with_interval(here.values()), gain):
                cells.append(f"{mean.value:.{digits}f} ± {mean.half_width:.{digits}f}")
        lines.append(cells)
    names = ("training", "seconds", "ego hit something", "reward per decision", "gain")
    return markdown_table([*names, "mean speed, m/s", "gain"], lines)


def driven_by(rows: Iterable[Row]) -> dict[str, list[list[Row]]]:
    """Return the episodes with up to 30 vehicles by line of the table, one list for each driver.

    A line has the drivers of all seeds of a training, or one baseline. ``rows`` are the result of
    ``FAST.drawn``.
    """
    driven: dict[str, dict[str, list[Row]]] = {}
    for row in up_to_30(rows):
        name = row.get("training") or row["driver"]
        line = name.rpartition("-")[0] if "training" in row else name
        driven.setdefault(line, {}).setdefault(name, []).append(row)
    trained = [line for line in TRAINED if line in driven]
    found = {f"{line}, {pluralize(len(driven[line]), 'seed')}": driven[line] for line in trained}
    baselines = (*density_sweep.DRIVERS, "gap-mobil")
    found |= {name: driven[name] for name in baselines if name in driven}
    return {line: [*drivers.values()] for line, drivers in found.items()}


def speed_over(drivers: Sequence[Sequence[Row]]) -> Mean:
    """Return the mean speed of some drivers with its 95 % interval, m/s.

    ``drivers`` holds one list of episodes for each driver. The interval describes the spread
    between drivers or, for one driver, between its episodes.
    """
    if len(drivers) == 1:
        return mean_with_interval(float(row["mean_speed_m_s"]) for row in drivers[0])
    return mean_with_interval(mean_of(own, "mean_speed_m_s") for own in drivers)


def by_vehicles(drivers: Sequence[Sequence[Row]]) -> dict[int, Mean]:
    """Return the result of ``speed_over`` at each number of vehicles."""
    driven = [rows_by_density(own) for own in drivers]
    return {number: speed_over([own.get(number, []) for own in driven]) for number in driven[0]}


def whole_schedule_table(results: ResultsFolder) -> str:
    """Return the Markdown table of mean speeds, m/s, by density: trained drivers and baselines.

    A training that has several seeds has a second line, for the driver of its slowest seed.
    """
    lines, cells = driven_by(FAST.drawn(results)), []
    for name, drivers in lines.items():
        slowest = min(drivers, key=lambda own: mean_of(own, "mean_speed_m_s"))
        shown = {name: drivers}
        if len(drivers) > 1:
            shown[f"the slowest of them, {slowest[0]['training']}"] = [slowest]
        for label, own in shown.items():
            cells.append([label, *map(str, (*by_vehicles(own).values(), speed_over(own)))])
    densities = densities_of(row for drivers in lines.values() for own in drivers for row in own)
    return markdown_table(["vehicles", *map(str, densities), f"up to {PAPER_VEHICLES}"], cells)


def whole_schedule_figure(rows: Sequence[Row]) -> "Figure":
    """Draw mean speed against the number of vehicles, with 95 % intervals (Fig. 6 of the paper)."""
    figure, axes = one_panel("vehicles on the loop", "mean speed of the ego, m/s")
    curves_by_density(axes, {name: by_vehicles(own) for name, own in driven_by(rows).items()})
    return figure


FAST = Experiment(
    name="fast",
    meaning="the preset fast on every seed, beside drivers of the whole schedule of 10000",
    row="an episode of the driver of a training",
    plan=fast_plan,
    summaries={"fast": fast_table, "whole_schedule": whole_schedule_table},
    figures={"whole_schedule": whole_schedule_figure},
    beside=(density_sweep.TABLE,),
)
