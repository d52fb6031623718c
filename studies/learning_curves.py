"""The study ``curves``: learning curves of Algorithm 1 of the paper and of three variants.

The variants are training without the safety check (Fig. 5 of the paper), and prioritized or uniform
replay instead of two buffers (Fig. 7), each in the traffic ``calm`` and in that of the paper. The
latter are trained in the twin, the first two also in SUMO.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from operator import itemgetter
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.config.presets import LITERAL
from drl_av.evaluation.aggregates import interquartile_mean, probability_of_improvement
from drl_av.evaluation.figure_style import label_axes, panels
from drl_av.evaluation.provenance import read_provenance
from drl_av.evaluation.statistics import Mean, grouped, mean_with_interval
from drl_av.evaluation.table import Inputs, read_rows, report_corrupt_table
from drl_av.files.table import Row
from studies.options import Options, Plan, Program, Settings, order_by
from studies.results import markdown_table
from studies.trainings import TrainingJob, TrainingRows, evaluations_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LATE_BRAKING: Settings = {"traffic": {"kind": "calm", "keep_stopping_distance": False}}
"""The traffic of the trainings in ``calm``, which were made before SUMO's vehicles kept a stopping
distance."""
IN_SUMO: Settings = {"traffic": {"kind": "paper"}}
"""The traffic of Sec. IV-B of the paper."""
MIXED: Settings = {"simulation": {"world": "twin"}, **IN_SUMO}
"""The same in the twin."""
VARIANTS: dict[str, Settings] = {
    "paper": {"safety": {"check": "paper"}, "learning": {"replay": "two-buffer"}},
    "permit_all": {"safety": {"check": "permit_all"}},
    "prioritized": {"learning": {"replay": "prioritized"}},
    "uniform": {"learning": {"replay": "uniform"}},
}
CHANGES: dict[str, tuple[Settings, Settings]] = {
    **{name: (LATE_BRAKING, settings) for name, settings in VARIANTS.items()},
    **{f"mixed_{name}": (MIXED, settings) for name, settings in VARIANTS.items()},
    "mixed_literal": (MIXED, LITERAL),
    **{f"sumo_{name}": (IN_SUMO, VARIANTS[name]) for name in ("paper", "permit_all")},
}
"""The settings that each variant changes, by section of the config; in the traffic of the paper,
"mixed_" stands before those in the twin, and "sumo_" before those in SUMO."""
EPISODES = {
    "paper": 10 * (10_000,),
    "permit_all": (10_000, *9 * (3000,)),
    "prioritized": (10_000, *9 * (3000,)),
    "mixed_paper": 53 * (10_000,),
    "mixed_permit_all": 53 * (10_000,),
    "mixed_prioritized": 10 * (10_000,),
    "mixed_uniform": 10 * (10_000,),
    "mixed_literal": (10_000,),
    "sumo_paper": 10 * (10_000,),
    "sumo_permit_all": 10 * (10_000,),
}
"""The episodes of each training of a variant, for the seeds 0, 1, ... A training continues where a
number is raised."""
PAPER_REWARD = -0.025
"""Reward per decision of the paper's trained driver (Sec. IV-C of the paper)."""
STYLES = {
    "paper": ("#d55e00", "two buffers, safety check"),
    "permit_all": ("#000000", "two buffers, no safety check"),
    "prioritized": ("#0072b2", "prioritized replay, safety check"),
    "uniform": ("#009e73", "uniform replay, safety check"),
    "sumo_paper": ("#0072b2", "the same with the check, in SUMO"),
    "sumo_permit_all": ("#009e73", "the same without the check, in SUMO"),
}
REPLAY = ("mixed_paper", "mixed_prioritized", "mixed_uniform")
"""The variants of Fig. 7 of the paper, in its own traffic; the first one has two buffers."""
WORLDS = "mixed_paper", "sumo_paper", "mixed_permit_all", "sumo_permit_all"
"""The variants of Fig. 5 of the paper, learning curves in its own traffic, in both worlds."""
PANELS = {
    "mean_reward": "mean reward a decision, greedy",
    "training_reward": "the same while exploring",
    "training_collisions": "collisions an episode while exploring",
    "collisions": "collisions an episode, greedy",
    "safety_triggers": "safety triggers an episode, greedy",
}
CHECKED = "mean_reward", "training_reward", "training_collisions"
COMPARED = "mean_reward", "training_collisions", "collisions"
"""The columns in which trainings in SUMO are compared with those in the twin."""
FEW = 10
"""The largest number of trainings that are drawn one by one."""
WITHIN = 0.05, 0.95
"""The quantiles of more trainings than that, which are drawn as the ends of a band."""
EARLY, EXPLORED, LEARNED = (300, 600), 5000, 1000
"""``collisions_table`` counts the greedy driver's collisions between the first two episodes, the
exploring one's up to the third, and again the greedy driver's after the fourth."""
FIGURES = {
    "learning_check": (("paper", "permit_all"), CHECKED),
    "learning_mixed": (WORLDS, COMPARED),
    "learning_replay": (("paper", "prioritized"), ("mean_reward", "safety_triggers")),
    "learning_mixed_replay": (REPLAY, ("mean_reward", "training_reward", "safety_triggers")),
}
"""The variants and columns of each figure."""

