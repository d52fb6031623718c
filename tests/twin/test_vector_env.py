"""``gymnasium.make_vec``: many episodes at once, each as it would be alone."""

import copy
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numba
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import drl_av  # noqa: F401
from drl_av.config import Config
from drl_av.config.presets import PRESETS
from drl_av.config.traffic import SINGLE_PRESETS
from drl_av.env.highway import HighwayEnv
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError, ScenarioError
from drl_av.random_streams import kind_of_traffic
from drl_av.scenarios.folder import ScenarioDescription, write_scenario
from drl_av.scenarios.highways import ExitDescription


def first_permitted(info: dict[str, Any]) -> np.ndarray[Any, Any]:
    return np.argmax(info["action_mask"][:, [1, 0, 2, 3]], axis=1).take(range(len(info["seed"])))


def driven(env: TwinVectorEnv, seed: Any, decisions: int = 30) -> np.ndarray[Any, Any]:
    observation, info = env.reset(seed=seed, options={"vehicles": 12})
    seen = [observation]
    for _ in range(decisions):
        observation, *_, info = env.step(np.array([1, 0, 2, 3])[first_permitted(info)])
        seen.append(observation)
    return np.array(seen)


def test_make_vec_makes_the_worlds_of_the_twin() -> None:
    env = gymnasium.make_vec(
        "drl_av/Highway-v0", num_envs=3, vectorization_mode="vector_entry_point"
    )
    assert isinstance(env.unwrapped, TwinVectorEnv)
    observation, info = env.reset(seed=7)
    assert env.observation_space.contains(observation)
    assert observation.shape == (3, 27)
    assert info["action_mask"].shape == (3, 12)
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    env.close()


@pytest.mark.parametrize("mode", [*AutoresetMode])
def test_what_was_returned_never_changes_afterwards(mode: AutoresetMode) -> None:
    env = TwinVectorEnv(64, safety_check="permit_all", autoreset_mode=mode)
    env.reset(seed=2_000_000, options={"vehicles": 20})
    rng, returned, kept, struck = np.random.default_rng(1), [], [], 0
    for _ in range(30):
        found = env.step(rng.integers(12, size=64))
        returned.append(found)
        kept.append(copy.deepcopy(found))
        struck += int((found[-1]["collided_with"] != "").sum())
        if mode == AutoresetMode.DISABLED and (over := found[2] | found[3]).any():
            env.reset(options={"reset_mask": over, "vehicles": 20})
    assert struck > 20 or mode == AutoresetMode.SAME_STEP  # there the names are in final_info
    for before, after in zip(kept, returned, strict=True):
        assert data_equivalence(before, after)


def test_each_world_is_the_episode_of_its_seed_and_threads_change_nothing() -> None:
    together = driven(TwinVectorEnv(4, threads=1), 2_000_000)
    divided = TwinVectorEnv(4, threads=2)
    assert np.array_equal(driven(divided, 2_000_000), together)
    divided.close()
    alone = driven(TwinVectorEnv(1), [2_000_002])
    assert np.array_equal(alone[:, 0], together[:, 2])
    assert not np.array_equal(together[:, 1], together[:, 2])


def test_an_episode_that_is_over_begins_again_at_the_next_step() -> None:
    env = TwinVectorEnv(2, config=Config().updated("simulation", decisions_per_episode=2))
    _, first = env.reset(seed=[2_000_000, 2_000_001])
    env.step(np.zeros(2, np.int64))
    _, _, _, truncated, last = env.step(np.zeros(2, np.int64))
    assert truncated.tolist() == [True, True]
    assert last["seed"].tolist() == first["seed"].tolist()
    _, reward, _, truncated, begun = env.step(np.zeros(2, np.int64))
    assert reward.tolist() == [0.0, 0.0]
    assert truncated.tolist() == [False, False]
    assert (begun["seed"] != first["seed"]).all()
    assert not begun["_collision"].any()


