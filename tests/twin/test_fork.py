"""``fork(n)``: an episode, in SUMO or in the twin, goes on in n worlds of the twin."""

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest

from drl_av.config import Config
from drl_av.drivers.registry import load_driver
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError
from drl_av.safety.check import Rule, Verdict
from drl_av.twin.worlds import BRAKING, DRIVER_STATE

TWIN = Config().with_traffic("calm").updated("simulation", world="twin")


@pytest.fixture
def twin() -> Iterator[HighwayEnv]:
    with closing(HighwayEnv(config=TWIN, action_mask=True)) as env:
        yield env


def assert_same(there: Scene, here: Scene) -> None:
    """All vehicles are in the same places and drive alike, to the bit."""
    assert there.snapshot[:2] == here.snapshot[:2]  # the time and the names
    assert there.lane_change == here.lane_change
    for one, other in zip(there.snapshot.arrays, here.snapshot.arrays, strict=True):
        assert np.array_equal(one, other), here.snapshot.time_s


def amid_a_lane_change(env: HighwayEnv, seed: int = 1_000_003, vehicles: int = 20) -> None:
    """Drive until the ego is between two lanes, after 20 decisions at the earliest."""
    env.reset(seed=seed, options={"vehicles": vehicles})
    for decision in range(200):
        permitted = np.flatnonzero(env.action_masks())
        aside = permitted[permitted >= 4]
        env.step(int(aside[0] if len(aside) and decision > 20 else permitted[decision % 2 :][0]))
        if env.scene.lane_change is not None and decision > 20:
            return
    raise AssertionError("the ego never changed lanes")


def test_the_copies_of_a_world_go_on_as_it_does_if_they_may_know_its_future(
    twin: HighwayEnv,
) -> None:
    amid_a_lane_change(twin)
    copies = twin.fork(2, include_rng=True)
    for decision in range(60):
        for row in range(2):
            assert_same(copies.scene(row), twin.scene)
        masks = copies.action_masks()
        assert (masks == twin.action_masks()).all()
        action = int(np.flatnonzero(masks[0])[decision % masks[0].sum()])
        there = copies.step(np.full(2, action))
        observation, reward, *ends, info = twin.step(action)
        assert (there[0] == observation).all()
        assert there[1].tolist() == [reward] * 2
        assert [end.tolist() for end in there[2:4]] == [[end] * 2 for end in ends]
        assert there[4]["seed"].tolist() == [info["seed"]] * 2


@pytest.mark.parametrize("traffic", ["paper", "hazards"])
def test_the_copies_of_our_own_drivers_remember_what_the_originals_do(traffic: str) -> None:
    with closing(HighwayEnv(config=TWIN.with_traffic(traffic), safety_check="strict")) as twin:
        twin.reset(seed=1_000_008, options={"vehicles": 20})
        states, braking = twin.traffic_drivers.memory
        while not (braking if traffic == "hazards" else states).any():
            twin.step(0)
        copies = twin.fork(1, include_rng=True)
        assert copies.worlds.z[0, DRIVER_STATE, :21].tolist() == states.tolist()
        assert copies.worlds.z[0, BRAKING, :21].tolist() == braking.tolist()
        for _ in range(60):
            assert_same(copies.scene(0), twin.scene)
            twin.step(0)
            copies.step(np.zeros(1, np.int64))


def test_without_its_future_the_copies_draw_other_lane_changes_by_their_seeds(
    twin: HighwayEnv,
) -> None:
    amid_a_lane_change(twin)

    def driven(copies: TwinVectorEnv) -> np.ndarray[Any, Any]:
        seen = [copies.step(np.zeros(copies.num_envs, np.int64))[0] for _ in range(60)]
        return np.array(seen)

    four = driven(twin.fork(4))
    assert (four[:2] == four[:2, :1]).all()  # the same scene, before any request matters
    assert len(np.unique(four[-1], axis=0)) == 4
    assert np.array_equal(driven(twin.fork(2, seed=2)), four[:, 2:])
    known = driven(twin.fork(1, include_rng=True))
    assert not np.array_equal(known[:, 0], four[:, 0])
    assert twin.decisions > 20  # the original has not moved
    assert not twin.step(0)[2]


