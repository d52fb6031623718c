"""SUMO's car following in the twin, by numbers worked out by hand."""

import pytest

from drl_av.twin.following import (
    brake_gap,
    ego_gap,
    follow_speed,
    free_speed,
    idm_speed,
    secure_gap,
)


def test_a_driver_with_much_room_accelerates_twice_a_quarter_second() -> None:
    # a = 2: 10 -> 10 + 0.25 * 2 * (1 - (1/2)^4) = 10.46875, and once more from there
    first = 10 + 0.5 * (1 - 0.5**4)
    second = first + 0.5 * (1 - (first / 20) ** 4)
    assert free_speed(10.0, 100.0, 20.0, 1.0, 2.0) == pytest.approx(second, abs=1e-8)


def test_the_wanted_gap_takes_the_acceleration_of_the_vehicle_type_not_the_drawn_one() -> None:
    # s* = 2.5 + 20 * 1 + 20 * 2 / (2 sqrt(1.5 * 4)); a = 1 appears in front only
    wanted_m = 2.5 + 20.0 + 20.0 * 2.0 / (2 * 6.0**0.5)
    first = 20.0 + 0.25 * (1 - (20 / 30) ** 4 - (wanted_m / 40.0) ** 2)
    gap_m = 40.0 - 0.25 * (first - 18.0)
    wanted_m = 2.5 + first + first * (first - 18.0) / (2 * 6.0**0.5)
    second = first + 0.25 * (1 - (first / 30) ** 4 - (wanted_m / gap_m) ** 2)
    assert idm_speed(20.0, 40.0, 18.0, 30.0, 1.0, 1.0, 2.5) == pytest.approx(second, abs=1e-12)
    assert follow_speed(20.0, 37.5, 18.0, 30.0, 1.0, 1.0) == pytest.approx(second, abs=1e-12)


def test_a_vehicle_stops_in_steps_of_half_a_second() -> None:
    # 10 m/s: 8, 6, 4, 2, 0 m/s for half a second each
    assert brake_gap(10.0, 4.0, 0.0) == 10.0
    assert brake_gap(10.0, 4.0, 1.5) == 25.0


def test_the_ego_needs_the_gap_of_krauss_and_the_others_that_of_idm() -> None:
    assert ego_gap(10.0, 10.0, 0.0) == 15.0  # headway 1.5 s
    # from 20 m/s it stops in 45 m and the one ahead from 16 m/s in 28 m; it reacts in 30 m
    assert ego_gap(20.0, 16.0, 1.0) == 75 - 28
    assert ego_gap(20.0, 16.0, -4.0) == 45 - 28  # it brakes already
    assert ego_gap(20.0, 16.0, -2.0) == 75 - 28  # in 95 m as it brakes now
    assert secure_gap(10.0, 10.0, 1.2) == 12.0
    assert secure_gap(10.0, 30.0, 1.2) == 0.0