def assert_same_info(ours: dict[str, Any], its: dict[str, Any], present: Any) -> None:
    """Compare two ``info`` of vector environments, in the worlds in which they are ``present``."""
    has = {name for name, mask in ours.items() if name.startswith("_") and mask.any()}
    assert has == {name for name, mask in its.items() if name.startswith("_") and mask.any()}
    for name in has:
        assert np.array_equal(ours[name], its[name]), name
        values, others, mask = ours[name[1:]], its[name[1:]], its[name] & present
        if isinstance(others, dict):
            assert_same_info(values, others, mask)
            continue
        for row in np.flatnonzero(mask):
            assert np.array_equal(values[row], others[row]), (name, row)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_the_results_are_those_of_gymnasiums_own_vector_environment(mode: AutoresetMode) -> None:
    config = Config().updated("simulation", world="twin", decisions_per_episode=3)
    config = config.updated("safety", check="strict").updated("traffic", vehicles_min=25)
    config = config.updated("strict", follower_braking_m_s2=2.0)  # some starts are unsafe
    makers = [lambda: HighwayEnv(config=config, action_mask=True)] * 3
    its = gymnasium.vector.SyncVectorEnv(makers, autoreset_mode=mode)
    ours = TwinVectorEnv(3, config=config, autoreset_mode=mode)
    given: dict[str, Any] = {"seed": 2_000_000, "options": {"vehicles": 10}}
    (seen, info), (expected, its_info) = ours.reset(**given), its.reset(**given)
    assert np.array_equal(seen, expected)
    assert_same_info(info, its_info, np.ones(3, np.bool_))
    numbers, unsafe = [info["vehicles"].tolist()], []
    for decision in range(9):
        if decision == 1:  # the first world begins anew at another time than the others
            mask = np.array([True, False, False])
            ours.reset(options={"reset_mask": mask, "vehicles": 2})
            its.envs[0].reset(options={"vehicles": 2})
        actions = np.array([1, 0, 2]) if decision != 1 else np.array([0, 0, 2])
        *found, info = ours.step(actions)
        *expected, its_info = its.step(actions)
        for one, other in zip(found, expected, strict=True):
            assert np.array_equal(one, other)
        assert_same_info(info, its_info, np.ones(3, np.bool_))
        numbers.append(info["vehicles"].tolist())
        if "unsafe_start" in info:
            unsafe += info["unsafe_start"][info["_unsafe_start"]].tolist()
    assert {*unsafe} == {True, False}
    assert numbers[0] == [10, 10, 10]
    assert numbers[2] == [2, 10, 10]
    assert 10 not in numbers[-1]  # drawn, as the option was of one reset


def test_a_refused_reset_changes_nothing() -> None:
    env, alone = (TwinVectorEnv(2) for _ in range(2))
    for each in (env, alone):
        each.reset(seed=2_000_000, options={"vehicles": 10})
    with pytest.raises(ScenarioError, match="room for 113"):
        env.reset(seed=3_000_000, options={"vehicles": 500})
    found, expected = env.step(np.ones(2, np.int64)), alone.step(np.ones(2, np.int64))
    assert np.array_equal(found[0], expected[0])
    assert found[4]["seed"].tolist() == [2_000_000, 2_000_001]
    assert found[4]["vehicles"].tolist() == [10, 10]


def test_more_vehicles_than_have_room_are_refused_at_the_first_reset(tmp_path: Path) -> None:
    write_scenario(tmp_path / "short", ScenarioDescription(circumference_m=100.0))
    env = TwinVectorEnv(2, scenario=tmp_path / "short")
    with pytest.raises(ConfigError, match=r"vehicles_max is 30, but this road takes \d+ vehicles"):
        env.reset(seed=0)
    env.reset(seed=0, options={"vehicles": 2})


def test_an_episode_on_a_long_way_to_the_exit_is_as_long_as_in_the_environment(
    tmp_path: Path,
) -> None:
    write_scenario(tmp_path / "long", ExitDescription(approach_m=4500.0, flow_per_h=300))
    twin = {"simulation": {"world": "twin"}}
    alone = gymnasium.make("drl_av/Highway-v0", scenario=tmp_path / "long", config=twin)
    assert alone.spec.max_episode_steps == 307
    env = TwinVectorEnv(1, scenario=tmp_path / "long")
    env.reset(seed=2_000_000)
    alone.reset(seed=2_000_000)
    decisions, over = 0, False
    while not over:  # it brakes to 20 m/s, and needs more than 200 decisions
        decisions += 1
        action = 2 if decisions <= 5 else 0
        _, _, terminated, over, info = alone.step(action)
        found = env.step(np.array([action]))
        assert (found[2][0], found[3][0], found[4]["way"][0]) == (terminated, over, info["way"])
    assert 200 < decisions < 307


