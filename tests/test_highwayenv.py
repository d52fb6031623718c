"""The checks in HighwayEnv: the wrapper of ``examples/check_in_highwayenv.py``."""

import runpy
from typing import Any

import gymnasium
import pytest
from shown import ROOT

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS
from drl_av.errors import ConfigError
from drl_av.safety import named_check
from drl_av.safety.check import SafetyCheck, Verdict, permit_all

EXAMPLE = runpy.run_path(str(ROOT / "examples" / "check_in_highwayenv.py"))
LEFT, _, RIGHT, FASTER, _ = range(5)


def alone(check: SafetyCheck) -> Any:
    """HighwayEnv under a check, with the ego alone in the rightmost of four lanes, at 25 m/s."""
    settings = EXAMPLE["SETTINGS"] | {"vehicles_count": 0, "initial_lane_id": 3}
    env = EXAMPLE["Checked"](gymnasium.make("highway-v0", config=settings), check)
    env.reset(seed=3)
    return env


def test_the_scene_is_that_of_highwayenv_with_left_positive() -> None:
    env = alone(permit_all)
    scene = env.scene()
    assert (scene.affordances.lane, scene.affordances.ego_speed_m_s) == (0, 25.0)
    assert (scene.affordances.right_lane, scene.affordances.left_lane) == (False, True)
    env.step(LEFT)
    changing = env.scene()
    assert changing.lane_change == (0, 1, 0.0)
    assert changing.affordances.ego_y_m > 2.0
    assert changing.affordances.ego_lateral_speed_m_s > 0.5
    for _ in range(2):
        env.step(LEFT)  # the first of them goes on with the same change, the second begins one
    assert env.unwrapped.vehicle.target_lane_index[2] == 1


def test_a_change_of_lane_and_of_speed_at_once_are_both_executed() -> None:
    env = alone(lambda scene, proposed: Verdict(ACTIONS[11], "left, and brake hard"))
    env.step(FASTER)
    vehicle = env.unwrapped.vehicle
    assert (vehicle.target_lane_index[2], vehicle.target_speed) == (2, 20.0)


def test_the_check_keeps_the_ego_on_the_road_and_lets_it_accelerate() -> None:
    env = alone(EXAMPLE["CHECKS"]["strict"])
    env.step(RIGHT)
    assert env.unwrapped.vehicle.target_lane_index[2] == 3
    env.step(FASTER)
    assert env.unwrapped.vehicle.target_speed == 30.0


def test_the_check_keeps_the_ego_off_the_vehicles_that_it_hits_without() -> None:
    (crashes, speed), (kept, slower) = (
        EXAMPLE["hits"](check, 1) for check in (permit_all, EXAMPLE["CHECKS"]["strict"])
    )
    assert (crashes, kept) == (1, 0)
    assert 10.0 < slower < speed


def test_the_argument_of_strict_does_not_hold_there() -> None:
    duration_s = EXAMPLE["CONFIG"].ego.lane_change_duration_s
    config = Config().updated("safety", check="strict")
    with pytest.raises(ConfigError, match=r"lane_change_duration_s .* the lemma abort fails"):
        named_check(config.updated("ego", lane_change_duration_s=duration_s))