SMOOTHED_OVER = 5
"""Number of evaluations in the moving mean with which convergence is determined."""
END = 0.1
"""The end of a curve is the mean over this fraction of its evaluations, the last ones."""
NEAR = 0.1
"""A value is near the end if |value - end| is at most this fraction of |first value - end|."""
COUNTED = ("collisions", "ego_hits")
"""The columns of ``curves.csv`` that count episodes of an evaluation."""
SUMMARIZED = {
    "reward": "mean_reward",
    "mean_speed_m_s": "mean_speed_m_s",
    "collisions_an_episode": "collisions",
    "ego_hits_an_episode": "ego_hits",
    "training_reward": "training_reward",
    "training_collisions_an_episode": "training_collisions",
}
"""For each column of ``convergence.csv``, the column of ``curves.csv`` that it summarizes."""


def curve_plan(options: Options) -> Plan:
    """Return a plan to train the variants on each of their seeds, for their ``EPISODES``.

    The trainings of seed 0 come first.
    """
    configs = {name: options.settings(Config(), *CHANGES[name]) for name in EPISODES}
    jobs = []
    for seed in range(options.trainings(max(map(len, EPISODES.values())))):
        for variant, episodes in EPISODES.items():
            for stop in episodes[seed : seed + 1]:
                config = options.settings(configs[variant], {"learning": {"seed": seed}})
                folder, learning = options.runs / f"{variant}-{seed}", config.learning
                stop = min(stop, learning.episodes)
                jobs.append(TrainingJob(variant, config, stop, folder, learning.evaluate_every))
    return reporting_plan(configs, jobs, evaluations_of)


def reporting_plan(
    configs: dict[str, Config],
    jobs: Sequence[TrainingJob],
    rows_of: Callable[[TrainingJob], list[Row]],
) -> Plan:
    """Return a plan of a table whose rows are read from the folders of trainings.

    Args:
        configs: The config of each variant with seed 0, for the provenance.
        jobs: The trainings.
        rows_of: Reads the rows from a training's folder.
    """
    place = order_by(variant=configs, seed=int, episode=int)
    return Plan(Inputs(configs), place, trainings=[TrainingRows(job, rows_of) for job in jobs])


class Curve(NamedTuple):
    """One column of a variant's evaluations, for all seeds.

    The curve contains only the evaluations that exist for every seed.
    """

    episodes: list[int]
    """The training episodes after which the driver was evaluated."""
    values: FloatArray
    """Shape (seeds, episodes)."""

    @property
    def means(self) -> list[Mean]:
        """The mean over the seeds at each episode, with its 95 % confidence interval."""
        return [mean_with_interval(column) for column in self.values.T]

    @property
    def ends(self) -> FloatArray:
        """The final performance of each seed: the mean over the last tenth of the evaluations."""
        return np.asarray(self.values[:, -_end_of(len(self.episodes)) :].mean(axis=1))

    @property
    def end(self) -> Mean:
        """The mean of ``ends`` over the seeds, with its 95 % confidence interval."""
        return mean_with_interval(self.ends)


