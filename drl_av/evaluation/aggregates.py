"""Computes aggregate statistics of scores over several numbers of vehicles.

Agarwal et al. recommend these statistics ("Deep Reinforcement Learning at the Edge of the
Statistical Precipice", NeurIPS 2021). ``Strata`` are the scores of one driver: one array for each
number of vehicles, with one score for each episode. Agarwal et al. call these a task and a run. The
arrays may have different lengths.

The values agree with their package rliable. There, runs are independent in each task; here, the
episodes of one traffic seed, or of one training, are alike among all numbers of vehicles. So a
bootstrap draws the same places from all arrays of one length, whose scores have the same order.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.errors import DrlAvError

Strata = Sequence[FloatArray] | FloatArray
RESAMPLES = 2000
"""Number of resamples of a bootstrap; rliable uses as many for its performance profiles."""
SEED = 0
"""Seed of the resampling, so that the same scores have the same interval."""


class Estimate(NamedTuple):
    """A statistic, and the two ends of its 95 % bootstrap interval (percentile method).

    The ends are -inf and inf if there is only one score at each number of vehicles.
    """

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        interval = f" [{self.low:.2f}, {self.high:.2f}]" if math.isfinite(self.low) else ""
        return f"{self.value:.2f}{interval}"


def interquartile_mean(strata: Strata) -> Estimate:
    """Compute the mean of the middle half of all scores (Agarwal et al., Section 4.3).

    The lowest and the highest quarter of the scores, rounded down, are left out. The interval is
    that of the bootstrap of traffic seeds. ``strata`` has one array of shape (episodes,) for each
    number of vehicles; a place in all arrays of one length is the same traffic seed.

    Raises:
        DrlAvError: a number of vehicles has no scores.
    """
    _require_scores(strata)
    random = np.random.default_rng(SEED)
    places = {
        count: random.integers(0, count, (RESAMPLES, count))
        for count in sorted({*map(len, strata)})
    }
    drawn = [scores[places[len(scores)]] for scores in strata]
    resampled = _middle_mean(np.concatenate(drawn, axis=1))
    return _estimate(float(_middle_mean(np.concatenate(strata))), resampled, strata)


def probability_of_improvement(ours: Strata, theirs: Strata) -> Estimate:
    """Compute the probability that our score exceeds theirs (Agarwal et al., Section 4.3).

    Each score of ours is compared with each score of theirs at the same number of vehicles; a tie
    counts as one half. The result is the mean over the numbers of vehicles. The bootstrap resamples
    both drivers independently, as rliable does. For drivers in the same traffic, the paired gain
    has a narrower interval. Each argument is as in ``interquartile_mean``.

    Raises:
        DrlAvError: a number of vehicles has no scores, or the drivers have different numbers of
            vehicles.
    """
    _require_scores(ours, theirs)
    if len(ours) != len(theirs):
        raise DrlAvError(
            f"The scores are of {len(ours)} and of {len(theirs)} numbers of vehicles: compare "
            "drivers that drove among the same numbers."
        )
    random = np.random.default_rng(SEED)
    times = [
        {
            count: random.multinomial(count, np.full(count, 1 / count), RESAMPLES)
            for count in sorted({*map(len, strata)})
        }
        for strata in (ours, theirs)
    ]
    values, resampled = [], []
    for x, y in zip(ours, theirs, strict=True):
        wins = np.greater.outer(x, y) + 0.5 * np.equal.outer(x, y)
        values.append(wins.mean())
        drawn = (times[0][len(x)] @ wins) * times[1][len(y)]
        resampled.append(drawn.sum(axis=1) / wins.size)
    return _estimate(float(np.mean(values)), np.mean(resampled, axis=0), (*ours, *theirs))


def performance_profile(strata: Strata, thresholds: Sequence[float]) -> FloatArray:
    """Compute the share of scores above each threshold (Agarwal et al., Section 4.2).

    Returns:
        Shape (thresholds,), each share from 0 to 1.

    Raises:
        DrlAvError: a number of vehicles has no scores.
    """
    _require_scores(strata)
    above = np.less.outer(np.array(thresholds), np.concatenate(strata))
    shares: FloatArray = above.mean(axis=1)
    return shares


def _middle_mean(scores: FloatArray) -> FloatArray:
    """Return the interquartile mean along the last axis."""
    cut = scores.shape[-1] // 4
    middle: FloatArray = np.sort(scores, axis=-1)[..., cut : scores.shape[-1] - cut]
    means: FloatArray = middle.mean(axis=-1)
    return means


def _estimate(value: float, resampled: FloatArray, strata: Strata) -> Estimate:
    if all(len(scores) == 1 for scores in strata):
        return Estimate(value, -math.inf, math.inf)
    low, high = np.percentile(resampled, (2.5, 97.5)).tolist()
    return Estimate(value, low, high)


def _require_scores(*all_strata: Strata) -> None:
    for strata in all_strata:
        if not len(strata) or not all(len(scores) for scores in strata):
            raise DrlAvError("A number of vehicles has no scores: drive at least one episode.")