def test_a_copy_draws_as_many_lane_changes_as_sumo() -> None:
    # 0.01 a second, 30 vehicles, 180 decisions to come: 54 on average
    with closing(HighwayEnv(config=TWIN)) as env:
        env.reset(seed=5, options={"vehicles": 30})
        for _ in range(20):
            env.step(0)
        changes = env.fork(200).episodes
    chance = TWIN.traffic.random_lane_changes_per_s
    mean = changes.next_event[:, 1].mean()
    assert mean == pytest.approx(chance * 30 * 180, rel=0.05)
    first = changes.events[0, : changes.next_event[0, 1]]
    assert (np.diff(first[:, 0]) >= 0).all()
    assert first[:, 0].min() >= 20
    assert first[:, 0].max() < 200
    assert set(first[:, 1].tolist()) <= set(range(1, 31))
    assert set(first[:, 2].tolist()) == {-1, 1}


def test_a_copy_of_an_episode_in_sumo_begins_with_its_scene_and_goes_on_alike() -> None:
    with closing(HighwayEnv(safety_check="paper")) as env:
        amid_a_lane_change(env, seed=1_000_001, vehicles=4)
        copies = env.fork(1, include_rng=True)
        assert copies.observation_space.shape == (1, 27)
        for decision in range(25):
            here, there = env.scene, copies.scene(0)
            assert there.snapshot.time_s == here.snapshot.time_s
            assert there.lane_change == here.lane_change
            assert there.indicators.values[:27] == pytest.approx(
                here.indicators.values[:27], abs=1e-6
            ), decision
            action = int(np.flatnonzero(env.action_masks())[0])
            env.step(action)
            copies.step(np.array([action]))


def test_a_lane_change_that_was_requested_in_sumo_goes_on_in_the_copy() -> None:
    with closing(HighwayEnv(safety_check="paper")) as env:
        env.reset(seed=3, options={"vehicles": 12})
        asked = 0
        for _ in range(150):
            moves = np.flatnonzero(env.scene.snapshot.lateral_speed_m_s[1:]) + 1
            rows = [row for row in moves if row in env.simulation.requests]  # type: ignore[union-attr]
            if rows and asked < 5:
                asked += 1
                copies = env.fork(1, include_rng=True)
                env.step(0)
                copies.step(np.zeros(1, np.int64))
                there = copies.scene(0).snapshot.y_m[rows]
                assert there == pytest.approx(env.scene.snapshot.y_m[rows], abs=1e-6)
            else:
                env.step(0)
        assert asked == 5


OPEN = TWIN.updated("safety", check="strict")


def driven_for(env: HighwayEnv, decisions: int) -> None:
    """Drive with the permitted actions in turn."""
    for decision in range(decisions):
        permitted = np.flatnonzero(env.action_masks())
        env.step(int(permitted[decision % len(permitted)]))


@pytest.mark.parametrize("kind", ["merge", "ramp_to_ramp"])
def test_on_an_open_road_the_same_vehicles_enter_and_leave_in_the_copies(kind: str) -> None:
    with closing(HighwayEnv(kind, config=OPEN, action_mask=True)) as env:
        env.reset(seed=1_000_002)
        driven_for(env, 25)
        copies = env.fork(2, include_rng=True)
        before = set(env.scene.snapshot.ids)
        for decision in range(30):
            for row in range(2):
                assert_same(copies.scene(row), env.scene)
            permitted = np.flatnonzero(env.action_masks())
            action = int(permitted[decision % len(permitted)])
            *_, info = env.step(action)
            *_, infos = copies.step(np.full(2, action))
            assert infos["way"].tolist() == [info["way"]] * 2
        after = set(env.scene.snapshot.ids)
        assert before - after
        assert after - before


@pytest.mark.parametrize(("scenario", "vehicles"), [("straight", 60), ("circular_three_lane", 25)])
def test_a_copy_of_an_episode_in_sumo_that_has_just_begun_goes_on_exactly(
    scenario: str, vehicles: int
) -> None:
    config = OPEN.updated("simulation", world="sumo")
    with closing(HighwayEnv(scenario, config=config)) as env:
        for seed in (1_000_020, 1_000_021):
            env.reset(seed=seed, options={"vehicles": vehicles})
            copies = env.fork(1, include_rng=True)
            env.step(3)
            copies.step(np.array([3]))
            here, there = env.scene.snapshot, copies.scene(0).snapshot
            assert there.ids == here.ids
            assert there.speed_m_s == pytest.approx(here.speed_m_s, abs=1e-6)


