"""A reward function of the user's own, and the length of an episode in the spec."""

import math
import re
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from drives import HARD_BRAKE, ID, KEEP, LEFT, Place, start, until_over

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS
from drl_av.env.highway import HighwayEnv
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError
from drl_av.safety.check import Rule
from drl_av.scenarios.folder import PlacedVehicle


def test_a_reward_function_is_given_the_decision_and_its_outcome() -> None:
    seen: list[Transition] = []

    def record(transition: Transition) -> float:
        seen.append(transition)
        return 7

    env, plain = HighwayEnv(reward=record), HighwayEnv()
    for one in (env, plain):
        start(one, 10, seed=3)
    before, observed = env.scene, env.observation.copy()
    env.observation[:] = 9.0  # as an agent does that normalizes it in place
    _, reward, _, _, info = env.step(LEFT)
    _, usual, _, _, same = plain.step(LEFT)
    assert (reward, type(reward)) == (7.0, float)
    [transition] = seen
    assert transition.scene is before
    assert transition.observation.tolist() == observed.tolist()
    assert transition.next_scene is env.scene
    assert transition.proposed == ACTIONS[LEFT]
    assert transition.executed == ACTIONS[info["executed_action"]]
    assert str(transition.rule) == info["rule"]
    assert transition.collision is None
    assert transition.terms._asdict() == info["rewards"] == same["rewards"]
    assert transition.reward == usual
    env.close()
    plain.close()


def test_it_receives_the_replaced_action_and_the_collision(place: Place) -> None:
    seen: list[Transition] = []

    def record(transition: Transition) -> float:
        seen.append(transition)
        return transition.reward

    wall = PlacedVehicle("ego", 1, 50.0, 25.0, 30.0), PlacedVehicle("wall", 1, 80.0, 0.0, 0.1)
    unchecked = place(*wall, reward=record)
    start(unchecked, 1)
    until_over(unchecked, KEEP)
    assert seen[-1].collision is not None
    assert seen[-1].reward == Config().reward.collision_reward
    env = place(*wall, reward=record, safety_check="paper")
    start(env, 1)
    env.step(KEEP)
    assert (seen[-1].proposed, seen[-1].executed) == (ACTIONS[KEEP], ACTIONS[HARD_BRAKE])
    assert seen[-1].rule is Rule.IN_LANE


@pytest.mark.parametrize("wrong", [math.nan, math.inf, None, "1", 1j, 1e30])
def test_what_is_no_reward_or_none_of_single_precision_is_refused(wrong: Any) -> None:
    with HighwayEnv(reward=lambda transition: wrong) as env:
        start(env, 1)
        told = re.escape(f"returned {wrong!r}, but must return a finite number between")
        with pytest.raises(ConfigError, match=told):
            env.step(KEEP)


@pytest.mark.parametrize("decisions", [4, 250])
def test_the_spec_has_the_length_of_an_episode_and_nothing_truncates_earlier(
    decisions: int,
) -> None:
    config = Config().updated("simulation", decisions_per_episode=decisions)
    made = gymnasium.make(ID, config=config)
    assert made.spec.max_episode_steps == decisions
    for env in (made, gymnasium.make(made.spec)):
        env.reset(seed=1, options={"vehicles": 0})
        ends = [env.step(KEEP)[2:4] for _ in range(decisions)]
        assert ends == [(False, False)] * (decisions - 1) + [(False, True)]
        env.close()


def test_gymnasium_s_own_argument_cuts_an_episode_short() -> None:
    with gymnasium.make(ID, max_episode_steps=2) as made:
        assert made.spec.max_episode_steps == 2
        made.reset(seed=1, options={"vehicles": 0})
        assert [made.step(KEEP)[3] for _ in range(2)] == [False, True]


def test_a_word_that_names_no_function_runs_no_file(here: Path) -> None:
    (here / "comfort.py").write_text("raise SystemExit('ran')")
    for word in ("comfort", "comfort:", "./comfort.py"):
        with pytest.raises(ConfigError, match="is not the name of a function: write module:"):
            HighwayEnv(reward=word)
