"""Drivers of the ego that may not pass on the right above 60 km/h."""

from pathlib import Path

import numpy as np
import pytest
from worlds import LEFT, RIGHT, Car, ahead, scene

from drl_av.config import Config
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.registry import RULE_DRIVERS, rule_driver
from drl_av.drivers.rule_based import TUNED, NoPassingOnTheRight, SumoDriver
from drl_av.driving.actions import Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.scenarios.folder import PlacedVehicle, ScenarioDescription, write_scenario

FREE = Config()
BANNED = FREE.updated("ego", overtake_right=False)
OBSERVATION = np.zeros(27, np.float32)
TO_THE_RIGHT = 4


def longitudinal(world: Scene, config: Config, name: str = "gap-mobil") -> Longitudinal:
    return rule_driver(name, config).act(world, OBSERVATION).longitudinal


def test_it_follows_a_slower_vehicle_at_its_left_as_one_ahead() -> None:
    world = scene(ahead(24.5, LEFT, 17.0))  # (0 - 3) / 1.1 = -2.7 m/s2, as in its own lane
    assert longitudinal(world, FREE) is Longitudinal.ACCELERATE
    assert longitudinal(world, BANNED) is Longitudinal.BRAKE


def test_a_nearer_vehicle_ahead_still_counts() -> None:
    world = scene(ahead(10.0, speed_m_s=17.0), ahead(24.5, LEFT, 17.0))
    assert longitudinal(world, BANNED) is Longitudinal.HARD_BRAKE


@pytest.mark.parametrize(
    "world",
    [
        scene(ahead(24.5, LEFT, 16.6)),  # 60 km/h are 16.67 m/s: congestion
        scene(Car(3.0, LEFT, 17.0)),  # alongside
        scene(ahead(24.5, RIGHT, 17.0)),  # it passes on the left of this one
        scene(),
    ],
)
def test_it_passes_in_congestion_those_alongside_and_on_the_left(world: Scene) -> None:
    assert longitudinal(world, BANNED) is Longitudinal.ACCELERATE


@pytest.mark.parametrize(
    ("world", "lateral"),
    [
        (scene(ahead(40.0, speed_m_s=17.0)), Lateral.KEEP),
        (scene(ahead(40.0, speed_m_s=16.0)), Lateral.RIGHT),
        (scene(), Lateral.RIGHT),
    ],
)
def test_it_does_not_change_to_the_right_of_one_that_it_would_pass(
    world: Scene, lateral: Lateral
) -> None:
    driver = NoPassingOnTheRight(PolicyDriver(lambda o: TO_THE_RIGHT), BANNED.ego)
    assert driver.act(world, OBSERVATION).lateral is lateral


RULES = [name for name in RULE_DRIVERS if name != "random"]


@pytest.mark.parametrize(
    ("name", "config", "passes"), [("idm", FREE, True), *((name, BANNED, False) for name in RULES)]
)
def test_no_rule_based_driver_passes_on_the_right_where_it_may_not(
    name: str, config: Config, passes: bool, tmp_path: Path
) -> None:
    placed = (PlacedVehicle("ego", 0, 100, 25, 30), PlacedVehicle("slow", 1, 165, 22, 22))
    road = ScenarioDescription(2000.0, lanes=2, vehicles=placed)
    write_scenario(tmp_path / "s", road)
    config = config.updated("traffic", random_lane_changes_per_s=0.0)
    with HighwayEnv(tmp_path / "s", config=config) as env:
        passed_right = []
        for decision in rollout(env, rule_driver(name, config), 1, 1):
            y_m = decision.next_scene.snapshot.y_m
            s_m = decision.next_scene.snapshot.s_m
            beside = abs(float(env.road.ahead_m(s_m[1], s_m[0]))) < 5
            passed_right.append(beside and y_m[0] < 1.0)
    assert any(passed_right) == passes


def test_sumo_tuned_may_pass_where_the_config_says_so() -> None:
    for config, expected in ((FREE, TUNED), (BANNED, TUNED._replace(overtake_right=False))):
        driver = rule_driver("sumo-tuned", config)
        assert isinstance(driver, SumoDriver)
        assert driver.model == expected
