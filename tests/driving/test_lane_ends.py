"""The end of a lane in the indicators: a vehicle that stands there."""

import numpy as np
import pytest
from worlds import CENTER, EXIT, LANE_M, MERGE, RIGHT, Car, scene

from drl_av.road.road import Barrier


def test_ego_on_the_ramp_sees_the_end_of_its_lane_as_a_standing_vehicle() -> None:
    found = scene(s_m=597.5, y_m=RIGHT, speed_m_s=20.0, road=MERGE).affordances
    assert found.own_front[1:] == (200.0, -20.0, 0.0, 0.0)  # from its front bumper at 600 m
    assert found.barriers == (Barrier(200.0, pytest.approx(-1.9), pytest.approx(1.9)),)


def test_a_vehicle_before_the_end_of_the_lane_is_the_one_ahead() -> None:
    found = scene(Car(50.0, RIGHT, 12.0), s_m=597.5, y_m=RIGHT, road=MERGE).affordances
    assert found.own_front.vehicle == 1
    assert found.own_front.gap_m == 45.0


def test_end_of_the_lane_beyond_the_range_is_not_seen_but_is_a_barrier() -> None:
    found = scene(s_m=500.0, y_m=RIGHT, road=MERGE, range_m=250.0).affordances
    assert found.own_front is None
    assert [barrier.s_m for barrier in found.barriers] == [297.5]


def test_ego_beside_a_lane_that_ends_sees_its_end_there() -> None:
    found = scene(s_m=700.0, y_m=LANE_M, road=MERGE).affordances
    assert found.right_lane
    assert found.own_front is None
    assert found.right_front[1:] == (97.5, -20.0, -LANE_M, 0.0)


@pytest.mark.parametrize(
    ("s_m", "there"), [(549.0, False), (551.0, True), (797.4, True), (797.6, False)]
)
def test_lane_beside_counts_only_where_it_is_joined_to_the_ego_from_centre_to_front(
    s_m: float, there: bool
) -> None:
    # the front is 2.5 m ahead of the centre, the lane joined from 550 m to 800 m
    assert scene(s_m=s_m, y_m=CENTER, road=MERGE).affordances.right_lane is there


def test_a_slow_ego_whose_front_has_passed_the_gore_stays_on_the_off_ramp() -> None:
    before, after = (scene(s_m=s_m, y_m=RIGHT, road=EXIT) for s_m in (1147.4, 1147.6))
    assert before.affordances.left_lane
    assert not after.affordances.left_lane


def test_what_lies_behind_is_no_barrier_and_the_gore_is_no_vehicle() -> None:
    assert scene(s_m=900.0, road=MERGE).affordances.barriers == ()
    found = scene(s_m=1000.0, y_m=RIGHT, road=EXIT).affordances
    assert found.own_front is None
    assert [barrier.s_m for barrier in found.barriers] == [147.5]


def test_the_mandatory_change_is_counted_from_the_front_bumper() -> None:
    # the front of the 5 m ego is at 600 m, the lane ends at 800 m
    found = scene(s_m=597.5, y_m=RIGHT, road=MERGE).affordances
    assert found.mandatory == (1, 200.0)
    assert scene(s_m=597.5, y_m=LANE_M, road=MERGE).affordances.mandatory == (0, np.inf)
    assert scene(y_m=RIGHT).affordances.mandatory == (0, np.inf)


def test_the_end_of_a_lane_that_the_ego_may_not_enter_is_not_seen() -> None:
    # the ramp exists beside it from 400 m on, but is joined from 550 m on; it ends at 800 m
    for s_m, seen in ((545.0, False), (551.0, True)):
        found = scene(s_m=s_m, y_m=LANE_M, road=MERGE, range_m=400.0).affordances
        assert found.right_lane is seen
        assert (found.right_front is not None) is seen