def test_make_vec_takes_the_specification_of_an_environment() -> None:
    made = gymnasium.make("drl_av/Highway-v0", max_episode_steps=2)
    env = gymnasium.make_vec(made.spec, num_envs=2)
    env.reset(seed=0)
    assert env.np_random_seed == (0, 1)
    assert not env.step(np.zeros(2, np.int64))[3].any()
    assert env.step(np.zeros(2, np.int64))[3].all()
    shorter = {"simulation": {"decisions_per_episode": 1}}
    env = gymnasium.make_vec(made.spec, num_envs=2, config=shorter)
    env.reset(seed=0)
    assert env.step(np.zeros(2, np.int64))[3].all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"render_mode": "rgb_array"}, "leave render_mode and sumo_options out, .*'sync'"),
        ({"sumo_options": "--fcd-output fcd.xml"}, "leave render_mode and sumo_options out"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"autoreset_mode": "Same"}, "but must be one of: NextStep, SameStep, Disabled"),
        ({"scenario": "barricade"}, "places exactly: drive in SUMO .*gymnasium.make"),
        ({"safety_check": 3}, "safety_check is 3, but the twin has the named checks only"),
        ({"scenario": {"lanes": 2}}, "scenario is of the type dict"),
        ({"config": {"simulation": {"lateral_resolution_m": 1.9}}}, r"\(set it to 3.8\): drive"),
        ({"config": {"simulation": {"step_length_s": 0.25}}}, "step_length_s"),
        ({"observation": 7}, "must be wide, names of groups"),
        ({"reward": 7}, "must be a function"),
        ({"safety_check": lambda scene, proposed: None}, "named checks"),
        ({"threads": 0}, "threads is 0, but must be a whole number from 1 on"),
        ({"num_envs": 0}, "num_envs is 0"),
    ],
)
def test_an_argument_that_the_twin_cannot_take_is_refused(given: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        TwinVectorEnv(**({"num_envs": 2} | given))


def test_the_strips_that_a_refusal_asks_for_are_as_wide_as_the_lanes(tmp_path: Path) -> None:
    write_scenario(tmp_path / "fine", ScenarioDescription(lane_width_m=3.1415926))
    with pytest.raises(ConfigError, match=r"set it to 3\.1415926\)"):
        TwinVectorEnv(1, tmp_path / "fine")


def test_a_scenario_of_the_settings_is_as_if_it_were_named() -> None:
    env = TwinVectorEnv(1, config={"simulation": {"scenario": "merge"}})
    assert env.config == TwinVectorEnv(1, "merge").config
    assert env.config.traffic.finite_state_share == 0.0
    env.reset(seed=3)
    env.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(1, np.int64))
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.action_masks()


def test_its_world_is_the_twin_and_sumo_is_refused() -> None:
    assert TwinVectorEnv(1).config.simulation.world == "twin"
    with pytest.raises(ConfigError, match="world is sumo: leave it out, or add vectorization_m"):
        TwinVectorEnv(1, config={"simulation": {"world": "sumo"}})


def test_a_reset_names_the_options_that_it_has() -> None:
    with pytest.raises(ConfigError, match=r"no option 'resetmask'.*: vehicles, reset_mask"):
        TwinVectorEnv(2).reset(options={"resetmask": [True, False]})


@pytest.mark.parametrize("threads", [1, 2])
def test_a_copy_of_the_worlds_goes_on_as_they_do(threads: int) -> None:
    env = TwinVectorEnv(4, threads=threads)
    env.reset(seed=2_000_000)
    for made in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        assert made._chunks == env._chunks
        its = made.step(np.ones(4, np.int64))[0]
        assert np.array_equal(its, copy.deepcopy(env).step(np.ones(4, np.int64))[0])
        made.close()


def test_without_autoreset_a_mask_chooses_the_worlds_to_reset() -> None:
    config = Config().updated("simulation", decisions_per_episode=1)
    env = TwinVectorEnv(2, config=config, autoreset_mode=AutoresetMode.DISABLED)
    _, info = env.reset(seed=3)
    env.step(np.zeros(2, np.int64))
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset_mask"):
        env.step(np.zeros(2, np.int64))
    _, again = env.reset(options={"reset_mask": np.array([False, True])})
    assert again["seed"][0] == info["seed"][0]
    assert again["seed"][1] != info["seed"][1]


