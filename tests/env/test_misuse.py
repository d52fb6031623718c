"""Mistakes of gymnasium users are refused in one sentence; what is allowed works."""

import copy
import pickle
import shutil
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import libsumo
import numpy as np
import pytest

import drl_av
from drl_av.config import Config
from drl_av.drivers.registry import find_drivers
from drl_av.drivers.rule_based import IdmDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.errors import ConfigError, DrlAvError, DrlAvWarning, ScenarioError, SimulationError
from drl_av.safety.check import permit_all
from drl_av.scenarios.folder import (
    ScenarioDescription,
    find_scenario,
    with_scenario,
    write_scenario,
)

SHORT = Config().updated("simulation", decisions_per_episode=3)


def test_step_and_render_before_reset_after_the_end_and_after_close_ask_for_a_reset() -> None:
    with HighwayEnv(config=SHORT, render_mode="rgb_array") as env:
        for misuse in (lambda: env.step(0), env.render):
            with pytest.raises(gymnasium.error.ResetNeeded):
                misuse()
        env.reset(seed=1, options={"vehicles": 2})
        for _ in range(3):
            *_, truncated, _ = env.step(0)
        assert truncated
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(0)
        env.reset(seed=1)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)


@pytest.mark.parametrize("action", [-1, 12, 1.0, "left", None, np.array([[3], [4]])])
def test_a_decision_that_is_none_is_refused(action: object) -> None:
    env = HighwayEnv(config=SHORT)
    env.reset(seed=1, options={"vehicles": 2})
    with pytest.raises(ConfigError, match="must be one whole number from 0 to 11") as refused:
        env.step(action)  # type: ignore[arg-type]
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("options", [["vehicles"], 5, "vehicles", []])
def test_options_that_are_no_dictionary_are_refused(options: object) -> None:
    env = HighwayEnv(config=SHORT)
    with pytest.raises(ConfigError, match=r"has the options .*, but they must be a dictionary"):
        env.reset(seed=1, options=options)  # type: ignore[arg-type]


def test_there_is_no_mask_before_the_first_episode() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="There is no scene yet: call reset"):
        HighwayEnv(config=SHORT).action_masks()


def test_an_episode_of_more_than_100_km_goes_on_to_its_end() -> None:
    # at 30 m/s from decision 3,334 on; SUMO removes a vehicle at the end of its route
    long = Config().updated("simulation", decisions_per_episode=3400)
    with HighwayEnv(config=long, safety_check="permit_all") as env:
        env.reset(seed=1, options={"vehicles": 0})
        way_m, truncated = 0.0, False
        while not truncated:
            *_, terminated, truncated, info = env.step(1)
            assert not terminated
            way_m += info["speed_m_s"]
        assert env.decisions == 3400
        assert way_m > 101_000


def test_copies_and_pickles_drive_the_same_episode() -> None:
    env = HighwayEnv(config=SHORT, safety_check="permit_all")
    others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    first, _ = env.reset(seed=5)
    for other in others:
        assert other.check_name == "permit_all"
        assert np.array_equal(other.reset(seed=5)[0], first)


def test_results_name_the_check_that_was_handed_in() -> None:
    env = HighwayEnv(config=SHORT, safety_check=permit_all)
    assert env.check_name == "permit_all"
    driver = IdmDriver(SHORT.safety)
    assert drive(env, driver, "idm", 1, 2).safety_check == "permit_all"


def test_a_number_is_drawn_and_a_training_begun_only_if_all_of_the_range_fit() -> None:
    # 113 fit; the first draw, 1 or 2 of 500, would hardly ever be too many
    config = SHORT.updated("traffic", vehicles_min=1, vehicles_max=500)
    with HighwayEnv(config=config) as env:
        for refused in (env.require_room, lambda: env.reset(seed=1)):
            with pytest.raises(ConfigError, match=r"vehicles_max is 500, but this road takes 113"):
                refused()
        for options, error in (({}, ConfigError), ({"vehicles": 5_000}, ScenarioError)):
            assert env.reset(seed=1, options={"vehicles": 3})[1]["vehicles"] == 3
            with pytest.raises(error):
                env.reset(seed=2, options=options)
            with pytest.raises(gymnasium.error.ResetNeeded):  # not the episode of before
                env.step(0)


