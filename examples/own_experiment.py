"""An experiment of your own: does idm-mobil need the safety check to look 3 s ahead (T_min)?

python examples/own_experiment.py
"""

from pathlib import Path

from drl_av.config import Config
from drl_av.evaluation.statistics import mean_with_interval
from studies.cells import Drives
from studies.experiment import Experiment, ResultsFolder, reproduce
from studies.markdown import count, markdown_table, mean_speed
from studies.options import ReproduceOptions
from studies.plan import Plan, by
from studies.store import MadeWith

T_MIN_S = ("3.0", "1.5")
VEHICLES = 20


def plan(options: ReproduceOptions) -> Plan:
    """Return the episodes to drive, the same traffic with each T_min, and the order of the rows."""
    configs = {t: Config().updated("safety", minimum_ttc_s=float(t)) for t in T_MIN_S}
    cells = [
        Drives(config, ("idm-mobil",), VEHICLES, options.drives, named=(("t_min_s", t),))
        for t, config in configs.items()
    ]
    return Plan(MadeWith(configs), [cells], order=by(t_min_s=T_MIN_S, seed=int))


def summary(results: ResultsFolder) -> str:
    """Return a Markdown table of the results; the gain is paired by seed."""
    rows = results.rows(T_MIN.table)
    driven = {t: [row for row in rows if row["t_min_s"] == t] for t in T_MIN_S}
    speeds = [[float(row["mean_speed_m_s"]) for row in own] for own in driven.values()]
    gain = mean_with_interval(b - a for a, b in zip(*speeds, strict=True))
    lines = [[t, mean_speed(own), str(count(own, "ego_hit"))] for t, own in driven.items()]
    lines.append(["gain", str(gain), ""])
    return markdown_table(["T_min, s", "mean speed, m/s", "ego hit something"], lines)


T_MIN = Experiment(
    name="t_min",
    meaning="the driver idm-mobil under the check paper with two values of T_min",
    row="an episode",
    plan=plan,
    summaries={"t_min": summary},
)


def main() -> None:
    """Drive the episodes that the folder lacks, and print the summary."""
    folder = Path("t_min_results")
    folder.mkdir(exist_ok=True)
    for progress in reproduce(T_MIN, ReproduceOptions(drives=5, jobs=1, out=folder)):
        print(f"{progress.done} of {progress.total} episodes")
    print(summary(ResultsFolder(folder)))


if __name__ == "__main__":
    main()
