"""The worlds of a training at scale."""

from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from drl_av.config.presets import PRESETS
from drl_av.driving.wide_observation import EGO_AT, WIDE_SIZE, observe_wide
from drl_av.learning.large_scale import Part, TwinWorlds
from drl_av.road.snapshot import Snapshot
from drl_av.twin.worlds import COUNT

FloatArray = npt.NDArray[np.float32]
Flags = npt.NDArray[np.bool_]
LARGE = (
    PRESETS["large"]
    .updated("ppo", worlds=8)
    .updated("simulation", decisions_per_episode=6)
    .updated("traffic", presets=("calm", "overtaking"), vehicles_min=2, vehicles_max=5)
)
KEEP, ACCELERATE, HARD_BRAKE = 0, 1, 3
RIGHT_ACCELERATE, RIGHT_HARD_BRAKE, LEFT_ACCELERATE = 5, 7, 9
"""The numbers of some actions."""


@pytest.fixture
def worlds() -> TwinWorlds:
    return TwinWorlds(LARGE, seed=3)


def stepped(worlds: TwinWorlds, action: int) -> tuple[FloatArray, Flags, list[dict[str, Any]]]:
    """Drive one decision in all worlds; return the rewards in units of 10 m/s, and the rest."""
    _, rewards, dones, infos = worlds.step(np.full(8, action))
    return rewards / (10.0 * (1.0 - LARGE.ppo.discount)), dones, infos


def test_the_worlds_are_divided_evenly_by_traffic(worlds: TwinWorlds) -> None:
    parts = [
        (part.env.num_envs, part.env.config.safety.check, part.env.config.traffic.speed_gain_max)
        for part in worlds.parts
    ]
    assert parts == [(4, "strict", 0.0), (4, "strict", 1.0)]


def test_the_observation_is_that_of_the_driver_in_sumo_and_ends_with_the_mask(
    worlds: TwinWorlds,
) -> None:
    observations, *_ = worlds.step(np.full(8, 9))  # everybody who may goes left and accelerates
    masks = worlds.env_method("action_masks")
    seen = 0
    for part in worlds.parts:
        env, rows = part.env, part.rows
        for row in range(env.num_envs):
            n = env.worlds.near[row, COUNT]
            snapshot = Snapshot(0.0, ("",) * n, *(env.episodes.scene[row, :, :n]))
            lanes = tuple(env.episodes.lanes[row].tolist())
            wide = observe_wide(snapshot, env.road, 250.0, 30.0, lanes)
            observed = observations[rows][row]
            assert observed[:WIDE_SIZE].tobytes() == wide.tobytes()
            mask = env.episodes.executed[row] == np.arange(12)
            assert observed[WIDE_SIZE:].tolist() == mask.tolist()
            assert masks[rows][row].tolist() == mask.tolist()
            seen += observed[EGO_AT + 3] != 0
    assert seen > 0  # some are changing lanes


def test_the_reward_is_the_speed_less_what_it_costs_to_turn_about_abort_and_brake_hard(
    worlds: TwinWorlds,
) -> None:
    costs = LARGE.ppo
    told = {
        HARD_BRAKE: costs.hard_brake_cost,
        LEFT_ACCELERATE: costs.reversal_cost,  # it braked before
        RIGHT_HARD_BRAKE: costs.reversal_cost + costs.abort_cost + costs.hard_brake_cost,
    }
    goes_on = np.ones(8, np.bool_)
    for action, cost in told.items():
        executed = [env.episodes.executed[:, action] for env in (p.env for p in worlds.parts)]
        rewards, dones, _ = stepped(worlds, action)
        goes_on &= (np.concatenate(executed) == action) & ~dones
        expected = worlds.observation[goes_on, EGO_AT] - cost
        assert rewards[goes_on] == pytest.approx(expected, abs=1e-5)
    assert goes_on.any()


def test_short_headways_and_forced_braking_cost_and_nothing_else_does() -> None:
    dense = LARGE.updated("safety", check="paper").updated("simulation", decisions_per_episode=99)
    dense = dense.updated("traffic", vehicles_min=25, vehicles_max=25)
    part, costs = Part(slice(0, 16), dense.with_traffic("calm"), seed=3), LARGE.ppo
    env, seen = part.env, set()
    own = costs.reversal_cost, costs.abort_cost, costs.hard_brake_cost
    sums = {sum(some) for count in range(4) for some in combinations(own, count)}
    for decision in range(200):
        before_m_s, was = env.episodes.scene[:, 2].copy(), env.episodes.lanes.copy()
        aside = RIGHT_ACCELERATE if decision // 10 % 2 else LEFT_ACCELERATE
        action = np.where(env.episodes.executed[:, aside] == aside, aside, ACCELERATE)
        reward, hit, late = part.step(action)
        for row in np.flatnonzero(~hit):
            scene = env.scene(row)
            front, rear = scene.affordances.own_front, scene.affordances.own_rear
            speed_m_s = float(scene.snapshot.speed_m_s[0])
            is_short = front is not None and front.gap_m < speed_m_s and speed_m_s > 5.0
            is_forced = False
            if rear is not None and (was[row, 0] != was[row, 1] or scene.lane_change is not None):
                after_m_s = float(scene.snapshot.speed_m_s[rear.vehicle])
                is_forced = before_m_s[row, rear.vehicle] - after_m_s > 2.0
            cost = is_short * costs.short_headway_cost + is_forced * costs.forced_brake_cost
            rest = (speed_m_s - 20.0) / 10.0 - cost - float(reward[row])
            assert min(abs(rest - more) for more in sums) < 1e-5
            seen.add((is_short, is_forced))
        part.begin_anew(hit | late)
    assert {True} == {any(flags) for flags in zip(*seen, strict=True)}


def test_episodes_end_at_different_times_and_hand_over_their_last_observation(
    worlds: TwinWorlds,
) -> None:
    ends = []
    for _ in range(12):
        _, dones, infos = stepped(worlds, KEEP)
        for world in np.flatnonzero(dones).tolist():
            assert infos[world]["TimeLimit.truncated"]
            last = infos[world]["terminal_observation"]
            assert not (worlds.observation == last).all(1).any()
        assert [bool(info) for info in infos] == dones.tolist()
        ends.append(dones)
    assert np.sum(ends, axis=0).tolist() == [2] * 8  # 12 decisions are two episodes of 6
    assert len({tuple(column) for column in np.transpose(ends)}) > 1


def test_the_same_seed_gives_the_same_worlds() -> None:
    one, again, other = (TwinWorlds(LARGE, seed).observation for seed in (3, 3, 4))
    assert one.tobytes() == again.tobytes()
    assert one.tobytes() != other.tobytes()
