"""The experiment ``fast`` (ours) compares the preset ``fast`` with the paper's whole schedule."""

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.evaluation.statistics import mean_with_interval
from drl_av.experiments.cells import trained_drives
from drl_av.experiments.curves import variant_config
from drl_av.experiments.experiment import Experiment, Results
from drl_av.experiments.markdown import count, markdown_table
from drl_av.experiments.options import ReproduceOptions
from drl_av.experiments.plan import Plan
from drl_av.experiments.training_jobs import TrainingJob

COLUMNS = ("seed", "mean_reward", "mean_speed_m_s", "ego_hit")


def fast_plan(options: ReproduceOptions) -> Plan:
    """Plan one training with the paper's whole schedule, and one with ``fast`` for each seed.

    The drivers of all trainings are evaluated.
    """
    short = options.laid_over(preset("fast").updated("learning", evaluate_every=100))
    configs = {"paper-0": variant_config(options.laid_over(Config()), "paper")} | {
        f"fast-{seed}": short.updated("learning", seed=seed) for seed in range(options.seeds)
    }
    jobs = [
        TrainingJob(
            name.partition("-")[0],
            config,
            config.learning.episodes,
            options.runs / name,
            config.learning.evaluate_every,
        )
        for name, config in configs.items()
    ]
    return trained_drives(jobs, options, COLUMNS)


def fast_table(results: Results) -> str:
    """Return the Markdown table of the results, one row for each training's driver.

    A gain is the paired difference from the driver of the paper's whole schedule.
    """
    seconds = results.made_by("fast.csv")["wall_time_s"]
    rows = results.rows("fast.csv")
    trainings = list(dict.fromkeys(row["training"] for row in rows))
    driven = {name: [row for row in rows if row["training"] == name] for name in trainings}
    lines = []
    for name, own in driven.items():
        cells = [f"`{name}`", f"{seconds[name]:,.0f}", f"{count(own, 'ego_hit')} of {len(own)}"]
        for column, digits in (("mean_reward", 3), ("mean_speed_m_s", 2)):
            here, there = (
                [float(row[column]) for row in side] for side in (own, driven[trainings[0]])
            )
            gain = mean_with_interval(a - b for a, b in zip(here, there, strict=True))
            for mean in (mean_with_interval(here), gain):
                cells.append(f"{mean.value:.{digits}f} ± {mean.half_width:.{digits}f}")
        lines.append(cells)
    names = ("training", "seconds", "ego hit something", "reward per decision", "gain")
    return markdown_table([*names, "mean speed, m/s", "gain"], lines)


FAST = Experiment(
    name="fast",
    meaning="the preset fast on every seed, beside the driver of the whole schedule of 10000",
    row="an episode of the driver of a training",
    plan=fast_plan,
    summaries={"fast": fast_table},
)
