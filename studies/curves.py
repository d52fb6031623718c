"""The experiment ``curves``: learning curves of Algorithm 1 of the paper and of two variants.

The variants are training without the safety check (Fig. 5 of the paper), and prioritized replay
instead of two buffers (Fig. 7).
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from drl_av.config import Config
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.files import Row
from studies.cells import training_plan
from studies.convergence import converged_at, convergence, curve
from studies.experiment import Experiment, ResultsFolder
from studies.markdown import markdown_table
from studies.options import VARIANTS, ReproduceOptions
from studies.plan import Plan
from studies.training_jobs import TrainingJob, evaluations_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CHANGES: dict[str, dict[str, dict[str, Any]]] = {
    "paper": {"safety": {"check": "paper"}, "learning": {"replay": "two-buffer"}},
    "permit_all": {"safety": {"check": "permit_all"}},
    "prioritized": {"learning": {"replay": "prioritized"}},
}
"""The settings that each variant changes, by section of the config."""
PAPER_SEEDS, PAPER_EPISODES = 200, 10_000
PAPER_REWARD = -0.025
"""Reward per decision of the paper's trained driver (Sec. IV-C of the paper)."""
LABELS = {
    "paper": "two buffers, safety check",
    "permit_all": "two buffers, no safety check",
    "prioritized": "prioritized replay, safety check",
}
COLORS = {"paper": "#d55e00", "permit_all": "#000000", "prioritized": "#0072b2"}
PANELS = {
    "mean_reward": "mean reward a decision, greedy",
    "training_reward": "the same while exploring",
    "training_collisions": "collisions an episode while exploring",
    "safety_triggers": "safety triggers an episode, greedy",
}


def curve_plan(options: ReproduceOptions) -> Plan:
    """Return a plan to train each variant on each seed for ``options.episodes`` episodes.

    The first ``options.full_seeds`` seeds then continue to the end of the schedule.
    """
    config = options.with_files(Config())
    configs = {variant: variant_config(config, variant) for variant in VARIANTS}
    goals = curve_jobs(options, config)
    short = [job.until(min(job.stop, options.episodes)) for job in goals]
    rounds = [short, [job for job in goals if job.stop > options.episodes]]
    return training_plan(configs, rounds, evaluations_of)


def variant_config(base: Config, variant: str, seed: int = 0) -> Config:
    """Return the config of one training of a variant; raises ConfigError if a setting is wrong."""
    for section, settings in CHANGES[variant].items():
        base = base.updated(section, **settings)
    return base.updated("learning", seed=seed)


def curve_jobs(options: ReproduceOptions, config: Config) -> list[TrainingJob]:
    """Return the training jobs of the learning curves: each variant on each seed."""
    schedule = config.learning.episodes
    return [
        TrainingJob.whole(
            variant, variant_config(config, variant, seed), options.runs / f"{variant}-{seed}"
        ).until(schedule if seed < options.full_seeds else min(options.episodes, schedule))
        for seed, variant in product(range(options.seeds), options.variants)
    ]


def convergence_table(results: ResultsFolder) -> str:
    """Return the Markdown table of each variant's final performance and episode of convergence."""
    columns = {
        "reward per decision": ("reward", 3),
        "mean speed, m/s": ("mean_speed_m_s", 2),
        "collisions per episode": ("collisions_an_episode", 2),
        "reward while exploring": ("training_reward", 3),
        "collisions while exploring": ("training_collisions_an_episode", 2),
    }
    lines = []
    for row in results.rows("convergence.csv"):
        cells = [f"`{row['variant']}`", row["seeds"], f"{row['converged_at']} of {row['episodes']}"]
        for name, digits in columns.values():
            half_width = float(row[f"{name}_ci95"])
            interval = f" ± {half_width:.{digits}f}" if math.isfinite(half_width) else ""
            cells.append(f"{float(row[name]):.{digits}f}{interval}")
        lines.append(cells)
    return markdown_table(["training", "seeds", "converged at episode", *columns], lines)