@pytest.mark.parametrize("world", ["sumo", "twin"])
def test_the_info_of_a_copy_counts_the_episode_so_far(world: str) -> None:
    with closing(HighwayEnv(config=TWIN.updated("simulation", world=world))) as env:
        env.reset(seed=1_000_000, options={"vehicles": 20})
        for drive in (env.step, env.execute, env.step, env.execute, env.execute):
            drive(9)
        copies = env.fork(1, include_rng=True)
        infos, info = copies.step(np.array([9]))[4], env.step(9)[4]
    assert infos["safety_triggers"].tolist() == [info["safety_triggers"]] != [0]
    assert infos["mean_speed_m_s"][0] == pytest.approx(info["mean_speed_m_s"], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("Exit", {"config": {"simulation": {"world": "sumo"}}}),
        ("Exit", {"config": {"simulation": {"world": "twin"}}}),
        ("Highway", {"observation": "wide"}),
    ],
)
def test_the_copies_of_a_named_environment_observe_what_it_does(
    name: str, given: dict[str, Any]
) -> None:
    with closing(gymnasium.make(f"drl_av/{name}-v0", **given)) as env:
        env.reset(seed=1_000_004)
        copies = env.unwrapped.fork(2, include_rng=True)  # type: ignore[attr-defined]
        assert copies.single_observation_space == env.observation_space
        assert copies.observation_space.shape == (2, *env.observation_space.shape)
        observation = env.step(0)[0]
        found = copies.step(np.zeros(2, np.int64))[0]
        assert found == pytest.approx(np.stack([observation] * 2), abs=0.02)


def test_on_an_open_road_other_vehicles_enter_where_the_future_is_not_known() -> None:
    worlds = TwinVectorEnv(2, "exit", config=OPEN)
    worlds.reset(seed=1_000_000)
    for _ in range(10):
        worlds.step(np.zeros(2, np.int64))
    copies, again = worlds.fork(3, world=1), worlds.fork(2, 1, world=1)
    known = worlds.fork(1, include_rng=True, world=1)
    now = worlds.scene(1).snapshot
    entered = set(now.ids)
    for _ in range(20):
        for some in (worlds, copies, again, known):
            some.step(np.zeros(some.num_envs, np.int64))

    def newcomers(some: TwinVectorEnv, row: int) -> list[tuple[str, float]]:
        shot = some.scene(row).snapshot
        rows = [at for at, name in enumerate(shot.ids) if name not in entered]
        return [(shot.ids[at], float(shot.s_m[at])) for at in rows]

    first, second, third = (newcomers(copies, row) for row in range(3))
    assert min(map(len, (first, second, third))) > 10  # about one a second
    assert first != second
    assert [newcomers(again, row) for row in range(2)] == [second, third]
    assert newcomers(known, 0) == newcomers(worlds, 1) != first
    exact = copies.fork(1, include_rng=True, world=2)
    for _ in range(12):  # an exact copy of a copy meets the same vehicles
        assert_same(exact.scene(0), copies.scene(2))
        for some in (copies, exact):
            some.step(np.zeros(some.num_envs, np.int64))


def test_a_copy_from_an_open_road_in_sumo_foresees_nearly_all_speeds_a_second_ahead() -> None:
    config = OPEN.updated("simulation", world="sumo")
    errors = []
    with closing(HighwayEnv("exit", config=config, action_mask=True)) as env:
        for seed in range(1_000_000, 1_000_004):
            env.reset(seed=seed)
            for _ in range(6):
                driven_for(env, 4)
                copies = env.fork(1, include_rng=True)
                here, there = env.scene.snapshot, copies.scene(0).snapshot
                assert there.ids == here.ids
                assert there.y_m == pytest.approx(here.y_m, abs=1e-9)
                env.step(0)
                copies.step(np.zeros(1, np.int64))
                here, there = env.scene.snapshot, copies.scene(0).snapshot
                assert there.ids == here.ids
                errors.append(np.abs(here.speed_m_s - there.speed_m_s))
    missed_m_s = np.concatenate(errors)
    assert len(missed_m_s) > 1000
    assert (missed_m_s < 1e-6).mean() > 0.85
    assert missed_m_s.mean() < 0.03


def shapes(worlds: TwinVectorEnv) -> tuple[Any, Any]:
    return worlds.observation_space.shape, worlds.action_space.shape


