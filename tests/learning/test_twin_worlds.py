"""The worlds of a training at scale."""

import numpy as np
import pytest

from drl_av.config.presets import PRESETS
from drl_av.driving.wide_observation import EGO_AT, WIDE_SIZE, observe_wide
from drl_av.learning.twin_worlds import TwinWorlds
from drl_av.road.snapshot import Snapshot
from drl_av.twin.worlds import COUNT

LARGE = (
    PRESETS["large"]
    .updated("ppo", worlds=8, paper_share=0.5, overtaking_share=0.25)
    .updated("simulation", decisions_per_episode=6)
    .updated("traffic", vehicles_min=2, vehicles_max=5)
)


@pytest.fixture
def worlds() -> TwinWorlds:
    return TwinWorlds(LARGE, seed=3)


def test_the_worlds_are_divided_by_check_and_traffic(worlds: TwinWorlds) -> None:
    parts = [
        (rows.stop - rows.start, env.config.safety.check, env.config.traffic.speed_gain_max)
        for rows, env in worlds.parts
    ]
    assert parts == [(3, "strict", 0.0), (1, "strict", 1.0), (3, "paper", 0.0), (1, "paper", 1.0)]


def test_the_observation_is_that_of_the_driver_in_sumo_and_ends_with_the_mask(
    worlds: TwinWorlds,
) -> None:
    worlds.step(np.full(8, 9))  # everybody who may goes left and accelerates
    seen = 0
    for rows, env in worlds.parts:
        for row in range(env.num_envs):
            n = env.worlds.near[row, COUNT]
            snapshot = Snapshot(0.0, ("",) * n, *(env.episodes.scene[row, :, :n]))
            lanes = tuple(env.episodes.lanes[row].tolist())
            wide = observe_wide(snapshot, env.road, 250.0, 30.0, lanes)
            observed = worlds.observation[rows][row]
            assert observed[:WIDE_SIZE].tobytes() == wide.tobytes()
            mask = env.episodes.executed[row] == np.arange(12)
            assert observed[WIDE_SIZE:].tolist() == mask.tolist()
            assert worlds.permitted[rows][row].tolist() == mask.tolist()
            seen += observed[EGO_AT + 3] != 0
    assert seen > 0  # some are changing lanes


def test_the_reward_is_the_speed_less_what_hard_braking_and_aborting_cost(
    worlds: TwinWorlds,
) -> None:
    started = worlds.step(np.full(8, 8))  # left at the same speed
    before = worlds.observation[:, EGO_AT + 3].copy()
    speed = worlds.observation[:, EGO_AT].copy()
    over = started.truncated
    outcome = worlds.step(np.full(8, 7))  # right, and brakes hard: it aborts a change to the left
    for world in range(8):
        if not over[world] and not outcome.truncated[world] and before[world] == 1:
            after = worlds.observation[world, EGO_AT]
            assert after == pytest.approx(speed[world] - 0.4, abs=1e-5)
            assert outcome.reward[world] == pytest.approx(after - 0.1 - 0.1, abs=1e-5)
            break
    else:
        pytest.fail("nobody was changing to the left")


def test_episodes_end_at_different_times_and_hand_over_their_last_observation(
    worlds: TwinWorlds,
) -> None:
    ends = []
    for _ in range(12):
        outcome = worlds.step(np.zeros(8, np.int64))
        assert outcome.final.shape == (outcome.truncated.sum(), WIDE_SIZE + 12)
        last = outcome.final
        assert not any((last == row).all(1).any() for row in worlds.observation)
        ends.append(outcome.truncated)
    assert np.sum(ends, axis=0).tolist() == [2] * 8  # 12 decisions are two episodes of 6
    assert len({tuple(column) for column in np.transpose(ends)}) > 1


def test_the_same_seed_gives_the_same_worlds() -> None:
    one, again, other = (TwinWorlds(LARGE, seed).observation for seed in (3, 3, 4))
    assert one.tobytes() == again.tobytes()
    assert one.tobytes() != other.tobytes()
