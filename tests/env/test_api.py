"""The environment as gymnasium and stable-baselines3 see it."""

import warnings

import gymnasium
import numpy as np
import pytest
from drives import HARD_BRAKE, ID, start
from gymnasium.utils.env_checker import check_env
from programs import python

from drl_av.env.highway import HighwayEnv


def test_gymnasium_has_nothing_to_say() -> None:
    with gymnasium.make(ID) as made, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(made.unwrapped, skip_render_check=True)
    reported = [str(warning.message) for warning in caught]
    assert not reported


def test_stable_baselines3_has_nothing_to_say(env: HighwayEnv) -> None:
    # imported here: torch comes along, and workers that import this file do without it
    from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env_of_sb3(env, warn=True, skip_render_check=True)


def test_made_by_its_id_it_takes_the_arguments_of_the_class() -> None:
    with gymnasium.make(ID, scenario="barricaded_right_lane", safety_check="permit_all") as made:
        assert isinstance(made.unwrapped, HighwayEnv)
        assert made.unwrapped.config.safety.check == "permit_all"
        assert made.unwrapped.road.open_lanes == (False, True, True)


def test_observation_is_the_indicators_scaled(env: HighwayEnv) -> None:
    observation, info = env.reset(seed=1, options={"vehicles": 30})
    assert observation.dtype == np.float32
    assert observation.shape == info["indicators"].shape == (27,)
    assert np.array_equal(info["indicators"], env.scene.indicators.values[:27])
    assert info["indicators"][24] == info["speed_m_s"] == env.scene.snapshot.speed_m_s[0]
    assert observation[24] == pytest.approx((info["speed_m_s"] - 15) / 15, abs=1e-6)
    assert env.observation_space.contains(observation)


def test_info_of_a_step_tells_what_happened(env: HighwayEnv) -> None:
    start(env, 5, seed=3)
    _, reward, terminated, truncated, info = env.step(np.int64(1))
    assert (terminated, truncated) == (False, False)
    assert set(info) == {
        *("proposed_action", "executed_action", "rule", "rewards", "collision", "collided_with"),
        *("way", "speed_m_s", "indicators", "seed", "vehicles"),
        *("is_success", "mean_speed_m_s", "ego_hit", "safety_triggers"),
    }
    assert (info["proposed_action"], info["seed"], info["vehicles"]) == (1, 3, 5)
    assert set(info["rewards"]) == {"r_v", "r_y", "r_x"}
    assert reward == pytest.approx(sum(info["rewards"].values()) / 3)
    assert isinstance(reward, float)


def test_info_and_observation_of_a_step_are_not_overwritten_by_the_next(env: HighwayEnv) -> None:
    start(env, 20)
    observation, _, _, _, info = env.step(1)
    kept = observation.copy(), info["indicators"].copy()
    env.step(HARD_BRAKE)
    assert np.array_equal(observation, kept[0])
    assert np.array_equal(info["indicators"], kept[1])


def test_gymnasium_imports_the_package_that_an_id_names() -> None:
    program = (
        "import gymnasium, sys\nassert 'drl_av' not in sys.modules\n"
        "print(type(gymnasium.make('drl_av:drl_av/RampToRamp-v0').unwrapped).__name__)"
    )
    assert python("-c", program).stdout == "HighwayEnv\n"