def cost_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the computing time that the paper's 200 trainings would take.

    The time is extrapolated from the wall times of our longest trainings of each variant.
    """
    seconds = results.made_by("curves.csv")["wall_time_s"]
    episodes: dict[str, dict[str, int]] = {}
    for row in results.rows("curves.csv"):
        own = episodes.setdefault(row["variant"], {})
        own[row["seed"]] = max(own.get(row["seed"], 0), int(row["episode"]))
    lines = []
    for variant, own in episodes.items():
        longest = max(own.values())
        whole = [seconds[f"{variant}-{seed}"] for seed, n in own.items() if n == longest]
        an_episode_s = sum(whole) / len(whole) / longest
        hours = an_episode_s * PAPER_EPISODES * PAPER_SEEDS / 3600
        core_hours, days, each = f"{hours:,.0f}", f"{hours / 2 / 24:.1f}", f"{hours / 200:.1f}"
        cells = [f"`{variant}`", f"{an_episode_s:.2f}", core_hours, f"{days} days", f"{each} hours"]
        lines.append(cells)
    names = ("seconds an episode", f"{PAPER_SEEDS} seeds, core hours", "2 cores", "200 cores")
    return markdown_table(["training", *names], lines)


def check_figure(rows: list[Row]) -> "Figure | None":
    """Draw the reward and the collisions of learning with and without the safety check.

    The figure corresponds to Fig. 5 of the paper. It is None if the rows have neither variant.
    """
    columns = ("mean_reward", "training_reward", "training_collisions")
    return _figure(rows, ("paper", "permit_all"), columns)


def replay_figure(rows: list[Row]) -> "Figure | None":
    """Draw reward and safety triggers of learning with two buffers and with prioritized replay.

    The figure corresponds to Fig. 7 of the paper. It is None if the rows have neither
    variant.
    """
    return _figure(rows, ("paper", "prioritized"), ("mean_reward", "safety_triggers"))


def _figure(rows: list[Row], names: Sequence[str], columns: Sequence[str]) -> "Figure | None":
    variants = [name for name in names if any(row["variant"] == name for row in rows)]
    if not variants:
        return None
    figure, axes = panels((1 + 5 * len(columns), 4.0), 1, len(columns))
    for panel, column in zip(axes, columns, strict=True):
        label_axes(panel, "training episode", PANELS[column])
        for variant in variants:
            _draw(panel, rows, variant, column)
        if "reward" not in column:
            panel.set_ylim(bottom=-0.02 * panel.get_ylim()[1])
    label = f"the paper's {PAPER_REWARD}"
    axes[0].axhline(PAPER_REWARD, color="#555555", linestyle=":", linewidth=1, label=label)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False)
    return figure


def _draw(axes: "Axes", rows: Sequence[Row], variant: str, column: str) -> None:
    """Draw a variant's mean over the seeds with its 95 % band, and a dot at convergence.

    A thin line shows each seed whose training is at least as long as the mean's curve.
    """
    found, color = curve(rows, variant, column), COLORS[variant]
    seeds = len(found.values)
    means = np.array([mean.value for mean in found.means])
    halves = np.array([mean.half_width for mean in found.means])
    label = f"{LABELS[variant]} ({seeds} {'seed' if seeds == 1 else 'seeds'})"
    axes.plot(found.episodes, means, color=color, label=label)
    if np.isfinite(halves).all():
        axes.fill_between(
            found.episodes, means - halves, means + halves, color=color, alpha=0.2, linewidth=0
        )
    own = [r for r in rows if r["variant"] == variant and int(r["episode"]) >= found.episodes[-1]]
    for seed in sorted({row["seed"] for row in own}):
        longer = curve([row for row in own if row["seed"] == seed], variant, column)
        axes.plot(longer.episodes, longer.values[0], color=color, linewidth=0.8, alpha=0.6)
    if column == "mean_reward":
        at = converged_at(found.episodes, means.tolist())
        axes.plot(at, means[found.episodes.index(at)], "o", color=color, markersize=7)


CURVES = Experiment(
    name="curves",
    meaning="learning curves with and without the check, with two buffers and prioritized replay",
    row="an evaluation; training_* are means over the training episodes since the one before",
    plan=curve_plan,
    derived={"convergence.csv": convergence},
    summaries={"convergence": convergence_table, "cost": cost_table},
    figures={"learning_check": check_figure, "learning_replay": replay_figure},
)
