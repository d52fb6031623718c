"""Gaps and lanes on a circular road."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from worlds import BARRICADED_ROAD, ROAD

from drl_av.road.road import Road, holds, is_open


def way(s_from_m: float, s_to_m: float, road: Road = ROAD) -> float:
    return float(road.ahead_m(s_from_m, np.array([s_to_m]))[0])


@pytest.mark.parametrize(
    ("s_from_m", "s_to_m", "ahead_m"),
    [
        (100, 130, 30),
        (130, 100, -30),
        (490, 10, 20),  # not -480: the seam of the loop is between them
        (10, 490, -20),  # not 480
        (0, 249, 249),
        (0, 251, -249),  # half the loop and more is behind
        (0, 250, -250),  # exactly opposite: behind, and only behind
        (77, 77, 0),
    ],
)
def test_way_is_the_shorter_one(s_from_m: float, s_to_m: float, ahead_m: float) -> None:
    assert way(s_from_m, s_to_m) == ahead_m


def test_way_is_taken_to_every_vehicle_at_once() -> None:
    ways = ROAD.ahead_m(495.0, np.array([495.0, 5.0, 485.0, 240.0, 250.0]))
    assert ways.tolist() == [0.0, 10.0, -10.0, 245.0, -245.0]


@given(st.floats(0, 499.99), st.floats(0, 499.99))
def test_way_there_leads_there_and_the_way_back_is_its_opposite(a: float, b: float) -> None:
    there = way(a, b)
    assert -250 <= there < 250
    assert way((a + there) % 500, b) == pytest.approx(0, abs=1e-9)
    assume(abs(abs(there) - 250) > 1e-9)
    assert way(b, a) == pytest.approx(-there, abs=1e-9)


@pytest.mark.parametrize(
    ("y_m", "lane"),
    [
        *((0, 0), (1.89, 0), (1.91, 1), (3.8, 1), (5.69, 1), (5.71, 2), (7.6, 2)),
        *((9.51, 3), (-1.91, -1)),
    ],
)
def test_lane_is_the_one_whose_edges_are_either_side(y_m: float, lane: int) -> None:
    assert ROAD.lane_of(y_m) == lane


@pytest.mark.parametrize("lane", [0, 1, 2])
def test_centre_of_a_lane_is_in_that_lane(lane: int) -> None:
    assert ROAD.center_m(lane) == pytest.approx((0.0, 3.8, 7.6)[lane])
    assert ROAD.lane_of(ROAD.center_m(lane)) == lane


def test_barricaded_lane_and_lanes_beyond_the_road_are_no_lanes() -> None:
    assert [is_open(lane, ROAD) for lane in range(-1, 4)] == [False, True, True, True, False]
    # lane -1 is not lane 2: the index must not wrap round
    found = [is_open(lane, BARRICADED_ROAD) for lane in range(-1, 4)]
    assert found == [False, False, True, True, False]


@pytest.mark.parametrize(
    ("road", "y_m", "held"),
    [
        (ROAD, 0.0, True),
        (ROAD, 1.9, True),  # between two open lanes
        (ROAD, -0.99, True),  # right side at -1.89, the road's edge at -1.9
        (ROAD, -1.01, False),  # the centre is still on the road, the body is not
        (ROAD, 8.59, True),
        (ROAD, 8.61, False),
        (BARRICADED_ROAD, 3.8, True),
        (BARRICADED_ROAD, 2.81, True),
        (BARRICADED_ROAD, 2.79, False),  # in the centre lane, but over the barricade's line
        (BARRICADED_ROAD, 0.0, False),
    ],
)
def test_body_of_1_8_m_is_held_by_open_lanes_only(road: Road, y_m: float, held: bool) -> None:
    assert holds(y_m, 1.8, 0.0, road) is held


@given(st.floats(-6, 14), st.floats(0.5, 3))
def test_body_is_held_where_both_its_sides_and_all_between_are(y_m: float, width_m: float) -> None:
    sides = np.linspace(y_m - width_m / 2, y_m + width_m / 2, 40)
    assume(np.abs((sides - 1.9) % 3.8).min() > 1e-6)
    assume(np.abs((sides + 1.9) % 3.8 - 3.8).min() > 1e-6)
    for road in (ROAD, BARRICADED_ROAD):
        everywhere = all(is_open(road.lane_of(side), road) for side in sides.tolist())
        assert holds(y_m, width_m, 0.0, road) is everywhere


def test_a_body_as_wide_as_its_lane_is_held_by_each_open_lane() -> None:
    road = Road(500.0, 3.8, (True, True, True))
    assert all(holds(road.center_m(lane), 3.8, 0.0, road) for lane in range(3))
    assert not holds(7.61, 3.8, 0.0, road)
