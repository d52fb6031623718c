"""Rewards and observations of the user in many worlds: as in one environment, world by world."""

from contextlib import closing
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import drl_av  # noqa: F401
from drl_av.config.presets import as_config
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.transition import Transition
from drl_av.env.vector import TwinVectorEnv
from drl_av.errors import ConfigError

DECISIONS = 25


class Speeds:
    """The ego's speed, and how many vehicles there are."""

    space = gymnasium.spaces.Dict(
        {
            "speed_m_s": gymnasium.spaces.Box(0.0, 50.0, (1,), np.float32),
            "vehicles": gymnasium.spaces.Discrete(100),
        }
    )

    def __call__(self, scene: Scene) -> dict[str, Any]:
        speed = scene.snapshot.speed_m_s[:1].astype(np.float32)
        return {"speed_m_s": speed, "vehicles": len(scene.snapshot.ids)}


def words(value: Any) -> Any:
    """Whatever is in a transition, in a form that can be compared."""
    if isinstance(value, Scene):
        of = value.snapshot, value.lane_change, value.indicators.values, value.indicators.codes
        return words(of)
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {name: words(one) for name, one in value.items()}
    return tuple(words(one) for one in value) if isinstance(value, tuple) else value


@pytest.mark.parametrize(
    ("scenario", "traffic", "observation"),
    [
        ("circular_three_lane", "paper", None),
        ("circular_three_lane", "hazards", Speeds()),
        ("exit", "calm", "wide"),
    ],
)
def test_the_reward_of_each_world_is_paid_for_the_transition_of_its_episode(
    scenario: str, traffic: str, observation: Any
) -> None:
    config = {"traffic": {"kind": traffic}, "simulation": {"world": "twin"}}
    made: list[Transition] = []

    def reward(transition: Transition) -> float:
        made.append(transition)
        return 10.0 * len(made) + transition.reward

    own = {"observation": observation, "reward": reward}
    given = scenario, "permit_all", config
    many = TwinVectorEnv(3, *given, **own, autoreset_mode="Disabled")
    actions, over = np.random.default_rng(5).integers(12, size=(25, 3)).tolist(), False
    many.reset(seed=2_000_000, options={"vehicles": 25})
    while not over:
        action, so_far = actions[len(made) // 3], len(made)
        _, rewards, terminated, truncated, _ = many.step(np.array(action))
        news = made[so_far:]
        assert rewards.tolist() == [
            10.0 * (so_far + number) + one.reward for number, one in enumerate(news, start=1)
        ]
        over = len(made) == 3 * len(actions) or bool((terminated | truncated).any())
    together = [made[row::3] for row in range(3)]
    assert any(one.collision for one in made)
    for row, its in enumerate(together):
        made.clear()
        with closing(HighwayEnv(*given, **own)) as env:
            env.reset(seed=2_000_000 + row, options={"vehicles": 25})
            for action in actions[: len(its)]:
                env.step(action[row])
        assert [words(tuple(one)) for one in made] == [words(tuple(one)) for one in its]


def test_observations_of_any_space_are_batched_as_gymnasium_does() -> None:
    config = as_config({"simulation": {"decisions_per_episode": 2}})
    env = TwinVectorEnv(
        2, config=config, observation=Speeds(), autoreset_mode=AutoresetMode.SAME_STEP
    )
    observed, _ = env.reset(seed=[2_000_000, 2_000_001], options={"vehicles": 7})
    assert env.observation_space.contains(observed)
    assert observed["vehicles"].tolist() == [8, 8]
    env.step(np.zeros(2, np.int64))
    observed, *_, info = env.step(np.zeros(2, np.int64))
    assert env.observation_space.contains(observed)
    assert [Speeds.space.contains(last) for last in info["final_obs"]] == [True, True]
    assert info["final_obs"][1]["speed_m_s"] == info["final_info"]["speed_m_s"][1].astype(
        np.float32
    )


def test_make_vec_takes_the_names_of_functions() -> None:
    made = {"reward": "examples.own_reward:comfort", "observation": "wide"}
    env = gymnasium.make_vec(
        "drl_av/Highway-v0", num_envs=2, vectorization_mode="vector_entry_point", **made
    )
    observed, _ = env.reset(seed=3)
    assert observed.shape == (2, 132)
    *_, info = (_, rewards, *_, _) = env.step(np.array([3, 8]))
    terms = sum(info["rewards"][name] for name in ("r_v", "r_y", "r_x")) / 3
    # the price of a hard brake, and of a lane change that begins
    assert (terms - rewards).tolist() == pytest.approx([0.5, 0.2])


def test_a_reward_that_is_no_number_is_refused() -> None:
    env = TwinVectorEnv(2, reward=lambda made: float("nan"))
    env.reset(seed=1)
    with pytest.raises(ConfigError, match="returned nan, but must return a finite number"):
        env.step(np.zeros(2, np.int64))


def test_the_copies_of_a_fork_observe_and_pay_as_the_episode_does() -> None:
    def speed(transition: Transition) -> float:
        return float(transition.next_observation["speed_m_s"][0])

    with closing(HighwayEnv(observation=Speeds(), reward=speed)) as env:
        env.reset(seed=1, options={"vehicles": 10})
        copies = env.fork(3)
        observed, rewards, *_ = copies.step(np.array([0, 1, 2]))
        assert rewards.tolist() == observed["speed_m_s"][:, 0].tolist()
        assert rewards[2] < rewards[0] < rewards[1]


class Noisy:
    """An observation that is another one each time it is called."""

    space = gymnasium.spaces.Box(-np.inf, np.inf, (1,), np.float32)

    def __init__(self) -> None:
        self.rng = np.random.default_rng(0)

    def __call__(self, scene: object) -> Any:
        return self.rng.normal(size=1).astype(np.float32)


KEEP = np.zeros(1, np.int64)


def test_the_reward_sees_the_observation_that_the_agent_saw() -> None:
    seen: list[tuple[Any, Any]] = []

    def reward(made: Any) -> float:
        seen.append((made.observation, made.next_observation))
        return 0.0

    env, got = TwinVectorEnv(observation=Noisy(), reward=reward), []
    for decision in range(4):
        observed, *_ = env.step(KEEP) if decision else env.reset(seed=1, options={"vehicles": 2})
        got.append(observed.item())
        observed[:] = 9.0  # as an agent does that normalizes it in place
    assert seen == [*pairwise(got)]
    ended = env.fork(1).step(KEEP)[0][0, 0]  # a copy looks anew at its first scene
    assert seen[3][1] == ended
    assert seen[3][0] not in got


def test_after_an_error_in_a_reward_a_reset_comes_first() -> None:
    """The worlds have made the decision, but step has returned no observation and no reward."""
    calls: list[int] = []

    def reward(made: object) -> float:
        calls.append(1)
        if len(calls) == 2:
            raise ZeroDivisionError
        return 0.0

    env = TwinVectorEnv(reward=reward)
    env.reset(seed=1, options={"vehicles": 2})
    env.step(KEEP)
    with pytest.raises(ZeroDivisionError):
        env.step(KEEP)
    for goes_on in (env.step, lambda _: env.fork(1)):
        with pytest.raises(gymnasium.error.ResetNeeded):
            goes_on(KEEP)
    env.reset(seed=1, options={"vehicles": 2})
    env.step(KEEP)


def test_a_limit_of_the_user_cuts_an_episode_short_and_ends_no_way() -> None:
    given: Any = {"max_episode_steps": 3, "reward": lambda made: made.truncated}
    env = TwinVectorEnv(scenario="exit", **given)
    alone = gymnasium.make("drl_av/Exit-v0", **given)
    for each in (env, alone):
        each.reset(seed=1, options={"vehicles": 2})
    for decision in (1, 2, 3):
        _, paid, _, truncated, info = env.step(KEEP)
        _, alone_paid, _, alone_truncated, alone_info = alone.step(0)
        assert bool(truncated[0]) == alone_truncated == (decision == 3)
        assert paid[0] == alone_paid == 0.0
        assert (info["way"][0], bool(info["is_success"][0])) == ("", False)
        assert (alone_info["way"], alone_info["is_success"]) == ("", False)
    alone.close()
