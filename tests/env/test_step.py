"""What a step does, and in which order."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from drives import BRAKE, LEFT, start

from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.driving.actions import ACTIONS, Action, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.env import highway
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.safety.check import Rule, Verdict
from drl_av.simulation import simulation


class TapedDriver:
    """Accelerates, and notes when it is asked."""

    def __init__(self, tape: list[str]) -> None:
        self._tape = tape

    def start(self, seed: int) -> None:
        self._tape.append("start")

    def act(self, scene: Scene, observation: npt.NDArray[np.float32]) -> Action:
        self._tape.append("propose")
        return ACTIONS[1]


def test_a_decision_goes_the_way_of_the_architecture_figure(
    env: HighwayEnv, monkeypatch: pytest.MonkeyPatch
) -> None:
    tape: list[str] = []

    def taped(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def play(*arguments: Any, **named: Any) -> Any:
            tape.append(name)
            return function(*arguments, **named)

        return play

    env.reset(seed=0)  # so that SUMO runs
    monkeypatch.setattr(env, "_values_of", taped("observe", env._values_of))
    monkeypatch.setattr(env, "safety_check", taped("check", env.safety_check))
    monkeypatch.setattr(highway, "plan_with", taped("plan", highway.plan_with))
    decide = taped("traffic drivers", TrafficDrivers.__call__)
    monkeypatch.setattr(TrafficDrivers, "__call__", decide)
    monkeypatch.setattr(env.simulation, "advance", taped("advance", env.simulation.advance))
    monkeypatch.setattr(simulation, "Snapshot", taped("snapshot", simulation.Snapshot))
    for _ in itertools.islice(rollout(env, TapedDriver(tape), 0, 5), 2):
        tape.append("learn")
    begin = ["snapshot", "observe", "start"]
    way = "propose, check, plan, traffic drivers, advance, snapshot, observe, learn"
    assert tape == begin + way.split(", ") * 2


def test_the_check_judges_the_scene_of_the_last_observation_and_is_obeyed() -> None:
    judged: list[Scene] = []

    def always_brake(scene: Scene, proposed: Any) -> Verdict:
        judged.append(scene)
        return Verdict(ACTIONS[BRAKE], Rule.IN_LANE)

    with HighwayEnv(safety_check=always_brake) as made:
        info = start(made, 3, seed=1)
        speeds = [info["speed_m_s"]]
        for _ in range(3):
            scene = made.scene
            _, _, _, _, info = made.step(1)
            assert judged[-1] is scene
            assert (info["executed_action"], info["rule"]) == (BRAKE, "in_lane")
            speeds.append(info["speed_m_s"])
        assert np.diff(speeds) == pytest.approx([-2, -2, -2], abs=1e-6)


def test_no_decision_is_harder_than_hard_brake_or_faster_than_the_limit(env: HighwayEnv) -> None:
    hardest = min(how.acceleration_m_s2(env.config.ego) for how in Longitudinal)
    start(env, 30, seed=6)
    before = start(env, 30, seed=6)["speed_m_s"]
    for _ in range(100):
        _, _, terminated, _, info = env.step(LEFT + 1)
        assert info["speed_m_s"] - before >= hardest - 1e-9
        assert info["speed_m_s"] <= env.config.ego.max_speed_m_s
        before = info["speed_m_s"]
        if terminated:
            break
