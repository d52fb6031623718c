"""Trains the preset ``large`` anew with several seeds, and measures what it gains as it learns.

``python -m studies.scale`` does not train a seed again whose policies exist, nor make a row again.
A policy drives in the twin under ``strict``, beside ``gap-mobil`` in the same traffic.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from drl_av.cli.console import exit_status
from drl_av.config import SINGLE_PRESETS
from drl_av.evaluation.figure_style import one_panel, save_figure
from drl_av.learning.large_scale import learner_of, save_actor
from drl_av.learning.twin_worlds import TwinWorlds
from studies.ablation import PRESET, command_line, complete, gain, gains, is_trained

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 500_000, 1_000_000, 2_000_000, 5_000_000, PRESET.ppo.decisions
"""Decisions after which a policy is kept, each rounded down to whole updates; the last ends it."""


class Row(NamedTuple):
    """What a policy gains over ``gap-mobil``, in one kind of traffic."""

    seed: int
    decisions: int
    traffic: str
    gain_m_s: float
    """Mean over 5 to 25 vehicles of the difference of the mean speeds, paired by traffic seed."""
    ego_hits: int


def train(runs: Path, job: tuple[int]) -> None:
    """Train the preset with a seed, and keep its policies."""
    [seed] = job
    config = PRESET.updated("learning", seed=seed)
    if is_trained(_policy_file(runs, seed, POINTS[-1]), config):
        return
    learner, batch = learner_of(config, TwinWorlds(config, seed)), config.ppo.batch_size
    for point in POINTS:
        while learner.num_timesteps < point // batch * batch:
            learner.learn(batch, reset_num_timesteps=False)
        save_actor(_policy_file(runs, seed, point), learner, config)


def measure(runs: Path, job: tuple[int]) -> list[Row]:
    """Return the rows of one seed, a row for each of its policies and each kind of traffic."""
    [seed], rows = job, []
    for point in POINTS:
        for kind in SINGLE_PRESETS:
            policy = _policy_file(runs, seed, point)
            rows.append(Row(seed, point, kind, *gain(runs, kind, policy, TwinWorlds)))
    return rows


def _policy_file(runs: Path, seed: int, decisions: int) -> Path:
    return runs / f"{seed}-{decisions}.safetensors"


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the gains of each seed at the end of its training, and the least of each column."""
    ends = [row for row in rows if row["decisions"] == POINTS[-1]]
    found = gains(ends, "seed")
    found["ego hits"] = pd.DataFrame(ends).groupby("seed")["ego_hits"].sum()
    found.loc["worst"] = found.min()
    found.loc["worst", "ego hits"] = found["ego hits"].max()
    formats = {"ego hits": "{:.0f}".format}
    return str(found.to_string(float_format="{:.2f}".format, formatters=formats))


def figure(rows: Sequence[dict[str, Any]]) -> "Figure":
    """Draw the mean gain of the kinds of traffic as the trainings go on; bold is their mean."""
    made, axes = one_panel("decisions, millions", "gain over gap-mobil, m/s")
    points = np.array(POINTS) / 1e6
    means = pd.DataFrame(rows).pivot_table("gain_m_s", "decisions", "seed").loc[[*POINTS]]
    axes.plot(points, means, color="#0072b2", alpha=0.4, linewidth=0.9)
    axes.plot(points, means.mean(axis=1), color="#0072b2", linewidth=2.2)
    axes.set_xscale("log")
    axes.set_xticks(points, [f"{point:g}" for point in points])
    axes.minorticks_off()
    axes.axhline(0, color="#888888", linewidth=1)
    return made


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status 0."""
    given = command_line("scale", __doc__, range(5)).parse_args(words)
    rows = complete(given, Row, [(seed,) for seed in given.seeds], train, measure)
    save_figure(figure(rows), given.out.with_suffix(".png"))
    print("gain over gap-mobil under strict, m/s, in the twin, at the end of each training")
    print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(exit_status("studies.scale", main))
