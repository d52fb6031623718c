"""Surrogate measures of safety and comfort, worked by hand."""

import math

import numpy as np
import pytest

from drl_av.evaluation.criticality import (
    Motion,
    Track,
    post_encroachment_time,
    required_deceleration,
)

LOOP_M = 500.0
STILL = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def track(s_m: list[float], y_m: list[float] | float = 3.8, length_m: float = 5.0) -> Track:
    """The track of a vehicle of 1.8 m width, one state a second."""
    moments = len(s_m)
    return Track(
        np.arange(float(moments)),
        np.array(s_m),
        np.array(y_m) if isinstance(y_m, list) else np.full(moments, y_m),
        np.full(moments, length_m),
        np.full(moments, 1.8),
    )


def test_a_crash_is_avoided_by_the_square_of_the_closing_speed_over_twice_the_gap() -> None:
    # 10 m/s are braked away at 2.5 m/s^2 in 4 s, in which 20 m are driven
    assert required_deceleration(20.0, 10.0) == 2.5
    assert required_deceleration(20.0, 0.0) == required_deceleration(0.0, -1.0) == 0.0
    assert required_deceleration(0.0, 1.0) == math.inf


@pytest.mark.parametrize(
    ("motion", "comfortable"),
    [
        (STILL, True),
        (STILL._replace(a_x_m_s2=-4.0, j_x_m_s3=-4.0), True),  # a hard brake out of constant speed
        (STILL._replace(a_x_m_s2=-4.0, j_x_m_s3=-6.0), False),  # out of an acceleration
        (STILL._replace(a_x_m_s2=-4.06), False),
        (STILL._replace(a_x_m_s2=2.41), False),
        (STILL._replace(a_x_m_s2=2.4, a_y_m_s2=-4.89), True),
        (STILL._replace(a_y_m_s2=-4.9), False),
        (STILL._replace(j_y_m_s3=-8.37), True),
        (STILL._replace(j_x_m_s3=4.0, j_y_m_s3=7.4), False),  # 8.41 m/s^3 together
        (STILL._replace(yaw_rate_rad_s=-0.96), False),
        (STILL._replace(yaw_acceleration_rad_s2=-1.94), False),
    ],
)
def test_comfort_is_within_all_bounds_of_nuplan(motion: Motion, comfortable: bool) -> None:
    assert motion.comfortable == comfortable


def test_behind_a_vehicle_of_the_same_speed_the_pet_is_the_time_gap() -> None:
    first, second = track([125.0, 145.0, 165.0, 185.0]), track([100.0, 120.0, 140.0, 160.0])
    # 20 m between the bumpers at 20 m/s
    assert post_encroachment_time(first, second, 0.0) == pytest.approx(1.0)
    assert post_encroachment_time(second, first, 0.0) == math.inf  # no vehicle comes back
    # on the loop the other is 475 - 5 m ahead of it, further than it drives
    assert post_encroachment_time(second, first, LOOP_M) == math.inf


def test_a_vehicle_that_brakes_arrives_later_than_its_time_gap_says() -> None:
    first, second = track([125.0, 145.0, 165.0, 185.0]), track([100.0, 110.0, 115.0, 135.0])
    # the rear of the first is at 122.5 at 0 s; the front of the second, at 102.5, 112.5, 117.5 and
    # 137.5, reaches it a quarter of a second after 2 s. The rear's next place, 142.5, it never does
    assert post_encroachment_time(first, second, 0.0) == pytest.approx(2.25)


def test_the_loop_s_origin_lies_between_them() -> None:
    first, second = track([15.0, 35.0, 55.0]), track([490.0, 10.0, 30.0])
    assert post_encroachment_time(first, second, LOOP_M) == pytest.approx(1.0)
    crossing = track([0.0, 10.0]), track([485.0, 499.0])  # 10 m apart at first, 14 m/s behind
    assert post_encroachment_time(*crossing, LOOP_M) == pytest.approx(10 / 14)
    lengths = track([15.0, 35.0, 55.0], length_m=15.0)  # 5 m less between them
    assert post_encroachment_time(lengths, second, LOOP_M) == pytest.approx(0.75)


def test_a_change_of_lane_makes_a_pet_only_where_the_bodies_would_have_met() -> None:
    first = track([125.0, 145.0, 165.0, 185.0], 7.6)
    straight = track([100.0, 120.0, 140.0, 160.0], 3.8)
    assert post_encroachment_time(first, straight, 0.0) == math.inf
    # it arrives at the first's places 1 s later each, 2.8, 1.9 and 1.6 m beside them; 1.8 m wide
    moving = track([100.0, 120.0, 140.0, 160.0], [3.8, 4.8, 5.7, 6.0])
    assert post_encroachment_time(first, moving, 0.0) == pytest.approx(1.0)
    slower = track([100.0, 120.0, 140.0, 160.0], [3.8, 4.8, 5.3, 5.75])  # 1.85 m beside the last
    assert post_encroachment_time(first, slower, 0.0) == math.inf


def test_a_vehicle_beside_is_not_behind() -> None:
    first, second = track([103.0, 123.0]), track([100.0, 120.0])  # their bodies overlap
    assert post_encroachment_time(first, second, 0.0) == math.inf
