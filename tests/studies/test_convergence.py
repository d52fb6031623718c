"""The end of a learning curve, and the episode from which on it is near it: worked by hand."""

import math

import pytest

from studies.convergence import converged_at, convergence, curve, smoothed

EPISODES = list(range(100, 2100, 100))


def test_smoothing_is_centred_and_takes_what_there_is_at_the_ends() -> None:
    assert smoothed([0, 10, 20, 60, 10, 0]) == pytest.approx([10, 22.5, 20, 20, 22.5, 70 / 3])


def test_converged_where_the_smoothed_curve_comes_within_a_tenth_of_the_way_and_stays() -> None:
    # -1 to 0: near is above -0.1. A step at the sixth value reaches the smoothed curve in steps of
    # 0.2 around it: -1, -1, -1, -0.8, -0.6, -0.4, -0.2, 0; the unsmoothed one would say 600.
    values = [-1.0] * 5 + [0.0] * 15
    assert converged_at(EPISODES, values) == 800


def test_a_curve_that_leaves_again_has_not_converged_before_it_comes_back() -> None:
    values = [-1.0] * 5 + [0.0] * 5 + [-1.0] * 3 + [0.0] * 7
    # the first visit, at 800, is the decoy; the last stray window holds the value of 1300
    assert converged_at(EPISODES, values) == 1600


def test_one_outlier_in_a_seed_or_in_the_end_does_not_move_it() -> None:
    values = [-1.0] * 5 + [0.0] * 15
    assert converged_at(EPISODES, [*values[:12], -0.4, *values[13:]]) == 800
    assert converged_at(EPISODES, [*values[:-1], -0.15]) == 800


def test_a_curve_that_falls_converges_as_one_that_rises() -> None:
    assert converged_at(EPISODES, [0.0] * 5 + [-1.0] * 15) == 800
    assert converged_at(EPISODES, [-0.3] * 20) == 100


def test_near_is_a_share_of_the_way_and_not_of_the_value() -> None:
    # the same shape on top of an offset: within 10 % of the end's value it would be everywhere
    values = [-1.0] * 5 + [0.0] * 15
    assert converged_at(EPISODES, [value - 100 for value in values]) == 800


def row(variant: str, seed: int, episode: int, reward: float, collisions: int) -> dict[str, str]:
    numbers = {
        "mean_reward": reward,
        "mean_speed_m_s": 20 + seed,
        "collisions": collisions,
        "ego_hits": 0,
        "evaluation_episodes": 10,
        "training_reward": -0.7,
        "training_collisions": 0.5,
    }
    place = {"variant": variant, "seed": seed, "episode": episode}
    return {key: str(value) for key, value in (place | numbers).items()}


def test_ends_are_means_of_seeds_each_over_its_last_tenth() -> None:
    # 20 evaluations: the last two are the end. Seed 0 ends at (-0.1 - 0.3) / 2 = -0.2, seed 1 at 0,
    # and goes on alone for ever worse, which belongs to no mean over seeds but its own.
    rewards = {0: [-1.0] * 18 + [-0.1, -0.3], 1: [-1.0] * 18 + [0.0, 0.0] + [-9.0] * 5}
    rows = [
        row("paper", seed, 100 * (place + 1), reward, 2 if place == 19 else 0)
        for seed, values in rewards.items()
        for place, reward in enumerate(values)
    ]
    found, longest = convergence(rows)
    assert (longest["seeds"], longest["episodes"], longest["reward"]) == ("1", "2500", "-9")
    assert math.isinf(float(longest["reward_ci95"]))
    assert (found["seeds"], found["episodes"]) == ("2", "2000")
    assert float(found["reward"]) == pytest.approx(-0.1)
    # t(0.975, 1) = 12.706; standard error of -0.2 and 0 is 0.1
    assert float(found["reward_ci95"]) == pytest.approx(1.2706, abs=1e-4)
    assert float(found["mean_speed_m_s"]) == 20.5
    # 2 of 10 episodes in one of the two evaluations: 0.1 an episode, the same in both seeds
    assert float(found["collisions_an_episode"]) == pytest.approx(0.1)
    assert float(found["collisions_an_episode_ci95"]) == 0
    assert float(found["training_collisions_an_episode"]) == 0.5
    assert float(found["training_reward"]) == -0.7


def test_a_curve_goes_as_far_as_every_seed() -> None:
    rows = [row("paper", 0, 100, -1, 0), row("paper", 0, 200, 0, 0), row("paper", 1, 100, -3, 0)]
    found = curve([*rows, row("permit_all", 0, 100, -9, 0)], "paper", "mean_reward")
    assert found.episodes == [100]
    assert found.values.tolist() == [[-1.0], [-3.0]]
    assert found.means[0].value == -2
