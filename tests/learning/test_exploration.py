import numpy as np
import pytest

from drl_av.learning.exploration import epsilon_greedy, linear_epsilon


@pytest.mark.parametrize(
    ("episode", "expected"),
    [(0, 1.0), (3_500, 0.6), (6_999, 0.2), (7_000, 0.2), (9_999, 0.2)],
)
def test_papers_schedule_falls_to_a_fifth_over_70_percent_of_10000_episodes(episode, expected):
    # Over all 10,000 episodes instead, episode 3,500 would have 0.72.
    assert linear_epsilon(episode, 10_000) == pytest.approx(expected, abs=2e-4)


def test_schedule_ends_on_its_last_value_exactly():
    assert linear_epsilon(300, 300, start=0.9, end=0.05, fraction=0.5) == 0.05


def refuse() -> int:
    raise AssertionError("the greedy action was asked for")


def test_epsilon_one_takes_every_action_equally_and_never_asks_the_network():
    rng = np.random.default_rng(0)
    taken = [epsilon_greedy(1.0, 12, refuse, rng) for _ in range(12_000)]
    counts = np.bincount(taken, minlength=12)
    assert len(counts) == 12
    assert counts.min() > 850
    assert counts.max() < 1150


def test_epsilon_zero_is_greedy():
    rng = np.random.default_rng(0)
    assert {epsilon_greedy(0.0, 12, lambda: 7, rng) for _ in range(1_000)} == {7}


def test_epsilon_a_fifth_explores_a_fifth_of_the_time():
    rng = np.random.default_rng(0)
    taken = [epsilon_greedy(0.2, 2, lambda: 5, rng) for _ in range(10_000)]
    assert np.mean(np.array(taken) != 5) == pytest.approx(0.2, abs=0.02)
