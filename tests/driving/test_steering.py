"""The steering law worked by hand, its bounds at any speed, and the vehicle that follows it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.config import EgoConfig
from drl_av.driving.maneuver import Pose, curvature_command, lane_change_length, settled, steer

EGO, LANE_M = EgoConfig(), 3.8
SPEEDS = st.floats(0, 30)
HEADINGS = st.floats(-0.6, 0.6)


def command(offset_m: float, slope: float = 0.0, speed_m_s: float = 20.0, **ego: float) -> float:
    """The curvature on a straight road; ``slope`` is the tangent of the heading."""
    heading = math.atan(slope)
    return curvature_command(0.0, offset_m, heading, speed_m_s, LANE_M, EgoConfig(**ego))


def test_a_lane_change_begins_with_six_widths_over_its_length_squared() -> None:
    # L = 5 s * 20 m/s = 100 m; 6 * 3.8 / 100^2; not 6 / T^2, nor anything without the speed
    assert command(3.8) == pytest.approx(0.00228)
    assert command(-3.8) == pytest.approx(-0.00228)
    assert command(3.8, speed_m_s=10.0) == pytest.approx(4 * 0.00228)
    assert command(3.8, lane_change_duration_s=10.0) == pytest.approx(0.00228 / 4)


def test_close_to_the_end_a_tenth_of_the_lane_change_counts_as_left() -> None:
    # with 3.8 mm left the cubic would have 1.8 m left of 100 m
    assert command(0.0038) == pytest.approx(6 * 0.0038 / 10**2)


def test_how_much_is_left_is_read_off_the_offset() -> None:
    # a fifth of the length covers 3 * 0.04 - 2 * 0.008 = 0.104 of the width, and leaves 80 m
    assert command(0.896 * 3.8) == pytest.approx(6 * 0.896 * 3.8 / 80**2)
    # on the cubic the command there is 6 * 3.8 / 100^2 * (1 - 2 * 0.2), a little less for heading
    slope = 6 * 0.2 * 0.8 * 3.8 / 100
    reversed = math.cos(math.atan(slope)) ** 3
    assert command(0.896 * 3.8, slope=slope) == pytest.approx(0.00228 * 0.6 * reversed)


def test_the_roads_own_curvature_is_fed_forward() -> None:
    there = curvature_command(0.001, 0.0, 0.0, 20.0, LANE_M, EGO)
    assert there == pytest.approx(0.001)
    assert curvature_command(-0.001, 3.8, 0.0, 20.0, LANE_M, EGO) == pytest.approx(0.00128)


def test_a_walking_ego_turns_as_sharply_as_it_can_and_needs_10_7_m() -> None:
    # 6 * 3.8 / L^2 = 0.2 at L = sqrt(114) = 10.677 m, which T_LC v falls below at 2.135 m/s
    assert lane_change_length(1.0, LANE_M, EGO) == pytest.approx(10.6771, abs=1e-4)
    assert lane_change_length(2.2, LANE_M, EGO) == pytest.approx(11.0)
    assert command(3.8, speed_m_s=1.0) == pytest.approx(0.2)
    assert command(3.8, speed_m_s=0.0) == pytest.approx(0.2)


def test_an_abort_at_30_m_s_brakes_its_drift_with_2_m_s2_and_no_more() -> None:
    # 2 s into a lane change: 6 W * 0.4 * 0.6 / 5 s = 1.0944 m/s to the left, 1.3376 m away
    assert command(-1.3376, slope=1.0944 / 30, speed_m_s=30.0) == pytest.approx(
        -2.0 / (30.0**2 + 1.0944**2)
    )


@given(offset_m=st.floats(-8, 8), heading=HEADINGS, speed=SPEEDS)
def test_curvature_and_lateral_acceleration_are_bounded(
    offset_m: float, heading: float, speed: float
) -> None:
    curvature = abs(curvature_command(0.0, offset_m, heading, speed, LANE_M, EGO))
    assert curvature <= EGO.max_curvature_per_m + 1e-12
    assert curvature * (speed / math.cos(heading)) ** 2 <= 2.0 + 1e-9


@given(offset_m=st.floats(-8, 8), heading=HEADINGS, speed=SPEEDS)
def test_left_and_right_are_steered_alike(offset_m: float, heading: float, speed: float) -> None:
    left = curvature_command(0.0, offset_m, heading, speed, LANE_M, EGO)
    right = curvature_command(0.0, -offset_m, -heading, speed, LANE_M, EGO)
    assert left == pytest.approx(-right, abs=1e-12)


@pytest.mark.parametrize(
    ("off_m", "slope", "ended"),
    [(0.0189, 0.0, True), (0.0191, 0.0, False), (0.0, 0.0037, True), (0.0, 0.0039, False)],
)
def test_a_lane_change_ends_within_half_a_percent_of_the_lane_and_a_tenth_of_the_mean_slope(
    off_m: float, slope: float, ended: bool
) -> None:
    # of 3.8 m, and of 3.8 m / 100 m
    assert settled(Pose(3.8 - off_m, math.atan(slope)), 3.8, 20.0, LANE_M, EGO) is ended


def test_at_1_5_m_s_a_lane_change_takes_7_s() -> None:
    # 10.677 m / 1.5 m/s = 7.12 s
    pose, taken_s = Pose(0.0, 0.0), 0.0
    while not settled(pose, 3.8, 1.5, LANE_M, EGO):
        pose, taken_s = steer(pose, 3.8, 1.5, 0.1, LANE_M, EGO), taken_s + 0.1
    assert taken_s == pytest.approx(7.12, abs=0.2)


@given(speed=st.floats(0.5, 30), y_m=st.floats(0, 3.8), slope=st.floats(-1, 1))
def test_from_wherever_it_is_the_ego_settles_where_it_is_steered(
    speed: float, y_m: float, slope: float
) -> None:
    pose = Pose(y_m, math.atan(1.5 * slope * LANE_M / lane_change_length(speed, LANE_M, EGO)))
    within_s = 2 * lane_change_length(speed, LANE_M, EGO) / speed
    for _ in range(math.ceil(within_s / 0.5)):
        if settled(pose, 3.8, speed, LANE_M, EGO):
            break
        pose = steer(pose, 3.8, speed, 0.5, LANE_M, EGO)
    assert settled(pose, 3.8, speed, LANE_M, EGO)
    assert abs(pose.y_m - 3.8) <= 0.019 + 1e-9
