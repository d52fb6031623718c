"""The check that permits what a search finds safe: faster than strict, and not blind."""

import numpy as np
import pytest

from drl_av.config import Config
from verification.adversary import BatchStrict, World
from verification.crash_simulation import SECONDS, Outcome
from verification.families import placed
from verification.sharper import Optimist, nothing, row

CONFIG = Config().updated("safety", check="strict")
ACCELERATE, LEFT = 1, 8


def behind(gap_m: float, ego: float, lead: float) -> World:
    """The ego in the middle lane, and one ahead of it with this net gap."""
    one = np.ones(1, np.int64)
    return placed(one, ego * one, np.array([[5.0 + gap_m]]), one[:, None], np.array([[lead]]))


def executed(check: object, world: World, action: int) -> int:
    return int(check(world, np.array([action]))[0])  # type: ignore[operator]


def test_it_permits_what_strict_refuses_for_its_clearance_and_not_what_ends_in_a_collision() -> (
    None
):
    # at 20 m/s: 10.5 + 11 m in the decision, 55 m of braking; the lead stands
    strict, optimist = BatchStrict(CONFIG), Optimist(CONFIG, 3, 0)
    for gap_m, permitted in ((77.1, [True, True]), (76.7, [False, True]), (75, [False, False])):
        world = behind(gap_m, 20.0, 0.0)
        numbers = [executed(each, world, ACCELERATE) for each in (strict, optimist, nothing)]
        assert [number == ACCELERATE for number in numbers] == [*permitted, True]


def test_off_the_road_and_after_a_collision_it_is_strict() -> None:
    world = behind(76.7, 20.0, 0.0)
    world.y_m[:, 0] = world.y_m[:, 1] = 7.6
    assert executed(Optimist(CONFIG, 3, 0), world, LEFT) != LEFT
    ended = behind(76.7, 20.0, 0.0)
    ended.collisions[0] = None  # type: ignore[assignment]
    assert executed(Optimist(CONFIG, 3, 0), ended, ACCELERATE) != ACCELERATE


def test_the_gain_is_paired_by_test_and_leaves_out_tests_that_ended_early() -> None:
    km, zero = np.array([0.84, 0.85, 0.10, 0.83]), np.zeros(4)
    outcome = Outcome(zero + 1, np.array([0, 0, 1.0, 0]), zero, km, zero)
    base = Outcome(zero + 1, zero, np.array([0, 0, 0, 1.0]), np.array([0.8, 0.8, 0.8, 0.2]), zero)
    found = row("real", "x", outcome, base)
    # +5 % and +6.25 %: mean 5.625, t(0.975, 1) = 12.706 times 0.625
    assert found["gain_percent"] == "5.62 ± 7.94"
    assert found["mean_speed_m_s"] == f"{1000 * 0.84 / SECONDS:.2f}"
    assert (found["ego_hit"], found["tests"]) == (1, 4)
    assert pytest.approx(840 / 27, abs=0.005) == float(found["mean_speed_m_s"])
