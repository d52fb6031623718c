"""Final performance of the learning curves, with intervals, and the episode of convergence."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from drl_av.evaluation.statistics import Mean, mean_with_interval
from drl_av.files import Row
from drl_av.traffic.road import FloatArray

SMOOTHED_OVER = 5
"""Number of evaluations in the moving mean that determines convergence."""
END = 0.1
"""Fraction of a curve that counts as its end."""
NEAR = 0.1
"""Share of the way from its first value to its end, within which a curve has converged."""
COUNTED = ("collisions", "ego_hits")
"""Columns that count episodes of an evaluation."""


class Curve(NamedTuple):
    """One column of a variant's evaluations, up to the last episode that all seeds have."""

    episodes: list[int]
    values: FloatArray
    """One row per seed and one column per episode."""

    @property
    def means(self) -> list[Mean]:
        """Mean over the seeds at each episode, with its 95 % interval."""
        return [mean_with_interval(column) for column in self.values.T]

    @property
    def end(self) -> Mean:
        """Mean over the seeds of the mean of each over the last tenth of its evaluations."""
        count = _end_of(len(self.episodes))
        return mean_with_interval(self.values[:, -count:].mean(axis=1))


def curve(rows: Iterable[Row], variant: str, column: str) -> Curve:
    """The curve of a variant; empty if the rows have none."""
    seeds: dict[str, dict[int, float]] = {}
    for row in rows:
        if row["variant"] == variant:
            seeds.setdefault(row["seed"], {})[int(row["episode"])] = _value(row, column)
    shared = set.intersection(*map(set, seeds.values())) if seeds else set()
    episodes = sorted(shared)
    return Curve(episodes, np.array([[seed[e] for e in episodes] for seed in seeds.values()]))


def _value(row: Row, column: str) -> float:
    """A value of the table; counts are divided by the number of evaluation episodes."""
    return float(row[column]) / (int(row["evaluation_episodes"]) if column in COUNTED else 1)


def converged_at(episodes: Sequence[int], values: Sequence[float]) -> int:
    """The first episode from which on the curve stays near its end.

    The curve is smoothed by a centred moving mean over five evaluations, fewer at its ends; its
    end is the mean of its last tenth. Near means within 10 % of the difference between its first
    value and its end. Values in the last tenth may be farther away, because they define the end.
    """
    smooth = smoothed(values)
    count = _end_of(len(values))
    end = float(np.mean(values[-count:]))
    away = np.abs(smooth - end) > NEAR * abs(end - smooth[0])
    strays = np.flatnonzero(away[: len(values) - count])
    return episodes[int(strays[-1]) + 1] if len(strays) else episodes[0]


def smoothed(values: Sequence[float], over: int = SMOOTHED_OVER) -> FloatArray:
    """Centred moving mean over an odd number of values; over fewer values at both ends."""
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
"""Columns of ``convergence.csv``, and the columns of ``curves.csv`` that they summarize."""


def convergence(rows: Sequence[Row]) -> list[Row]:
    """The episode at which each variant converged, and its final performance.

    One row up to the last episode that all seeds have, and one of the longest trainings alone where
    these are longer.
    """
    summaries = []
    for variant in dict.fromkeys(row["variant"] for row in rows):
        own = [row for row in rows if row["variant"] == variant]
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
