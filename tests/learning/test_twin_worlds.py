"""The worlds of a training at scale."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from worlds import ROAD

from drl_av.arrays import BoolArray, FloatArray
from drl_av.config.presets import PRESETS
from drl_av.driving.wide_observation import EGO_AT, WIDE_SIZE, observe_wide
from drl_av.errors import DrlAvWarning, RunError
from drl_av.learning.large_scale import learner_of, train_at_scale
from drl_av.learning.twin_worlds import (
    PLACES_M,
    Part,
    TwinWorlds,
    look_at_whole_road,
    whole_road_size,
)
from drl_av.road.road import road_numbers
from drl_av.road.snapshot import Snapshot
from drl_av.twin.worlds import COUNT, DESIRED_M_S, EXPECTED_M_S

LARGE = (
    PRESETS["large"]
    .updated("ppo", worlds=8)
    .updated("simulation", decisions_per_episode=6)
    .updated("traffic", presets=("calm", "overtaking"), vehicles_min=2, vehicles_max=5)
)
TO_THE_EXIT = PRESETS["large-exit"]
KEEP, ACCELERATE, BRAKE, HARD_BRAKE = range(4)
RIGHT_ACCELERATE, RIGHT_HARD_BRAKE, LEFT_ACCELERATE = 5, 7, 9
"""The numbers of some actions."""


@pytest.fixture
def worlds() -> TwinWorlds:
    return TwinWorlds(LARGE, seed=2)


def stepped(worlds: TwinWorlds, action: int) -> tuple[FloatArray, BoolArray, list[dict[str, Any]]]:
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
            assert observed[WIDE_SIZE : TwinWorlds.SIZE].tolist() == mask.tolist()
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
            last = infos[world]["terminal_observation"][: TwinWorlds.SIZE]
            assert not (worlds.observation == last).all(1).any()
        assert [bool(info) for info in infos] == dones.tolist()
        ends.append(dones)
    assert np.sum(ends, axis=0).tolist() == [2] * 8  # 12 decisions are two episodes of 6
    assert len({tuple(column) for column in np.transpose(ends)}) > 1


@pytest.fixture(scope="module")
def egos_at_the_exit() -> TwinWorlds:
    """Egos that begin on the left, and that keep their lane miss the exit."""
    settings = TO_THE_EXIT.updated("traffic", presets=("calm",))
    return TwinWorlds(settings.updated("ppo", worlds=6), seed=3)


def test_on_an_open_road_the_driver_sees_the_vehicles_of_its_episode_and_its_way(
    egos_at_the_exit: TwinWorlds,
) -> None:
    [part] = egos_at_the_exit.parts
    env, ahead, gone = part.env, 0, 0
    for _ in range(6):
        egos_at_the_exit.step(np.zeros(6, np.int64))
        for row in range(6):
            scene = env.scene(row)
            wide = observe_wide(scene.snapshot, env.road, 250.0, 30.0, scene.lanes)
            observed = egos_at_the_exit.observation[row]
            assert observed[:WIDE_SIZE].tobytes() == wide.tobytes()
            ahead += observed[EGO_AT + 10] < 0  # lane changes to the right remain
            gone += env.worlds.near[row, COUNT] > len(scene.snapshot.ids)
    assert ahead > 0
    assert gone > 0  # vehicles that have left drive on in the twin, unseen


def test_every_density_up_to_twice_the_usual_one_is_driven(egos_at_the_exit: TwinWorlds) -> None:
    [part] = egos_at_the_exit.parts
    numbers = set[int]()
    for _ in range(12):
        part.begin_anew(np.ones(6, np.bool_))
        numbers |= {*part.env.vehicles.tolist()}
    usual = 75  # for the inflow of the scenario exit
    assert min(numbers) < 0.3 * usual
    assert 1.7 * usual < max(numbers) <= 2 * usual


def test_where_lanes_end_those_behind_in_both_lanes_count_until_ten_decisions_later() -> None:
    settings = TO_THE_EXIT.updated("safety", check="permit_all")
    settings = settings.updated("ppo", abort_cost=0.0, reversal_cost=0.0, hard_brake_cost=0.0)
    settings = settings.updated("ppo", short_headway_cost=0.0, forced_brake_cost=7.0)
    part = Part(slice(0, 12), settings.with_traffic("calm"), seed=2)
    env, since, seen, moved = part.env, [10] * 12, set[tuple[str, bool]](), 0
    for decision in range(160):
        before = [env.scene(row) for row in range(12)]
        action = RIGHT_ACCELERATE if decision // 20 % 2 else LEFT_ACCELERATE
        reward, failed, late = part.step(np.full(12, action if decision % 20 < 8 else KEEP))
        for row in np.flatnonzero(~failed & ~late).tolist():
            then, now = before[row], env.scene(row)
            lane, change = then.affordances.lane, then.lane_change or now.lane_change
            since[row] = 0 if now.affordances.lane != lane else since[row] + 1
            forced = ""
            for place, side in (("own", 0), ("other", change.target - lane if change else 0)):
                rear = then.affordances.rear(side)
                if rear is None or then.snapshot.ids[rear.vehicle] not in now.snapshot.ids:
                    continue
                after = now.snapshot.ids.index(then.snapshot.ids[rear.vehicle])
                moved += after != rear.vehicle
                lost_m_s = then.snapshot.speed_m_s[rear.vehicle] - now.snapshot.speed_m_s[after]
                forced = forced or place * bool(lost_m_s > 2.0)
            counts = change is not None or since[row] < 10
            cost = 7.0 * (counts and bool(forced))
            earned = (float(now.snapshot.speed_m_s[0]) - 20.0) / 10.0 - cost
            assert float(reward[row]) == pytest.approx(earned, abs=1e-5), (decision, row)
            seen.add((forced, change is not None))
        for row in np.flatnonzero(failed | late).tolist():
            since[row] = 10
        part.begin_anew(failed | late)
    assert {("own", True), ("own", False), ("other", True)} <= seen
    assert moved > 0  # others have left


def test_a_missed_exit_ends_the_episode_like_a_collision(egos_at_the_exit: TwinWorlds) -> None:
    [part] = egos_at_the_exit.parts
    part.begin_anew(np.ones(6, np.bool_))
    missed = 0
    for _ in range(120):
        faster = part.env.episodes.executed[:, ACCELERATE] == ACCELERATE
        reward, failed, late = part.step(np.where(faster, ACCELERATE, KEEP))
        assert (failed == (part.env.ways == "exit missed") & ~late).all()
        assert egos_at_the_exit.collisions == 0
        assert (reward[failed] <= -99.0).all()  # 100, less at most 1 for the speed
        assert (reward[~failed] > -4.0).all()
        missed += int(failed.sum())
        part.begin_anew(failed | late)
    assert missed > 6


def test_an_exit_that_is_still_open_when_the_time_is_up_is_no_failure() -> None:
    short = TO_THE_EXIT.updated("simulation", decisions_per_episode=4)
    with pytest.warns(DrlAvWarning, match="its way takes 37 decisions, but an episode has 4"):
        part = Part(slice(0, 6), short.with_traffic("calm"), seed=1)
    for decision in range(4):
        reward, failed, late = part.step(np.zeros(6, np.int64))
        assert late.tolist() == [decision == 3] * 6
        assert not failed.any()
    assert set(part.env.ways) == {"exit missed"}
    assert (reward > -4.0).all()  # not 100 less


def test_the_first_braking_of_an_episode_reverses_nothing() -> None:
    config = LARGE.updated("safety", check="permit_all").with_traffic("calm")
    config = config.updated("traffic", vehicles_min=0, vehicles_max=0)
    for anew, cost in ((True, 0.0), (False, LARGE.ppo.reversal_cost)):
        part = Part(slice(0, 4), config, seed=1)
        part.step(np.full(4, BRAKE))
        part.step(np.full(4, ACCELERATE))
        part.begin_anew(np.full(4, anew))
        reward, *_ = part.step(np.full(4, BRAKE))
        earned = (part.env.episodes.scene[:, 2, 0] - 20.0) / 10.0 - cost
        assert reward == pytest.approx(earned, abs=1e-6)


def test_a_full_disk_leaves_no_folder_of_a_training_at_scale(
    tmp_path: Path, full_disk: None
) -> None:
    with pytest.raises(RunError, match="No space left on device"):
        next(train_at_scale(tmp_path / "run", PRESETS["large"]))
    assert not (tmp_path / "run").exists()


def test_trainings_with_neighbouring_seeds_and_the_parts_of_one_drive_other_traffic() -> None:
    config = LARGE.with_traffic("calm")
    parts = [Part(slice(first, first + 4), config, seed) for seed in (3, 4) for first in (0, 1)]
    begun = [part.env.episodes.scene[world].tobytes() for part in parts for world in range(4)]
    assert len(set(begun)) == 16
    again = Part(slice(0, 4), config, 3).env.episodes.scene
    assert again.tobytes() == parts[0].env.episodes.scene.tobytes()
    later = [part._rng.integers(1_000_000) for part in parts]  # the densities of open roads
    assert len(set(later)) == 4


def test_trainings_with_neighbouring_seeds_begin_their_episodes_at_other_times() -> None:
    config = LARGE.updated("simulation", decisions_per_episode=99)
    begun = [
        np.concatenate([part.env.episodes.decisions for part in TwinWorlds(config, seed).parts])
        for seed in (3, 4)
    ]
    assert (begun[0] != begun[1]).any()


def whole_road(part: Part, world: int) -> FloatArray:
    """The vehicles of a world by lane and place, counted one by one."""
    env = part.env
    s_m, y_m, speed_m_s, *_ = env.episodes.scene[world]
    desired_m_s = env.worlds.x[world, DESIRED_M_S]
    found = np.zeros((3, 9, 3), np.float32)
    for row in range(1, env.vehicles[world] + 1):
        away_m = (s_m[row] - s_m[0] + env.road.lap_m / 2) % env.road.lap_m - env.road.lap_m / 2
        place = sum(away_m >= end_m for end_m in (-100, 0, 40, 80, 130, 200, 300, 450))
        found[min(max(env.road.lane_of(y_m[row]), 0), 2), place] += (
            0.2,
            (speed_m_s[row] - 20.0) / 30.0,
            (desired_m_s[row] - 20.0) / 30.0,
        )
    return found.ravel()


def test_the_critic_sees_all_vehicles_also_where_an_episode_ends_and_another_begins() -> None:
    worlds, ended = TwinWorlds(LARGE.updated("traffic", vehicles_max=30), seed=2), 0
    last: dict[int, FloatArray] = {}
    for part in worlds.parts:
        begin_anew = part.begin_anew

        def note(over: BoolArray, part: Part = part, begin: Any = begin_anew) -> None:
            for world in np.flatnonzero(over).tolist():
                last[part.rows.start + world] = whole_road(part, world)
            begin(over)

        part.begin_anew = note  # type: ignore[method-assign]
    for _ in range(8):
        observed, _, dones, infos = worlds.step(np.full(8, KEEP))
        for part in worlds.parts:
            for world in range(part.env.num_envs):
                seen = observed[part.rows.start + world, TwinWorlds.SIZE : -2]
                np.testing.assert_allclose(seen, whole_road(part, world), atol=1e-4)
        for world in np.flatnonzero(dones).tolist():
            seen = infos[world]["terminal_observation"][TwinWorlds.SIZE : -2]
            np.testing.assert_allclose(seen, last[world], atol=1e-4)
            ended += 1
    assert ended >= 8


def test_on_an_open_road_the_critic_does_not_see_those_that_have_left() -> None:
    config = TO_THE_EXIT.updated("ppo", worlds=6, asymmetric_critic=True)
    worlds, gone = TwinWorlds(config.updated("traffic", presets=("calm",)), seed=3), 0
    [part] = worlds.parts
    for _ in range(6):
        observed, *_ = worlds.step(np.zeros(6, np.int64))
        for row in range(6):
            vehicles = observed[row, TwinWorlds.SIZE : -1 : 3].sum() / 0.2
            assert vehicles == pytest.approx(len(part.env.scene(row).snapshot.ids) - 1, abs=1e-3)
            gone += part.env.worlds.near[row, COUNT] > vehicles + 1.5
    assert gone > 0


def test_a_vehicle_is_seen_in_its_place_and_those_that_are_none_are_not() -> None:
    scene, x = np.zeros((2, 6, 7)), np.zeros((2, EXPECTED_M_S + 3, 7))
    # the ego of world 1 is at 990 m of a loop of 1000 m; the others are 20 and 21 m ahead of it in
    # the left lane, 20 m behind it in its own, 150 m behind it beyond the right one, and 460 m
    # ahead beyond the left one; the last column is no vehicle of this world
    scene[1, 0] = 990.0, 10.0, 11.0, 970.0, 840.0, 450.0, 20.0
    scene[1, 1] = 3.8, 7.6, 7.6, 3.8, -3.0, 11.4, 3.8
    scene[1, 2] = 25.0, 23.0, 26.0, 20.0, 17.0, 20.0, 35.0
    x[1, DESIRED_M_S] = 30.0, 26.0, 29.0, 20.0, 35.0, 32.0, 35.0
    road = road_numbers(replace(ROAD, lap_m=1000.0))
    seen = np.full((2, whole_road_size(3)), 9.0, np.float32)
    look_at_whole_road(scene, x, np.array([7, 6]), road, PLACES_M, np.array([1]), seen)
    assert (seen[0] == 9.0).all()
    expected = np.zeros((3, 9, 3))  # lane, place, (vehicles, speeds, desired speeds)
    expected[2, 2] = 0.4, 0.3, 0.5
    expected[1, 1] = 0.2, 0.0, 0.0
    expected[0, 0] = 0.2, -0.1, 0.5
    expected[2, 8] = 0.2, 0.0, 0.4
    np.testing.assert_allclose(seen[1].reshape(3, 9, 3), expected, atol=1e-6)


def test_only_the_critic_depends_on_what_no_driver_sees() -> None:
    config = LARGE.updated("ppo", batch_size=16, minibatch_size=8, decisions=16)
    worlds = TwinWorlds(config, 3)
    learner = learner_of(config, worlds)
    observed = worlds.reset()
    size = TwinWorlds.SIZE
    assert observed.shape == (8, size + whole_road_size(3) + 2)
    assert observed[:, -2:].tolist() == [[1.0, 0.0]] * 4 + [[0.0, 1.0]] * 4  # calm, overtaking
    other = observed.copy()
    other[:, size:] += 1.0
    with torch.no_grad():
        (_, values, chances), (_, their_values, theirs) = (
            learner.policy(torch.as_tensor(seen), deterministic=True) for seen in (observed, other)
        )
    assert torch.equal(chances, theirs)
    assert not torch.isclose(values, their_values).any()


@pytest.mark.parametrize("asymmetric", [True, False])
def test_a_training_of_one_update_learns_at_the_rate_that_is_set(asymmetric: bool) -> None:
    config = LARGE.updated("ppo", batch_size=16, minibatch_size=8, decisions=32)
    config = config.updated("ppo", asymmetric_critic=asymmetric)
    learner = learner_of(config, TwinWorlds(config, 3))
    first = learner.policy.action_net.weight.clone()
    learner.learn(16)
    assert learner.policy.optimizer.param_groups[0]["lr"] == config.ppo.learning_rate
    assert not torch.equal(first, learner.policy.action_net.weight)
    learner.learn(16, reset_num_timesteps=False)
    assert learner.policy.optimizer.param_groups[0]["lr"] == config.ppo.learning_rate / 2