def curve(rows: Iterable[Row], variant: str, column: str) -> Curve:
    """Return the curve of one column for a variant; empty if no row has this variant."""
    seeds: dict[str, dict[int, float]] = {}
    for row in rows:
        if row["variant"] == variant:
            seeds.setdefault(row["seed"], {})[int(row["episode"])] = _value(row, column)
    episodes = sorted(set.intersection(*map(set, seeds.values())) if seeds else ())
    return Curve(episodes, np.array([[seed[e] for e in episodes] for seed in seeds.values()]))


def _value(row: Row, column: str) -> float:
    """Return a value of ``curves.csv`` as a number.

    A number of episodes (``COUNTED``) is divided by the number of all episodes of the evaluation.
    """
    return float(row[column]) / (int(row["evaluation_episodes"]) if column in COUNTED else 1)


def converged_at(episodes: Sequence[int], values: Sequence[float]) -> int:
    """Return the first episode from which on a learning curve stays near its end.

    ``values``, at least one, are the results after ``episodes``. The function smooths them with
    ``smoothed``. The end is the mean of the last tenth of ``values``. A smoothed value is near the
    end if the difference is at most 10 % of |first smoothed value - end|. The values in the last
    tenth always count as near, because they define the end.
    """
    smooth, count = smoothed(values), _end_of(len(values))
    end = float(np.mean(values[-count:]))
    away = np.abs(smooth - end) > NEAR * abs(end - smooth[0])
    strays = np.flatnonzero(away[: len(values) - count])
    return episodes[int(strays[-1]) + 1] if len(strays) else episodes[0]


def smoothed(values: Sequence[float]) -> FloatArray:
    """Return the centred moving mean of ``values`` over ``SMOOTHED_OVER`` values, an odd number.

    At both ends of the curve the mean is over fewer values.
    """
    half = SMOOTHED_OVER // 2
    return np.array([np.mean(values[max(0, k - half) : k + half + 1]) for k in range(len(values))])


def _end_of(count: int) -> int:
    return max(1, round(END * count))


def convergence(rows: Sequence[Row]) -> list[Row]:
    """Compute ``convergence.csv``: the episode at which each variant converges, and final means.

    ``rows`` are those of ``curves.csv``. The first row that is returned for a variant covers all of
    its seeds, up to the last episode that all of them have driven. If some trainings are longer, a
    second row covers only the longest trainings.
    """
    summaries = []
    for variant, own in grouped(rows, itemgetter("variant")).items():
        last = last_episodes(own)
        for far in sorted({min(last.values()), max(last.values())}):
            summaries.append(_summary([r for r in own if last[r["seed"]] >= far], variant))
    return summaries


def last_episodes(rows: Iterable[Row]) -> dict[str, int]:
    """Return the last episode of each training of a variant, by its seed."""
    seeds = grouped(rows, itemgetter("seed"))
    return {seed: max(int(row["episode"]) for row in own) for seed, own in seeds.items()}


def _summary(rows: Sequence[Row], variant: str) -> Row:
    reward = curve(rows, variant, "mean_reward")
    summary = {
        "variant": variant,
        "seeds": str(len(reward.values)),
        "episodes": str(reward.episodes[-1]),
        "converged_at": str(converged_at(reward.episodes, [m.value for m in reward.means])),
    }
    for name, column in SUMMARIZED.items():
        end = curve(rows, variant, column).end
        summary[name] = f"{end.value:.6g}"
        summary[f"{name}_ci95"] = f"{end.half_width:.6g}"
    return summary


