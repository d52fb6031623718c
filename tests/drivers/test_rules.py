"""The drivers by rule that the paper compares with."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from worlds import ALONE, CENTER, LEFT, RIGHT, ahead, behind, changing, scene, scenes

from drl_av.config import SafetyConfig
from drl_av.drivers.driver import Driver
from drl_av.drivers.rule_based import IdmDriver, IdmSumoDriver, RandomDriver
from drl_av.driving.actions import ACTIONS, Action, Lateral, Longitudinal
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.safety.check import Rule
from drl_av.safety.paper import paper

CONFIG = SafetyConfig()
NOTHING = np.zeros(27, dtype=np.float32)
MAINTAIN, ACCELERATE = Longitudinal.MAINTAIN, Longitudinal.ACCELERATE
BRAKE, HARD_BRAKE = Longitudinal.BRAKE, Longitudinal.HARD_BRAKE


def act(driver: Driver, world: Scene) -> Action:
    driver.start(0)
    return driver.act(world, NOTHING)


@pytest.mark.parametrize(
    ("gap", "closing_m_s", "how"),
    [
        (10.0, 5.0, HARD_BRAKE),  # T_C = T_HB = 2 s
        (10.1, 5.0, BRAKE),
        (15.0, 5.0, BRAKE),  # T_C = T_B = 3 s
        (15.1, 5.0, MAINTAIN),
        (40.0, 5.0, MAINTAIN),  # T_C = T_A = 8 s
        (40.1, 5.0, ACCELERATE),
        (15.0, 0.0, MAINTAIN),  # T_C is infinite, but 15 m are too few
        (15.1, 0.0, ACCELERATE),
        (2.0, -4.0, MAINTAIN),  # 2 + 12 = 14
        (4.0, -4.0, ACCELERATE),  # 4 + 12 = 16
        (17.0, 1.0, MAINTAIN),  # T_C is 17 s, but 17 - 3 = 14 is too little
        (200.0, 20.0, ACCELERATE),  # 10 s, and 200 - 60 = 140
        (150.0, 20.0, MAINTAIN),  # 7.5 s: not for the gap, for the time
    ],
)
def test_idm_brakes_by_time_to_collision_and_accelerates_above_8_s(
    gap: float, closing_m_s: float, how: Longitudinal
) -> None:
    world = scene(ahead(gap, CENTER, 20.0 - closing_m_s))
    assert act(IdmDriver(CONFIG), world) == Action(Lateral.KEEP, how)


@pytest.mark.parametrize(
    ("gap", "closing_m_s", "how"),
    [
        (0.1, 0.0, ACCELERATE),  # T_C is infinite at equal speeds
        (17.0, 1.0, ACCELERATE),  # 17 s
        (40.0, 5.0, MAINTAIN),  # 8 s
        (15.0, 5.0, BRAKE),
    ],
)
def test_as_printed_idm_accelerates_above_8_s_at_any_gap(
    gap: float, closing_m_s: float, how: Longitudinal
) -> None:
    world = scene(ahead(gap, CENTER, 20.0 - closing_m_s))
    assert act(IdmDriver(SafetyConfig(printed_idm=True)), world) == Action(Lateral.KEEP, how)


def test_idm_looks_at_its_own_lane_only_and_never_leaves_it() -> None:
    world = scene(ahead(1, LEFT, 0.0), ahead(1, RIGHT, 0.0), behind(1, speed_m_s=40.0), wish=1)
    assert act(IdmDriver(CONFIG), world) == Action(Lateral.KEEP, ACCELERATE)


@given(scenes())
def test_idm_never_proposes_what_the_check_would_slow_down(world: Scene) -> None:
    verdict = paper(world, act(IdmDriver(CONFIG), world), CONFIG)
    assert Rule.IN_LANE not in verdict.rule


@pytest.mark.parametrize(
    ("wish", "lateral"), [(1, Lateral.LEFT), (-1, Lateral.RIGHT), (0, Lateral.KEEP)]
)
def test_idm_sumo_changes_lanes_as_sumo_requests(wish: int, lateral: Lateral) -> None:
    world = scene(ahead(15.1, CENTER, 15.0), wish=wish)
    assert act(IdmSumoDriver(CONFIG), world) == Action(lateral, MAINTAIN)


def test_idm_sumo_is_refused_where_no_sumo_is_asked() -> None:
    world = scene()
    unasked = world.snapshot._replace(sumo_lane_change=None)
    with pytest.raises(ConfigError, match="only the environment in SUMO reads: take idm-mobil"):
        act(IdmSumoDriver(CONFIG), replace(world, snapshot=unasked))


def test_idm_sumo_lets_a_lane_change_run_whatever_sumo_wishes_meanwhile() -> None:
    world = changing(origin=1, target=2, seconds=2)
    for wish in (1, -1, 0):
        shot = scene(wish=wish).snapshot
        assert act(IdmSumoDriver(CONFIG), replace(world, snapshot=shot)).lateral is Lateral.KEEP


def drawn(driver: RandomDriver, seed: int, number: int = 50) -> list[int]:
    driver.start(seed)
    return [driver.act(ALONE, NOTHING).number for _ in range(number)]


def test_random_draws_the_same_decisions_from_the_same_seed_whatever_it_drew_before() -> None:
    driver = RandomDriver()
    first = drawn(driver, 7)
    assert drawn(driver, 8) != first
    assert drawn(driver, 7) == first == drawn(RandomDriver(), 7)


def test_random_takes_each_of_the_12_about_as_often() -> None:
    counts = np.bincount(drawn(RandomDriver(), 1, 6000), minlength=12)
    assert len(counts) == len(ACTIONS)
    chi_square = float(((counts - 500) ** 2 / 500).sum())
    assert chi_square < 31.3  # 0.1 % of fair draws are above, with 11 degrees of freedom