def test_a_reset_says_of_the_worlds_that_it_begins_which_starts_are_unsafe() -> None:
    strict = Config().updated("safety", check="strict").updated("simulation", world="twin")
    careful = strict.updated("strict", follower_braking_m_s2=2.0)
    for config, some in ((Config(), False), (strict, False), (careful, True)):
        env = TwinVectorEnv(8, config=config)
        _, info = env.reset(seed=2_000_000, options={"vehicles": 30})
        alone = HighwayEnv(config=config.updated("simulation", world="twin"))
        for seed, unsafe in enumerate(info["unsafe_start"].tolist(), start=2_000_000):
            assert alone.reset(seed=seed, options={"vehicles": 30})[1]["unsafe_start"] is unsafe
        assert info["_unsafe_start"].all()
        assert info["unsafe_start"].any() == some
        assert "unsafe_start" not in env.step(np.zeros(8, np.int64))[4]
        second = np.arange(8) == 1
        _, info = env.reset(seed=2_000_000, options={"reset_mask": second, "vehicles": 30})
        assert info["_unsafe_start"].tolist() == second.tolist()


def test_a_scene_of_the_twin_is_a_scene_for_any_driver() -> None:
    env = TwinVectorEnv(2)
    _, info = env.reset(seed=5, options={"vehicles": 9})
    scene = env.scene(1)
    assert len(scene.snapshot.ids) == 10
    assert scene.indicators.values[:27] == pytest.approx(info["indicators"][1])


OTHER_SHAPES = (
    *([0], [[0, 0]], [[0], [1, 2]], [True], "abc", 5),
    *(np.ones(5, bool), np.ones((3, 2), bool)),
)


@pytest.mark.parametrize("given", [[0, 12], [0, -1], [0.0, 1.0], [1, 0, 2], *OTHER_SHAPES], ids=str)
def test_wrong_actions_and_masks_of_other_worlds_are_refused(given: Any) -> None:
    env = TwinVectorEnv(2)
    env.reset(seed=1)
    with pytest.raises(ConfigError, match="2 whole numbers from 0 to 11"):
        env.step(given)
    with pytest.raises(ConfigError, match="reset_mask must be an array of 2 times True or False"):
        env.reset(options={"reset_mask": given})


def test_each_episode_draws_one_of_the_kinds_of_traffic_and_is_as_in_that_kind_alone() -> None:
    mixed = Config().with_traffic("all")
    env, seeds = TwinVectorEnv(8, config=mixed), range(2_000_000, 2_000_008)
    together = driven(env, list(seeds))
    kinds = [kind_of_traffic(seed, range(len(SINGLE_PRESETS))) for seed in seeds]
    assert len(set(kinds)) >= 4
    for world, (seed, kind) in enumerate(zip(seeds, kinds, strict=True)):
        alone = TwinVectorEnv(1, config=Config().with_traffic(SINGLE_PRESETS[kind]))
        assert np.array_equal(driven(alone, [seed])[:, 0], together[:, world]), SINGLE_PRESETS[kind]


def test_the_first_reset_begins_all_worlds() -> None:
    with pytest.raises(ConfigError, match="first reset begins all worlds"):
        TwinVectorEnv(2).reset(options={"reset_mask": np.array([True, False])})


@pytest.mark.parametrize(
    "seed", ["a", 1.5, [1, "b"], {1: 2, 3: 4}, 2**63 - 1, [1, 2, 3], np.array(5)], ids=str
)
def test_a_seed_that_is_no_number_is_refused(seed: Any) -> None:
    with pytest.raises(ConfigError, match=r"a whole number or one for each of .* below 2\^63"):
        TwinVectorEnv(2).reset(seed=seed)


def test_the_arrays_of_all_settings_have_the_same_types() -> None:
    # ``Compiled.fast`` does not look at types again, so one strided array would be read wrongly.
    loops = [PRESETS["paper"].with_traffic(kind) for kind in ("calm", "paper", "hazards")]
    ramps = [PRESETS[f"large-{road}"] for road in ("merge", "exit", "ramp_to_ramp")]
    found = set()
    for config in (*loops, PRESETS["large"], *ramps):
        worlds = TwinVectorEnv(3, config=config)
        worlds.reset(seed=0)
        worlds.make_room(200, 300)
        for each in (worlds, worlds.fork(2)):
            found.add(tuple(map(numba.typeof, (each.worlds, each.episodes, each.task))))
    assert len(found) == 1