def convergence_table(folder: Path) -> str:
    """Return the Markdown table of each variant's final performance and episode of convergence."""
    columns = {
        "reward per decision": ("reward", 3),
        "mean speed, m/s": ("mean_speed_m_s", 2),
        "collisions per episode": ("collisions_an_episode", 2),
        "reward while exploring": ("training_reward", 3),
        "collisions while exploring": ("training_collisions_an_episode", 2),
    }
    lines = []
    for row in read_rows(folder / "convergence.csv"):
        cells = [f"`{row['variant']}`", row["seeds"], f"{row['converged_at']} of {row['episodes']}"]
        for name, digits in columns.values():
            mean = Mean(float(row[name]), float(row[f"{name}_ci95"]))
            cells.append(f"{mean:.{digits}f}")
        lines.append(cells)
    return markdown_table(["training", "seeds", "converged at episode", *columns], lines)


def replay_table(folder: Path) -> str:
    """Return the Markdown table of what each kind of buffer ends with in the paper's traffic.

    Interquartile means over the seeds, and the probability that a training with two buffers earns
    more than one with the other kind; each with its 95 % interval (Agarwal et al. 2021).
    """
    rows, lines = read_rows(folder / "curves.csv"), []
    found = {row["variant"] for row in rows}
    for variant in [variant for variant in REPLAY if variant in found]:
        ours, rewards = (curve(rows, name, "mean_reward").ends for name in (REPLAY[0], variant))
        speeds = curve(rows, variant, "mean_speed_m_s").ends
        cells = [f"`{variant}`", str(len(rewards))]
        for ends, digits in ((rewards, 4), (speeds, 2)):
            mean = interquartile_mean([ends])
            cells.append(f"{mean.value:.{digits}f} [{mean.low:.{digits}f}, {mean.high:.{digits}f}]")
        is_ours = variant == REPLAY[0]
        cells.append("-" if is_ours else str(probability_of_improvement([ours], [rewards])))
        lines.append(cells)
    heads = ("reward per decision", "mean speed, m/s", "probability that two buffers earn more")
    return markdown_table(["training", "seeds", *heads], lines)


def cost_table(folder: Path) -> str:
    """Return the Markdown table of the wall time of all trainings of each variant."""
    with report_corrupt_table(folder / "curves.csv"):
        seconds = read_provenance(folder / "curves.csv")["wall_time_s"]
    lines = []
    for variant, own in grouped(read_rows(folder / "curves.csv"), itemgetter("variant")).items():
        last = last_episodes(own)
        hours = sum(seconds[f"{variant}-{seed}"] for seed in last) / 3600
        lines.append([f"`{variant}`", str(len(last)), str(sum(last.values())), f"{hours:.1f}"])
    return markdown_table(["training", "seeds", "episodes of all", "hours"], lines)


def worlds_table(folder: Path) -> str:
    """Return the Markdown table of how the trainings in SUMO lie among those in the twin.

    It gives the share of SUMO's evaluations that lie within the quantiles ``WITHIN`` of the twin's
    trainings at the same episode, and the share of the twin's own within those of the others there.
    """
    rows, lines = read_rows(folder / "curves.csv"), []
    for variants in (WORLDS[:2], WORLDS[2:]):
        for column in COMPARED:
            twin, sumo = (curve(rows, variant, column) for variant in variants)
            shared = min(len(twin.episodes), len(sumo.episodes))
            ours, theirs = (one.values[:, :shared] for one in (sumo, twin))
            others = [np.delete(theirs, seed, 0) for seed in range(len(theirs))]
            shares = _share_within(ours, theirs), fmean(map(_share_within, theirs, others))
            ends = [f"{one.end:.3f}" for one in (sumo, twin)]
            percent = (f"{100 * share:.0f}" for share in shares)
            lines.append([f"`{variants[1]}`", PANELS[column], *ends, *percent])
    heads = "in SUMO, at the end", "in the twin", "within the twin's, %", "expected, %"
    return markdown_table(["training", "column", *heads], lines)


def _share_within(values: FloatArray, others: FloatArray) -> float:
    """Return the share of evaluations, the last axis, within the quantiles of other trainings.

    It is NaN if there are none.
    """
    if len(others) == 0:
        return math.nan
    low, high = np.quantile(others, WITHIN, axis=0)
    return float(((low <= values) & (values <= high)).mean())


