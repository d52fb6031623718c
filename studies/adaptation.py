"""The study ``adaptation``: safety triggers with and without continual adaptation.

It corresponds to Fig. 8 of the paper, with a driver of the preset ``fast``.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drl_av.config import Config
from drl_av.config.presets import adaptation as adapted
from drl_av.config.presets import preset
from drl_av.evaluation.figure_style import one_panel
from drl_av.evaluation.statistics import mean_with_interval, moving_average
from drl_av.files import Row
from studies.learning_curves import curve, reporting_plan
from studies.options import Options, Plan, Program
from studies.results import ResultsFolder, markdown_table
from studies.study import changed
from studies.trainings import TrainingJob, blocks_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ORIGIN = {
    "episodes": 1000,
    "seed": 1,
    "evaluate_every": 100,
    "speed_weight": 0.8,
    "discount": 0.95,
    "learning_rate": 1e-3,
    "lane_change_margin": 0.04,
}
"""The [learning] settings in which the driver's training differs from the preset ``fast``."""
LATE_BRAKING = {"traffic": {"keep_stopping_distance": False}}
"""The traffic of these trainings, from before SUMO's vehicles kept a stopping distance."""
CHANGES = {"adaptation": {}, "no_adaptation": {"learning_rate": 0.0}}
"""The [learning] settings in which each variant differs from ``drl-av adapt``."""
BLOCK = 100
"""Each row of ``adaptation.csv`` holds means over this number of episodes."""
SUMMED_OVER = 10_000
"""Each row of the documentation's table holds means over this number of episodes."""
FILTERED_OVER = 10_000
"""Number of episodes in the moving average of Sec. IV-D of the paper."""
LABELS = {"adaptation": "continual adaptation", "no_adaptation": "no adaptation"}
COLORS = {"adaptation": "#d55e00", "no_adaptation": "#000000"}


def adaptation_plan(options: Options) -> Plan:
    """Return a plan to continue the training of a driver, with and without learning.

    Because they continue with the experience that the driver collected, it is trained first. The
    folder of this training contains the folders of the others.
    """
    trained = changed(preset("fast"), LATE_BRAKING).updated("learning", **ORIGIN)
    origin = _job("pretrained", options.with_files(trained), options.runs)
    base = options.with_files(adapted(trained))
    configs = {
        variant: base.updated("learning", seed=0, **settings)
        for variant, settings in CHANGES.items()
    }
    jobs = [_job(name, config, origin.folder, origin) for name, config in configs.items()]
    settings = {**configs, "pretrained": origin.config}
    return reporting_plan(settings, [jobs], blocks_of)


def _job(
    variant: str, config: Config, within: Path, origin: TrainingJob | None = None
) -> TrainingJob:
    folder = within / f"{variant}-{config.learning.seed}"
    return TrainingJob(variant, config, config.learning.episodes, folder, BLOCK, origin)


def adaptation_table(folder: Path) -> str:
    """Return the Markdown table with two rows, learning on and off, for each 10,000 episodes.

    The table ends at the last episode that both variants have driven.
    """
    rows = ResultsFolder(folder).rows("adaptation.csv")
    last = {row["variant"]: int(row["episode"]) for row in rows}
    lines = []
    for begin in range(0, min(last.values()), SUMMED_OVER):
        end = min(begin + SUMMED_OVER, *last.values())
        for variant, learning in (("adaptation", "on"), ("no_adaptation", "off")):
            own = [r for r in rows if r["variant"] == variant and begin < int(r["episode"]) <= end]
            triggers, reward = (
                mean_with_interval(float(row[f"training_{name}"]) for row in own)
                for name in ("safety_triggers", "reward")
            )
            hits, collided = (
                sum(round(_episodes(row) * float(row[f"training_{name}"])) for row in own)
                for name in ("ego_hits", "collisions")
            )
            means = [f"{mean.value:.4f} ± {mean.half_width:.4f}" for mean in (triggers, reward)]
            counts = [str(hits), str(collided - hits)]
            lines.append([learning, f"{begin + 1:,} to {end:,}", *means, *counts])
    names = ("learning", "episodes", "safety triggers an episode", "reward per decision")
    return markdown_table([*names, "ego hit something", "was hit"], lines)


def _episodes(row: Row) -> int:
    """Return the number of episodes in the block that ends with the episode of ``row``."""
    return int(row["episode"]) % BLOCK or BLOCK


def adaptation_figure(folder: Path) -> "Figure":
    """Draw the safety triggers per episode with learning on and off, as means over all seeds.

    Bold lines are moving averages over 10,000 episodes, faint ones means over 100 episodes.
    """
    rows = ResultsFolder(folder).rows("adaptation.csv")
    figure, axes = one_panel(
        "episode", f"safety triggers an episode\n(mean of the last {FILTERED_OVER:,} episodes)"
    )
    for variant, label in LABELS.items():
        found = curve(rows, variant, "training_safety_triggers")
        if found.episodes:
            episodes, triggers = np.array(found.episodes, float), found.values.mean(axis=0)
            axes.plot(episodes, triggers, color=COLORS[variant], alpha=0.2, linewidth=0.7)
            filtered = moving_average(episodes, triggers, FILTERED_OVER)
            axes.plot(episodes, filtered, color=COLORS[variant], label=label, linewidth=2)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)
    return figure


ADAPTATION = Program(
    name="adaptation",
    meaning="safety triggers of a driver with and without continual adaptation",
    row=f"means over {BLOCK} episodes",
    plan=adaptation_plan,
    derived={},
    tables={"adaptation": adaptation_table},
    figures={"adaptation": adaptation_figure},
)
