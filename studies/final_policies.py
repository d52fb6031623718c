"""The experiment ``final_policies``: evaluates the final drivers of the learning curves."""

from collections.abc import Callable
from dataclasses import replace
from operator import itemgetter

from drl_av.config import Config
from drl_av.evaluation.statistics import grouped, mean_with_interval
from drl_av.files import Row
from studies.cells import trained_drives
from studies.curves import curve_jobs
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import markdown_table
from studies.options import ReproduceOptions
from studies.plan import Plan

COLUMNS = ("seed", "mean_reward", "mean_speed_m_s", "collided", "ego_hit")


def final_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to evaluate the drivers of the trainings that stop at ``options.episodes``.

    Each driver is evaluated with the settings of its training, including the safety check.
    """
    jobs = curve_jobs(options, options.with_files(Config()))
    final = [job for job in jobs if job.stop <= options.episodes]
    empty = f"No training stops at episode {options.episodes}: final_policies needs more --seeds."
    return replace(trained_drives(final, options, COLUMNS), empty=empty)


def final_table(results: ResultsFolder) -> str:
    """Return the Markdown table of final performance by variant.

    For each driver, the mean over its episodes is computed first. A value in the table is the mean
    of these means over the variant's drivers.
    """
    rows = results.rows("final_policies.csv")
    columns: dict[str, tuple[Callable[[Row], float], int]] = {
        "reward per decision": (lambda row: float(row["mean_reward"]), 3),
        "mean speed, m/s": (lambda row: float(row["mean_speed_m_s"]), 2),
        "collisions per episode": (lambda row: row["collided"] == "True", 3),
        "ego hit something": (lambda row: row["ego_hit"] == "True", 3),
    }
    lines = []
    driven = grouped(rows, itemgetter("training"))
    for variant, names in grouped(driven, lambda name: name.rpartition("-")[0]).items():
        own = [driven[name] for name in names]
        cells = [f"`{variant}`", str(len(own)), str(len(own[0]))]
        for value, digits in columns.values():
            mean = mean_with_interval(mean_with_interval(map(value, rows)).value for rows in own)
            cells.append(f"{mean.value:.{digits}f} ± {mean.half_width:.{digits}f}")
        lines.append(cells)
    return markdown_table(["training", "drivers", "episodes of each", *columns], lines)


FINAL_POLICIES = Experiment(
    name="final_policies",
    meaning="the final policies of the learning curves in the traffic of the evaluation",
    row="an episode of the policy of a training, under the check with which it was trained",
    plan=final_plan,
    summaries={"final_policies": final_table},
)
