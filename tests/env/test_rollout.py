"""The rollout of an episode: its order, what it hands on, and how it ends."""

import itertools
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from decisions import decided
from worlds import scene

from drl_av.config import Config
from drl_av.drivers.rule_based import RandomDriver, SumoDriver
from drl_av.driving.actions import ACTIONS, Action
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive, rollout
from drl_av.env.transition import Transition
from drl_av.errors import ConfigError
from drl_av.simulation.vehicle_calls import EgoModel


class ScriptedEnv:
    """An environment whose scene, observation and reward are numbered by the decision."""

    check_name = "scripted"
    config = Config().updated("simulation", world="twin")

    def __init__(self, tape: list[str], decisions: int, *, terminated: bool = False) -> None:
        self._tape, self._decisions, self._terminated = tape, decisions, terminated

    def _show(self) -> None:
        self.scene = scene(speed_m_s=10.0 + self._done)
        self.observation = np.full(27, self._done, dtype=np.float32)

    def reset(self, *, seed: int, options: Any) -> tuple[None, dict[str, bool]]:
        self._done = 0
        self._tape.append(f"reset {seed} {options}")
        self._show()
        return None, {"unsafe_start": False}

    def execute(self, action: int) -> Transition:
        before, observation = self.scene, self.observation
        self._done += 1
        self._tape.append(f"step {action}")
        self._show()
        over = self._done == self._decisions
        return decided(
            *(before, self.scene, action),
            observation=observation,
            next_observation=self.observation,
            reward=-0.1 * self._done,
            terminated=over and self._terminated,
            truncated=over and not self._terminated,
        )


class CountingDriver:
    """Proposes action 0, then 1, then 2 ..."""

    def __init__(self, tape: list[str]) -> None:
        self._tape = tape

    def start(self, seed: int) -> None:
        self._tape.append(f"start {seed}")
        self._number = -1

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        assert scene.affordances.ego_speed_m_s == 10 + observation[0]
        self._number += 1
        self._tape.append(f"act on {observation[0]:g}")
        return ACTIONS[self._number]


def scripted(
    decisions: int, *, terminated: bool = False
) -> tuple[HighwayEnv, CountingDriver, list[str]]:
    tape: list[str] = []
    made: Any = ScriptedEnv(tape, decisions, terminated=terminated)
    return made, CountingDriver(tape), tape


def test_each_decision_is_yielded_before_the_driver_takes_the_next() -> None:
    env, driver, tape = scripted(3)
    for decision in rollout(env, driver, 5, 30):
        tape.append(f"learn {decision.proposed.number}")
    assert tape == [
        *("reset 5 {'vehicles': 30}", "start 5"),
        *("act on 0", "step 0", "learn 0"),
        *("act on 1", "step 1", "learn 1"),
        *("act on 2", "step 2", "learn 2"),
    ]


def test_without_a_number_of_vehicles_the_environment_draws_it() -> None:
    env, driver, tape = scripted(1)
    list(rollout(env, driver, 5))
    assert tape[0] == "reset 5 None"


def test_a_driver_that_returns_a_number_is_told_to_return_an_action() -> None:
    env, driver, _ = scripted(1)
    for wrong in (3, Action(2, 7)):  # type: ignore[arg-type]
        driver.act = lambda *_, wrong=wrong: wrong  # type: ignore[assignment, method-assign]
        with pytest.raises(ConfigError, match=r"act returned .*, but must return an Action"):
            list(rollout(env, driver, 5))


@pytest.mark.parametrize("terminated", [True, False])
def test_a_decision_holds_what_was_before_it_and_what_came_after(terminated: bool) -> None:
    env, driver, _ = scripted(3, terminated=terminated)
    decisions = list(rollout(env, driver, 5))
    assert [each.proposed.number for each in decisions] == [0, 1, 2]
    assert [each.observation[0] for each in decisions] == [0, 1, 2]
    assert [each.next_observation[0] for each in decisions] == [1, 2, 3]
    assert [each.scene.affordances.ego_speed_m_s for each in decisions] == [10, 11, 12]
    assert [each.next_scene.affordances.ego_speed_m_s for each in decisions] == [11, 12, 13]
    assert [each.reward for each in decisions] == pytest.approx([-0.1, -0.2, -0.3])
    assert [each.terminated for each in decisions] == [False, False, terminated]
    assert [each.truncated for each in decisions] == [False, False, not terminated]


def test_drive_sums_up_every_decision_of_the_episode() -> None:
    env, driver, _ = scripted(4)
    row = drive(env, driver, "counting", 5, 30)
    assert (row.driver, row.safety_check, row.vehicles, row.seed) == ("counting", "scripted", 30, 5)
    assert (row.decisions, row.mean_speed_m_s) == (4, (11 + 12 + 13 + 14) / 4)
    assert row.mean_reward == pytest.approx(-0.25)
    assert row.hard_brakes == 1  # action 3
    assert row.world == "twin"


def test_on_the_real_road_the_next_scene_is_the_scene_of_the_next_decision() -> None:
    with HighwayEnv(config=Config().updated("simulation", decisions_per_episode=8)) as env:
        decisions = list(rollout(env, RandomDriver(), 800_000, 12))
    assert [each.truncated for each in decisions] == [False] * 7 + [True]
    for before, after in itertools.pairwise(decisions):
        assert before.next_scene is after.scene
        assert before.next_observation is after.observation
    assert len(decisions[-1].next_scene.snapshot.ids) - 1 == 12


def test_an_ego_that_sumo_drives_proposes_what_it_did() -> None:
    config = Config().updated("simulation", decisions_per_episode=30)
    with closing(HighwayEnv(config=config)) as env:
        decisions = list(rollout(env, SumoDriver(EgoModel()), 800_002, 20))
    assert {each.proposed == each.executed for each in decisions} == {True}
    assert len({each.proposed for each in decisions}) > 1


def test_what_the_environment_refuses_is_raised_at_the_first_decision() -> None:
    env: Any = SimpleNamespace(reset=lambda **_: (_ for _ in ()).throw(ConfigError("no such road")))
    episode = rollout(env, RandomDriver(), 0, 1)
    with pytest.raises(ConfigError, match="no such road"):
        next(episode)
