"""The study ``adaptation``: safety triggers with and without continual adaptation.

It is Fig. 8 of the paper: the trained driver of Algorithm 1, in the paper's traffic in the twin.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.config.presets import adaptation as adapted
from drl_av.evaluation.figure_style import one_panel
from drl_av.evaluation.figures import moving_average
from drl_av.evaluation.statistics import mean_with_interval
from drl_av.evaluation.table import read_rows
from studies.learning_curves import MIXED, Curve, curve, reporting_plan
from studies.options import Options, Plan, Program
from studies.results import markdown_table
from studies.trainings import TrainingJob, blocks_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEEDS = 5
"""Number of drivers, each of which learns with another seed."""
CHANGES = {"adaptation": {}, "no_adaptation": {"learning_rate": 0.0}}
"""The [learning] settings in which each variant differs from ``drl-av adapt``."""
BLOCK = 500
"""Each row of ``adaptation.csv`` holds means over this number of episodes."""
FILTERED_OVER = 10_000
"""Number of episodes in the moving average of Sec. IV-D of the paper, and in a row of the table."""
LABELS = {"adaptation": "continual adaptation", "no_adaptation": "no adaptation"}
COLORS = {"adaptation": "#d55e00", "no_adaptation": "#000000"}


def adaptation_plan(options: Options) -> Plan:
    """Return a plan to continue the trainings of Algorithm 1, with and without learning.

    Because they continue with the experience that the driver collected, it is trained first, in the
    folder in which ``curves`` trains it. This folder contains the folders of the others.
    """
    trained = options.settings(Config(), MIXED)
    base = options.with_files(adapted(trained))
    configs = {name: base.updated("learning", **settings) for name, settings in CHANGES.items()}
    jobs = []
    for seed in range(options.trainings(SEEDS)):
        own = trained.updated("learning", seed=seed)
        folder, learning = options.runs / f"mixed_paper-{seed}", own.learning
        origin = TrainingJob("mixed_paper", own, learning.episodes, folder, learning.evaluate_every)
        for variant, config in configs.items():
            folder, episodes = origin.folder / f"{variant}-{seed}", config.learning.episodes
            config = config.updated("learning", seed=seed)
            jobs.append(TrainingJob(variant, config, episodes, folder, BLOCK, origin))
    return reporting_plan({**configs, "mixed_paper": trained}, jobs, blocks_of)


def adaptation_table(folder: Path) -> str:
    """Return the Markdown table with two rows, learning on and off, for each 10,000 episodes.

    The means and intervals are over the drivers. The table ends at the last episode that both
    variants have driven.
    """
    rows = read_rows(folder / "adaptation.csv")
    columns = ("safety_triggers", "reward", "ego_hits", "collisions")
    curves = {
        variant: [curve(rows, variant, f"training_{column}") for column in columns]
        for variant in CHANGES
    }
    last, lines = min(own[0].episodes[-1] for own in curves.values()), []
    for begin in range(0, last, FILTERED_OVER):
        end = min(begin + FILTERED_OVER, last)
        for variant, learning in (("adaptation", "on"), ("no_adaptation", "off")):
            triggers, reward, hits, collided = (
                _means(found, begin, end) for found in curves[variant]
            )
            means = f"{mean_with_interval(triggers):.3f}", f"{mean_with_interval(reward):.4f}"
            driven = (end - begin) * len(triggers)
            counts = [round(hits.mean() * driven), round((collided - hits).mean() * driven)]
            lines.append([learning, f"{begin + 1:,} to {end:,}", *means, *map(str, counts)])
    names = ("learning", "episodes", "safety triggers an episode", "reward per decision")
    return markdown_table([*names, "ego hit something", "was hit"], lines)


def _means(found: Curve, begin: int, end: int) -> FloatArray:
    """Return each seed's mean over the episodes after ``begin`` up to ``end``, shape (seeds,)."""
    episodes, at = np.array(found.episodes, float), found.episodes.index(end)
    return np.array([moving_average(episodes, seed, end - begin)[at] for seed in found.values])


def adaptation_figure(folder: Path) -> "Figure":
    """Draw the safety triggers per episode with learning on and off.

    Bold lines are the means over all drivers of a moving average over 10,000 episodes, thin ones
    those of each driver.
    """
    rows = read_rows(folder / "adaptation.csv")
    figure, axes = one_panel(
        "episode", f"safety triggers an episode\n(mean of the last {FILTERED_OVER:,} episodes)"
    )
    for variant, label in LABELS.items():
        found = curve(rows, variant, "training_safety_triggers")
        if found.episodes:
            episodes, color = np.array(found.episodes, float), COLORS[variant]
            filtered = [moving_average(episodes, seed, FILTERED_OVER) for seed in found.values]
            for each in filtered:
                axes.plot(episodes, each, color=color, alpha=0.3, linewidth=0.8)
            axes.plot(episodes, np.mean(filtered, 0), color=color, label=label, linewidth=2)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)
    return figure


ADAPTATION = Program(
    name="adaptation",
    meaning="safety triggers of a driver with and without continual adaptation",
    row=f"means over {BLOCK} episodes",
    plan=adaptation_plan,
    tables={"adaptation": adaptation_table},
    figures={"adaptation": adaptation_figure},
)
