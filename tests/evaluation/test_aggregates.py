"""Aggregate statistics by hand, and against rliable."""

import math

import numpy as np
import pytest

from drl_av.arrays import FloatArray
from drl_av.errors import DrlAvError
from drl_av.evaluation.aggregates import (
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
)

TASKS = [np.array([1.0, 9.0, 5.0, 100.0]), np.array([4.0, 3.0, -50.0, 7.0])]
"""Four episodes among each of two numbers of vehicles."""


def drawn(seed: int, above: float = 0.0) -> list[FloatArray]:
    """Thirty speeds among each of three numbers of vehicles, some of them equal."""
    random = np.random.default_rng(seed)
    return [np.round(random.normal(mean + above, 2.0, 30)) for mean in (20.0, 24.0, 28.0)]


def test_the_interquartile_mean_is_that_of_all_episodes_without_the_outer_quarters() -> None:
    # -50, 1 | 3, 4, 5, 7 | 9, 100: the mean of all is 9.9, of the quartiles of each task 6.25
    assert interquartile_mean(TASKS).value == 19 / 4
    # of seven episodes one is left out at each end: 2 to 6
    assert interquartile_mean([np.array([7.0, 1, 2, 6, 3, 5, 4000])]).value == 23 / 5


def test_one_score_at_each_number_of_vehicles_has_no_interval() -> None:
    found = interquartile_mean([np.array([3.0]), np.array([4.0])])
    assert found == (3.5, -math.inf, math.inf)
    assert str(found) == "3.50"
    one = probability_of_improvement([np.array([3.0])], [np.array([2.0])])
    assert one == (1.0, -math.inf, math.inf)
    assert math.isfinite(interquartile_mean([np.array([3.0]), np.array([4.0, 5.0])]).low)


def test_each_number_of_vehicles_is_resampled_on_its_own() -> None:
    # without strata a resample would mix 10s and 20s, and the interval would not be a point
    assert interquartile_mean([np.full(5, 10.0), np.full(5, 20.0)]) == (15.0, 15.0, 15.0)


def test_the_episodes_of_one_seed_are_resampled_together() -> None:
    # what one seed loses among few vehicles it gains among many: whichever seeds are drawn, the
    # middle two of four scores have the mean 5
    opposed = [np.array([0.0, 10.0]), np.array([10.0, 0.0])]
    assert interquartile_mean(opposed) == (5.0, 5.0, 5.0)
    # and a score of 5 is exceeded by one of the two numbers of vehicles
    assert probability_of_improvement(opposed, [np.array([5.0])] * 2) == (0.5, 0.5, 0.5)


def test_the_probability_of_improvement_counts_pairs_and_half_of_the_ties() -> None:
    # 3 beats 1 and 2 and ties with 3, 2 beats 1 and ties with 2: 4 of 6
    first = probability_of_improvement([np.array([3.0, 2.0])], [np.array([1.0, 2.0, 3.0])])
    assert first.value == pytest.approx(4 / 6)
    # the mean of 4 / 6 and 0, although the second has more pairs
    both = probability_of_improvement(
        [np.array([3.0, 2.0]), np.zeros(9)], [np.array([1.0, 2.0, 3.0]), np.ones(9)]
    )
    assert both.value == pytest.approx(2 / 6)
    assert probability_of_improvement([np.full(4, 30.0)], [np.full(4, 30.0)]) == (0.5, 0.5, 0.5)


def test_the_profile_is_the_share_of_episodes_above_a_speed_and_not_at_it() -> None:
    assert performance_profile(TASKS, [-51, 4, 8.9, 9, 100]).tolist() == [1, 0.5, 0.25, 0.125, 0]


def test_scores_that_cannot_be_compared_are_refused_in_one_sentence() -> None:
    with pytest.raises(DrlAvError, match="of 2 and of 1 numbers of vehicles: compare drivers"):
        probability_of_improvement(TASKS, TASKS[:1])
    for empty in ([], [np.array([1.0]), np.array([])]):
        with pytest.raises(DrlAvError, match="has no scores: drive at least one episode"):
            interquartile_mean(empty)


def test_the_scores_may_be_one_array() -> None:
    scores = np.arange(8.0).reshape(2, 4)
    assert interquartile_mean(scores) == interquartile_mean([*scores])
    assert probability_of_improvement(scores, scores).value == 0.5


def test_values_and_intervals_are_those_of_rliable() -> None:
    pytest.importorskip("rliable", reason="the extra dev has rliable")
    from rliable import library, metrics

    np.random.seed(3)  # rliable resamples with numpy's global generator
    ours, theirs = drawn(1, above=0.7), drawn(2)
    matrices = [np.array(strata).T for strata in (ours, theirs)]  # runs x tasks
    cases = [
        (metrics.aggregate_iqm, matrices[0], interquartile_mean(ours)),
        (metrics.probability_of_improvement, matrices, probability_of_improvement(ours, theirs)),
    ]
    for function, scores, found in cases:
        values, intervals = library.get_interval_estimates(
            {"ours": scores}, lambda *x, f=function: np.array([f(*x)]), reps=1000
        )
        assert found.value == pytest.approx(values["ours"][0], rel=1e-12)
        width = found.high - found.low
        assert found[1:] == pytest.approx(intervals["ours"][:, 0], abs=0.1 * width)
    taus = np.arange(14.0, 34.0)
    profile = library.score_distributions(matrices[0], taus)
    assert performance_profile(ours, taus.tolist()) == pytest.approx(profile, abs=1e-12)
