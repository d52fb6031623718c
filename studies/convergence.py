"""Computes moving means of learning curves, their end, and the episode at which they converged."""

from collections.abc import Iterable, Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from drl_av.evaluation.statistics import Mean, grouped, mean_with_interval
from drl_av.files import Row
from drl_av.road.road import FloatArray

SMOOTHED_OVER = 5
"""Number of evaluations in the moving mean with which convergence is determined."""
END = 0.1
"""The end of a curve is the mean over this fraction of its evaluations, the last ones."""
NEAR = 0.1
"""A value is near the end if |value - end| is at most this fraction of |first value - end|."""
COUNTED = ("collisions", "ego_hits")
"""The columns of ``curves.csv`` that count episodes of an evaluation."""


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
    def end(self) -> Mean:
        """The final performance: the mean over the seeds and the last tenth of the evaluations."""
        count = _end_of(len(self.episodes))
        return mean_with_interval(self.values[:, -count:].mean(axis=1))


def curve(rows: Iterable[Row], variant: str, column: str) -> Curve:
    """Return the curve of one column for a variant; empty if no row has this variant."""
    seeds: dict[str, dict[int, float]] = {}
    for row in rows:
        if row["variant"] == variant:
            seeds.setdefault(row["seed"], {})[int(row["episode"])] = _value(row, column)
    shared = set.intersection(*map(set, seeds.values())) if seeds else set()
    episodes = sorted(shared)
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
    smooth = smoothed(values)
    count = _end_of(len(values))
    end = float(np.mean(values[-count:]))
    away = np.abs(smooth - end) > NEAR * abs(end - smooth[0])
    strays = np.flatnonzero(away[: len(values) - count])
    return episodes[int(strays[-1]) + 1] if len(strays) else episodes[0]


def smoothed(values: Sequence[float], over: int = SMOOTHED_OVER) -> FloatArray:
    """Return the centred moving mean of ``values`` over ``over`` values, an odd number.

    At both ends of the curve the mean is over fewer values.
    """
    half = over // 2
    return np.array(
        [np.mean(values[max(0, place - half) : place + half + 1]) for place in range(len(values))]
    )


def _end_of(count: int) -> int:
    return max(1, round(END * count))


COLUMNS = {
    "reward": "mean_reward",
    "mean_speed_m_s": "mean_speed_m_s",
    "collisions_an_episode": "collisions",
    "ego_hits_an_episode": "ego_hits",
    "training_reward": "training_reward",
    "training_collisions_an_episode": "training_collisions",
}
"""For each column of ``convergence.csv``, the column of ``curves.csv`` that it summarizes."""


def convergence(rows: Sequence[Row]) -> list[Row]:
    """Compute ``convergence.csv``: the episode at which each variant converges, and final means.

    ``rows`` are those of ``curves.csv``. The first row that is returned for a variant covers all of
    its seeds, up to the last episode that all of them have driven. If some trainings are longer, a
    second row covers only the longest trainings.
    """
    summaries = []
    for variant, own in grouped(rows, itemgetter("variant")).items():
        last: dict[str, int] = {}
        for row in own:
            last[row["seed"]] = max(last.get(row["seed"], 0), int(row["episode"]))
        for far in sorted({min(last.values()), max(last.values())}):
            summaries.append(_summary([r for r in own if last[r["seed"]] >= far], variant))
    return summaries


def _summary(rows: Sequence[Row], variant: str) -> Row:
    reward = curve(rows, variant, "mean_reward")
    means = [mean.value for mean in reward.means]
    summary = {
        "variant": variant,
        "seeds": str(len(reward.values)),
        "episodes": str(reward.episodes[-1]),
        "converged_at": str(converged_at(reward.episodes, means)),
    }
    for name, column in COLUMNS.items():
        end = curve(rows, variant, column).end
        summary[name] = f"{end.value:.6g}"
        summary[f"{name}_ci95"] = f"{end.half_width:.6g}"
    return summary