def test_copies_of_copies_and_an_end_that_stays() -> None:
    worlds = TwinVectorEnv(3, safety_check="permit_all")
    worlds.reset(seed=1_000_000, options={"vehicles": 25})
    assert shapes(worlds) == ((3, 27), (3,))  # before the copies have spaces of their own
    five = worlds.fork(5, world=1)
    assert shapes(five) == ((5, 27), (5,))
    copies = five.fork(2, seed=9, world=4)
    assert [*map(shapes, (copies, worlds))] == [((2, 27), (2,)), ((3, 27), (3,))]
    assert copies.num_envs == 2
    assert copies.scene(0).snapshot.s_m.tolist() == worlds.scene(1).snapshot.s_m.tolist()
    for _ in range(60):  # full speed to the right until both have hit something
        observation, _, terminated, *_ = copies.step(np.array([9, 9]))
        if terminated.all():
            break
    assert terminated.all()
    again = copies.step(np.array([0, 0]))
    assert np.array_equal(again[0], observation)
    assert again[1].tolist() == [0.0, 0.0]
    assert again[2].tolist() == [True, True]
    with pytest.raises(gymnasium.error.ResetNeeded, match="no episode to fork"):
        copies.fork(1)


def test_a_driver_searches_among_copies(twin: HighwayEnv) -> None:
    # a rollout of each permitted action, with the paper's rule after it
    rule = load_driver("gap-mobil", TWIN)
    amid_a_lane_change(twin)
    permitted = np.flatnonzero(twin.action_masks())
    copies = twin.fork(len(permitted))
    total = copies.step(permitted)[1]
    for _ in range(5):
        proposed = [rule.act(copies.scene(row), np.empty(0)).number for row in range(len(total))]  # type: ignore[arg-type]
        total += copies.step(np.array(proposed))[1]
    assert len(set(total.tolist())) > 1


def test_what_cannot_be_copied_is_refused() -> None:
    with closing(HighwayEnv()) as env, pytest.raises(gymnasium.error.ResetNeeded):
        env.fork(2)
    permits = lambda scene, proposed: Verdict(proposed, Rule.NONE)  # noqa: E731
    with closing(HighwayEnv(safety_check=permits)) as env:
        env.reset(seed=1)
        with pytest.raises(ConfigError, match="no safety check of yours"):
            env.fork(2)
    with closing(HighwayEnv()) as env:
        env.reset(seed=1)
        env.hand_over(load_driver("sumo").model)  # type: ignore[attr-defined]
        with pytest.raises(ConfigError, match="drive the ego without SUMO"):
            env.fork(2)
    with closing(HighwayEnv(scenario="cut_in")) as env:
        env.reset(seed=1)
        with pytest.raises(ConfigError, match=r"A fork drives in the twin.* places exactly: fork"):
            env.fork(2)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((0,), "n is 0, but must be a whole number from 1 on"),
        ((2.5,), "n is 2.5"),
        ((2, -1), "seed is -1, but must be a whole number from 0 on"),
        ((2, None), "seed is None"),
        ((2, 0, False, 3), "world is 3, but must be a whole number from 0 to 2"),
        ((2, 0, False, -1), "world is -1"),
    ],
)
def test_a_number_of_copies_that_cannot_be_is_refused(given: Any, message: str) -> None:
    worlds = TwinVectorEnv(3)
    worlds.reset(seed=1)
    with pytest.raises(ConfigError, match=message):
        worlds.fork(*given)


def test_a_copy_whose_episode_is_over_names_the_same_vehicle_while_others_leave() -> None:
    config = Config().with_traffic("overtaking").updated("safety", check="permit_all")
    config = config.updated("simulation", world="twin", scenario="straight")
    env, actions = HighwayEnv(config=config), np.random.default_rng(6)
    struck = changed = 0
    for seed in range(2_000_000, 2_000_008):
        env.reset(seed=seed, options={"vehicles": 6})
        copies, first = env.fork(64), dict[int, str]()
        for decision in range(60):
            if decision % 4 == 0:
                chosen = actions.choice([1, 3, 2, 7, 11, 6, 10, 5, 9, 0], 64)
            _, _, terminated, _, info = copies.step(chosen)
            for row in np.flatnonzero(terminated).tolist():
                name = info["collided_with"][row]
                assert name == first.setdefault(row, name)
            changed += len(copies.kept)
        struck += len([name for name in first.values() if name])
    assert struck > 10
    assert changed > 400
