"""Lanes that begin and end on an open road, and what stands at their ends."""

import math
from dataclasses import replace

import numpy as np
import pytest
from worlds import EXIT, LEAVE, MERGE, NARROWING, ROAD

from drl_av.road.road import (
    Barrier,
    Road,
    holds,
    is_beside,
    is_open_at,
    lane_end_m,
    mandatory_change,
)


def test_distances_on_an_open_road_go_along_it_and_never_round() -> None:
    assert MERGE.ahead_m(1600.0, np.array([0.0, 1601.0])).tolist() == [-1600.0, 1.0]
    assert ROAD.is_loop
    assert not MERGE.is_loop


@pytest.mark.parametrize(
    ("road", "s_m", "lanes"),
    [
        (MERGE, 399.0, [1, 2, 3]),  # before the ramp
        *((MERGE, 400.0, [0, 1, 2, 3]), (MERGE, 799.9, [0, 1, 2, 3])),
        *((MERGE, 800.0, [1, 2, 3]), (EXIT, 899.0, [1, 2, 3])),
        (EXIT, 5000.0, [0, 1, 2, 3]),  # the off-ramp does not end
        *((ROAD, 5000.0, [0, 1, 2]), (NARROWING, 799.0, [0, 1, 2, 3, 4])),
        *((NARROWING, 899.0, [2, 3, 4]), (NARROWING, 900.0, [2, 3])),
        (NARROWING, 1000.0, [2, 3, 4]),
    ],
)
def test_lanes_exist_where_they_begin_and_not_where_they_have_ended(
    road: Road, s_m: float, lanes: list[int]
) -> None:
    assert [lane for lane in range(-1, 6) if is_open_at(lane, s_m, road)] == lanes


@pytest.mark.parametrize(
    ("road", "s_m", "beside"),
    [
        (MERGE, 549.0, False),  # the ramp lies beside the road, divided from it
        (MERGE, 550.0, True),
        (MERGE, 800.0, False),
        (EXIT, 899.0, False),
        (EXIT, 1149.0, True),
        (EXIT, 1150.0, False),  # too late for the exit
    ],
)
def test_a_ramp_is_entered_only_where_the_lanes_are_joined(
    road: Road, s_m: float, beside: bool
) -> None:
    assert is_beside(1, 0, s_m, road) is beside
    assert is_beside(1, 2, s_m, road)  # the other lanes are joined everywhere


def test_a_lane_that_has_ended_is_beside_no_lane() -> None:
    assert not is_beside(0, 1, 500.0, MERGE)  # the divider counts from both sides
    assert is_beside(0, 1, 600.0, MERGE)


def test_a_lane_on_the_left_is_entered_from_its_right_while_it_is_there() -> None:
    assert is_beside(3, 4, 899.0, NARROWING)
    assert is_beside(4, 3, 899.0, NARROWING)
    assert not is_beside(3, 4, 950.0, NARROWING)
    assert is_beside(0, 1, 700.0, NARROWING)  # both end at 800 m
    assert not is_beside(2, 1, 850.0, NARROWING)


def test_lane_ends_where_it_says_and_a_lane_of_the_whole_road_never() -> None:
    assert lane_end_m(0, 450.0, MERGE) == 800.0
    assert lane_end_m(1, 450.0, MERGE) == math.inf
    assert lane_end_m(0, 950.0, EXIT) == math.inf


def test_the_end_of_a_lane_is_as_wide_as_the_lane_and_the_gore_is_a_line() -> None:
    assert MERGE.barriers == (Barrier(800.0, pytest.approx(-1.9), pytest.approx(1.9)),)
    assert EXIT.barriers == (Barrier(1150.0, pytest.approx(1.9), pytest.approx(1.9)),)
    assert ROAD.barriers == ()


def test_lanes_of_both_sides_end_at_barriers() -> None:
    right, next_to_it, left = NARROWING.barriers
    assert right == (800.0, pytest.approx(-1.9), pytest.approx(1.9))
    assert next_to_it == (800.0, pytest.approx(1.9), pytest.approx(5.7))
    assert left == (900.0, pytest.approx(13.3), pytest.approx(17.1))


@pytest.mark.parametrize(
    ("road", "s_m", "y_m", "held"),
    [
        (MERGE, 500.0, 0.0, True),
        (MERGE, 500.0, 1.0, True),  # body at 1.9 m, up to the divider
        (MERGE, 500.0, 1.1, False),  # over it
        (MERGE, 600.0, 1.1, True),
        (MERGE, 799.0, 2.0, True),
        (MERGE, 800.0, 2.0, False),  # half past the end of its lane
        (MERGE, 800.0, 2.9, True),
        (EXIT, 1149.0, 1.9, True),
        (EXIT, 1150.0, 1.9, False),  # on the gore
        (EXIT, 1200.0, 0.0, True),
        (NARROWING, 899.0, 13.3, True),  # half in the left lane
        (NARROWING, 900.0, 13.3, False),
        (NARROWING, 900.0, 12.3, True),
    ],
)
def test_a_body_is_held_by_lanes_that_exist_and_are_joined_there(
    road: Road, s_m: float, y_m: float, held: bool
) -> None:
    assert holds(y_m, 1.8, s_m, road) is held


@pytest.mark.parametrize(
    ("road", "lane", "s_m", "lanes", "within_m"),
    [
        (MERGE, 0, 500.0, 1, 300.0),  # the ramp ends at 800 m
        (MERGE, 1, 500.0, 0, math.inf),
        (LEAVE, 3, 100.0, -3, 1050.0),  # the exit can be entered up to 1,150 m
        (LEAVE, 1, 1149.0, -1, 1.0),
        (LEAVE, 0, 1149.0, 0, math.inf),  # on the exit
        (LEAVE, 1, 1150.0, 0, math.inf),  # it has missed the exit
        (EXIT, 3, 100.0, 0, math.inf),  # an exit that is not on its way
        (ROAD, 2, 100.0, 0, math.inf),
        (NARROWING, 4, 700.0, -1, 200.0),  # the left lane ends: to the right
        (NARROWING, 1, 700.0, 1, 100.0),
        (NARROWING, 0, 700.0, 2, 100.0),  # the lane beside it ends with it
        (NARROWING, 4, 1100.0, 0, math.inf),
    ],
)
def test_the_way_demands_lane_changes_before_a_lane_ends_and_before_the_exit(
    road: Road, lane: int, s_m: float, lanes: int, within_m: float
) -> None:
    assert mandatory_change(lane, s_m, road) == (lanes, within_m)


def test_the_way_from_ramp_to_ramp_demands_a_change_to_the_left_and_back() -> None:
    ramp, off_ramp = MERGE.partial_lanes[0], EXIT.partial_lanes[0]
    road = replace(MERGE, partial_lanes=(ramp, off_ramp), exit_m=1150.0)
    assert mandatory_change(0, 500.0, road) == (1, 300.0)
    assert mandatory_change(2, 500.0, road) == (-2, 650.0)
    assert mandatory_change(0, 1000.0, road) == (0, math.inf)