@pytest.mark.parametrize("name", ["x" * 300, Config().to_toml()])
def test_a_name_too_long_for_a_file_is_refused_as_any_other(name: str) -> None:
    for build in (lambda: HighwayEnv(config=name), lambda: HighwayEnv(scenario=name)):
        with pytest.raises(DrlAvError, match=r"must be a preset|There is no scenario"):
            build()
    with pytest.raises(ConfigError, match="no driver"):
        find_drivers([name])


def test_a_folder_with_the_name_of_a_shipped_scenario_is_named_by_its_path(here: Path) -> None:
    (here / "straight").mkdir()
    write_scenario(here / "merge", ScenarioDescription(circumference_m=600.0))
    for name, is_loop in (("straight", False), ("merge", False), ("./merge", True)):
        with HighwayEnv(scenario=name, config=SHORT) as env:
            assert env.road.is_loop is is_loop
        rows = drl_av.evaluate("idm", scenario=name, config=SHORT, vehicles=0, episodes=1)
        assert (rows[0].way == "") is (is_loop or name == "straight")
    with HighwayEnv(scenario=Path("merge"), config=SHORT) as env:  # a Path is no name
        assert env.road.is_loop
    assert with_scenario(SHORT, "x" * 300).simulation.scenario == "x" * 300


def test_a_warning_says_that_the_settings_name_another_road() -> None:
    for config in ("large-exit", {"simulation": {"scenario": "exit"}}):
        for make in (gymnasium.make, gymnasium.make_vec):
            with pytest.warns(DrlAvWarning, match="on the road merge, not on exit of its set"):
                made: Any = make("drl_av/Merge-v0", config=config)
            made.close()
    with warnings.catch_warnings():
        warnings.simplefilter("error", DrlAvWarning)
        gymnasium.make("drl_av/Merge-v0", config={"simulation": {"scenario": "merge"}}).close()


def test_sumo_that_ends_on_its_own_is_reported_and_starts_again_with_the_next_episode() -> None:
    env = HighwayEnv(config=SHORT)
    first, _ = env.reset(seed=1, options={"vehicles": 2})
    libsumo.close()
    with pytest.raises(SimulationError, match=r"^SUMO ended on its own \(.*[^.]\): start again.$"):
        env.step(0)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)
    assert np.array_equal(env.reset(seed=1, options={"vehicles": 2})[0], first)
    libsumo.vehicle.remove("ego")
    with pytest.raises(SimulationError, match="'ego' is not known"):
        env.step(0)
    for _ in range(2):
        assert np.array_equal(env.reset(seed=1, options={"vehicles": 2})[0], first)
        libsumo.close()
    env.close()


def test_a_scenario_that_is_gone_is_reported_where_sumo_has_to_read_it(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(find_scenario(), tmp_path / "loop"))
    env = HighwayEnv(folder, config=SHORT)
    first, _ = env.reset(seed=1, options={"vehicles": 2})
    shutil.rmtree(folder)
    assert np.array_equal(env.reset(seed=1, options={"vehicles": 2})[0], first)
    env.close()
    for _ in range(2):
        with pytest.raises(SimulationError, match=r"cannot load the scenario .*No such file.*loop"):
            env.reset(seed=1, options={"vehicles": 2})
    env.close()


def test_a_reset_that_is_interrupted_leaves_no_vehicle_on_the_road(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(name: str, lane_id: str, position_m: float) -> None:
        if name == "vehicle4":  # it has been added, but is nowhere yet
            raise KeyboardInterrupt
        move_to(name, lane_id, position_m)

    env = HighwayEnv(config=SHORT)
    first, _ = env.reset(seed=1, options={"vehicles": 2})
    move_to = libsumo.vehicle.moveTo
    with monkeypatch.context() as patched:
        patched.setattr(libsumo.vehicle, "moveTo", interrupted)
        with pytest.raises(KeyboardInterrupt):
            env.reset(seed=1, options={"vehicles": 9})
    assert np.array_equal(env.reset(seed=1, options={"vehicles": 2})[0], first)
    env.step(0)
    assert len(libsumo.vehicle.getIDList()) == 3
    env.close()