def collisions_table(folder: Path) -> str:
    """Return the Markdown table of when the trainings in the paper's traffic collide.

    The shares of episodes are means over the trainings: that of all episodes while they explore,
    and the least and the greatest of an evaluation of the greedy drivers.
    """
    rows, lines = read_rows(folder / "curves.csv"), []
    for variant in WORLDS:
        exploring, greedy = (curve(rows, variant, column) for column in COMPARED[1:])
        at, shares = np.array(greedy.episodes), 100 * greedy.values.mean(axis=0)
        early = shares[(EARLY[0] <= at) & (at <= EARLY[1])]
        mean = 100 * exploring.values[:, at <= EXPLORED].mean()
        last = np.where(greedy.values > 0, at, 0).max(axis=1)
        free = f"{np.sum(last <= LEARNED)} of {len(last)}"
        between = f"{early.min():.0f} to {early.max():.0f}" if early.size else "-"
        lines.append([f"`{variant}`", f"{mean:.1f}", between, free, str(last.max())])
    heads = f"exploring, to {EXPLORED}, %", f"greedy, {EARLY[0]} to {EARLY[1]}, %"
    return markdown_table(["training", *heads, f"none after {LEARNED}", "none at all after"], lines)


def learning_figure(variants: Sequence[str], columns: Sequence[str], folder: Path) -> "Figure":
    """Draw columns of ``curves.csv`` for some variants, one panel for each column.

    Variants without rows are left out.
    """
    rows = read_rows(folder / "curves.csv")
    names = [name for name in variants if any(row["variant"] == name for row in rows)]
    figure, axes = panels((11.5, 3.8), 1, len(columns))
    for panel, column in zip(axes, columns, strict=True):
        label_axes(panel, "training episode", PANELS[column])
        for variant in names:
            _draw(panel, rows, variant, column)
        if "reward" not in column:
            panel.set_ylim(bottom=-0.02 * panel.get_ylim()[1])
    label = f"the paper's {PAPER_REWARD}"
    axes[0].axhline(PAPER_REWARD, color="#555555", linestyle=":", linewidth=1, label=label)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False)
    return figure


def _draw(axes: "Axes", rows: Sequence[Row], variant: str, column: str) -> None:
    """Draw a variant's mean over the seeds with its 95 % interval, and a dot at convergence.

    A thin line shows each seed whose training is at least as long as the mean's curve. If there are
    more than ``FEW`` seeds, the band holds nine tenths of them instead, and there are no lines. Of
    a single seed there is only the mean.
    """
    found, (color, name) = curve(rows, variant, column), STYLES[variant.removeprefix("mixed_")]
    seeds, line = len(found.values), "--" if variant.startswith("sumo_") else "-"
    means, halves = np.array(found.means).T
    ends = means - halves, means + halves
    own = [r for r in rows if r["variant"] == variant and int(r["episode"]) >= found.episodes[-1]]
    if seeds > FEW:
        own, ends = [], tuple(np.quantile(found.values, WITHIN, axis=0))
    label = f"{name} ({seeds} {'seed' if seeds == 1 else 'seeds'})"
    axes.plot(found.episodes, means, line, color=color, label=label)
    if seeds > 1:
        axes.fill_between(found.episodes, *ends, color=color, alpha=0.2, linewidth=0)
    for seed in sorted({row["seed"] for row in own}):
        longer = curve([row for row in own if row["seed"] == seed], variant, column)
        axes.plot(longer.episodes, longer.values[0], color=color, linewidth=0.8, alpha=0.6)
    if column == "mean_reward":
        at = converged_at(found.episodes, means.tolist())
        axes.plot(at, means[found.episodes.index(at)], "o", color=color, markersize=7)


CURVES = Program(
    name="curves",
    meaning="learning curves with and without the check, with two buffers and prioritized replay",
    row="an evaluation; training_* are means over the training episodes since the one before",
    plan=curve_plan,
    derived={"convergence.csv": convergence},
    tables={
        "learning_collisions": collisions_table,
        "convergence": convergence_table,
        "cost": cost_table,
        "replay": replay_table,
        "worlds": worlds_table,
    },
    figures={name: partial(learning_figure, *drawn) for name, drawn in FIGURES.items()},
)
