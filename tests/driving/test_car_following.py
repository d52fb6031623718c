"""Longitudinal references: four numbers, IDM, and adaptive cruise control, worked by hand."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import Car, ahead, scene

from drl_av.config import EgoConfig, SimulationConfig
from drl_av.driving.actions import Longitudinal
from drl_av.driving.car_following import acc_acceleration, set_speeds

SIMULATION = SimulationConfig()
MAINTAIN, ACCELERATE = Longitudinal.MAINTAIN, Longitudinal.ACCELERATE
BRAKE, HARD_BRAKE = Longitudinal.BRAKE, Longitudinal.HARD_BRAKE


def speeds(reference: str, action: Longitudinal, *others: Car, at: float = 20.0) -> list[float]:
    front = scene(*others, speed_m_s=at).affordances.own_front
    its = (math.inf, at) if front is None else (front.gap_m, at + front.relative_speed_m_s)
    ego, found = EgoConfig(longitudinal_reference=reference), [0.0] * SIMULATION.steps_per_decision
    set_speeds(found, at, *its, action, ego, SIMULATION.step_length_s)
    return found


def test_cruise_control_on_a_free_road_closes_in_on_the_desired_speed() -> None:
    # 0.4 * (30 - 20); a gap that is infinite asks for nothing
    assert acc_acceleration(20, 30, math.inf, 0, EgoConfig()) == pytest.approx(4.0)


def test_cruise_control_behind_a_slower_vehicle() -> None:
    # d - d_0 - h v = 40 - 2.5 - 26 = 11.5; (0.4 * 11.5 - 5) / 1.3 = -0.3077
    assert acc_acceleration(20, 30, 40, 5, EgoConfig()) == pytest.approx(-0.4 / 1.3)
    # at the wanted gap and the leader's speed: nothing
    assert acc_acceleration(20, 30, 28.5, 0, EgoConfig()) == pytest.approx(0.0)
    # the vehicle ahead draws away: speed control is the lesser
    assert acc_acceleration(20, 22, 40, -5, EgoConfig()) == pytest.approx(0.8)


@pytest.mark.parametrize("reference", ["idm", "acc"])
def test_braking_keeps_its_numbers(reference: str) -> None:
    near = ahead(20, speed_m_s=10)
    assert speeds(reference, BRAKE, near) == [19.0, 18.0]
    assert speeds(reference, HARD_BRAKE, near) == [18.0, 16.0]


@pytest.mark.parametrize("reference", ["acceleration", "idm", "acc"])
def test_on_a_free_road_maintain_maintains(reference: str) -> None:
    assert speeds(reference, MAINTAIN) == [20.0, 20.0]
    assert speeds(reference, MAINTAIN, at=0.0) == [0.0, 0.0]


def test_accelerate_on_a_free_road() -> None:
    assert speeds("acceleration", ACCELERATE) == [21.0, 22.0]
    assert speeds("acc", ACCELERATE) == [21.0, 22.0]  # 0.4 * 10 and 0.4 * 9, but at most 2
    # 2 (1 - (20/30)^4) = 1.604938; then from 20.802469
    first = 20 + 0.5 * 2 * (1 - 16 / 81)
    second = first + 0.5 * 2 * (1 - (first / 30) ** 4)
    assert speeds("idm", ACCELERATE) == pytest.approx([first, second])


def test_a_model_looks_again_in_each_sumo_step_at_a_vehicle_that_keeps_its_speed() -> None:
    # acc, 40 m behind, closing 5 m/s: a = -0.4 / 1.3, v = 19.846154, d = 40 - 4.846154 / 2
    first = 20 - 0.5 * 0.4 / 1.3
    gap_m = 40 - 0.5 * (first - 15)
    second = first + 0.5 * (0.4 * (gap_m - 2.5 - 1.3 * first) - (first - 15)) / 1.3
    found = speeds("acc", ACCELERATE, ahead(40, speed_m_s=15))
    assert found == pytest.approx([first, second])
    assert found[1] - found[0] != pytest.approx(found[0] - 20)  # not one number for both


def test_idm_behind_a_slower_vehicle_brakes_by_its_formula() -> None:
    # s* = 2.5 + 26 + 20 * 5 / (2 * 2) = 53.5; 2 (1 - (20/30)^4 - (53.5/40)^2) = -1.972870
    [first, _] = speeds("idm", ACCELERATE, ahead(40, speed_m_s=15))
    assert first == pytest.approx(20 - 0.5 * 1.972870, abs=1e-5)
    # maintain desires 20 m/s, the speed it has: 2 (1 - 1 - 1.788906)
    [first, _] = speeds("idm", MAINTAIN, ahead(40, speed_m_s=15))
    assert first == pytest.approx(20 - 0.5 * 2 * (53.5 / 40) ** 2)


@given(
    reference=st.sampled_from(["idm", "acc"]),
    action=st.sampled_from(Longitudinal),
    at=st.floats(0, 30),
    gap_m=st.floats(0, 200),
    leader=st.floats(0, 40),
)
def test_a_model_never_goes_beyond_what_the_ego_can_do(
    reference: str, action: Longitudinal, at: float, gap_m: float, leader: float
) -> None:
    found = [at, *speeds(reference, action, ahead(gap_m, speed_m_s=leader), at=at)]
    for before, after in pairwise(found):
        assert 0 <= after <= 30
        assert -4 * 0.5 - 1e-9 <= after - before <= 2 * 0.5 + 1e-9
    by_number = speeds("acceleration", action, at=at)
    assert all(a <= b + 1e-9 for a, b in zip(found[1:], by_number, strict=True))


def test_maintain_does_not_overtake_itself_where_a_slow_vehicle_ahead_draws_away() -> None:
    # idm at 1 m/s behind one at 30: s* = 2.5, so -2 (2.5 / 3.54)^2 = -1 and 0.5 m/s; then, 18 m
    # behind, some 2 (1 - 0.5^4) = 1.9, which would make 1.4 m/s
    found = speeds("idm", MAINTAIN, ahead(3.54, speed_m_s=30.0), at=1.0)
    assert found == pytest.approx([0.5, 1.0], abs=2e-3)
