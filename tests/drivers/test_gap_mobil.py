"""The nearest of four accelerations to a time-gap law, worked out by hand, and MOBIL across."""

import pytest
from worlds import RIGHT, SLOW_LEADER, ahead, scene

from drl_av.config import Config
from drl_av.drivers.registry import rule_driver
from drl_av.drivers.rule_based import MobilDriver
from drl_av.driving.actions import Action, Lateral, Longitudinal
from drl_av.driving.car_following import time_gap_acceleration
from drl_av.driving.scene import Scene

CONFIG = Config()
KEEP = Lateral.KEEP


def act(world: Scene, headway_s: float = 1.1) -> Action:
    driver = MobilDriver(CONFIG.safety, CONFIG.ego, CONFIG.mobil, headway_s)
    return driver.act(world, None)


def test_the_law_20_m_behind_a_vehicle_that_is_5_m_s_slower() -> None:
    # to spare: 20 - 2.5 - 1.1 * 20 = -4.5 m; (0.4 * -4.5 - 5) / 1.1 = -6.8 / 1.1
    found = time_gap_acceleration(20.0, 20.0, 5.0, 1.1, CONFIG.ego)
    assert found == pytest.approx(-6.8 / 1.1)
    assert act(SLOW_LEADER) == Action(Lateral.LEFT, Longitudinal.HARD_BRAKE)  # the lane is free


@pytest.mark.parametrize(
    ("gap_m", "speed_m_s", "action"),
    [
        # (0.4 (gap - 24.5) + v - 20) / 1.1
        (24.5, 20.0, Longitudinal.MAINTAIN),  # 0: the gap that the law keeps
        (27.1, 20.0, Longitudinal.MAINTAIN),  # 0.945
        (27.4, 20.0, Longitudinal.ACCELERATE),  # 1.055
        (21.9, 20.0, Longitudinal.MAINTAIN),  # -0.945
        (21.6, 20.0, Longitudinal.BRAKE),  # -1.055
        (24.5, 17.0, Longitudinal.BRAKE),  # -2.73
        (24.5, 16.6, Longitudinal.HARD_BRAKE),  # -3.09
        (18.0, 23.0, Longitudinal.MAINTAIN),  # 0.36: too near, but drawing away
    ],
)
def test_the_nearest_action_to_the_law_at_20_m_s(
    gap_m: float, speed_m_s: float, action: Longitudinal
) -> None:
    beside = ahead(gap_m, RIGHT, speed_m_s)  # no lane is better
    world = scene(ahead(gap_m, speed_m_s=speed_m_s), beside, ahead(gap_m, 7.6, speed_m_s))
    assert act(world) == Action(KEEP, action)


def test_a_longer_headway_keeps_a_longer_gap() -> None:
    world = scene(ahead(25.0), ahead(25.0, RIGHT), ahead(25.0, 7.6))
    # 1.1 s: (0.4 * 0.5) / 1.1 = 0.18; 1.3 s: 0.4 * -3.5 / 1.3 = -1.08
    assert act(world, 1.1) == Action(KEEP, Longitudinal.MAINTAIN)
    assert act(world, 1.3) == Action(KEEP, Longitudinal.BRAKE)


def test_both_headways_are_drivers_by_name() -> None:
    world = scene(ahead(25.0), ahead(25.0, RIGHT), ahead(25.0, 7.6))
    actions = [rule_driver(n, CONFIG).act(world, None) for n in ("gap-mobil", "gap-mobil-1.3")]
    assert actions == [act(world, 1.1), act(world, 1.3)]
