"""Two vehicles that enter one lane from its two sides: the second one waits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import CENTER, LEFT, RIGHT, ROAD, Car, ahead, behind, snapshot

from drl_av.config import Config
from drl_av.drivers.background.traffic import give_way, scratch_of, traffic_numbers
from drl_av.road.snapshot import Snapshot
from drl_av.road.vehicle_types import AS_WRITTEN

# they brake with 4 m/s^2 from the next decision on, after 1 s, in steps of 0.5 s
TRAFFIC = traffic_numbers(Config(), ROAD, AS_WRITTEN)


def sides(shot: Snapshot, *wanted: tuple[int, int]) -> list[int]:
    """The sides that remain of the (row, side) wishes."""
    rows, left = np.array([row for row, _ in wanted]), np.zeros(len(shot.ids), np.int64)
    left[rows] = [side for _, side in wanted]
    give_way(rows, left, shot.arrays, TRAFFIC, scratch_of(TRAFFIC, len(shot.ids)))
    assert rows.tolist() == [row for row, _ in wanted]
    kept: list[int] = left[rows].tolist()
    return kept


@pytest.mark.parametrize(
    ("gap_m", "side"),
    [
        # at 20 m/s behind 12 m/s: 2.5 + 1 s * 20 + (45 - 15) m of braking = 52.5 m
        (52.0, 0),
        (53.0, -1),
    ],
)
def test_no_vehicle_enters_a_lane_in_front_of_one_from_the_other_side_that_could_not_stop(
    gap_m: float, side: int
) -> None:
    slow_on_the_left = ahead(gap_m, LEFT, 12.0)
    shot = snapshot(slow_on_the_left, y_m=0.76, v_y=0.76)  # the ego, on its way to the middle
    assert sides(shot, (1, -1)) == [side]


@pytest.mark.parametrize(
    ("gap_m", "side"),
    [
        (22.0, 0),  # 2.5 + 1 s * 20 m/s, and one that is faster needs no more
        (23.0, 1),
    ],
)
def test_no_vehicle_enters_a_lane_close_behind_one_from_the_other_side(
    gap_m: float, side: int
) -> None:
    shot = snapshot(behind(gap_m, RIGHT, 20.0), y_m=6.8, v_y=-0.76, speed_m_s=25.0)
    assert sides(shot, (1, 1)) == [side]


@pytest.mark.parametrize(
    "other",
    [
        Car(10.0, LEFT),  # stays where it is
        Car(10.0, LEFT - 0.76, 20.0, 0.76),  # on its way back to the left
        Car(10.0, CENTER + 1.0, 20.0, 0.76),  # leaves the middle lane
        Car(10.0, RIGHT + 0.5, 20.0, 0.76),  # comes from the same side: SUMO sees to that
    ],
)
def test_others_are_no_reason_to_wait(other: Car) -> None:
    assert sides(snapshot(other, y_m=RIGHT), (0, 1)) == [1]


def test_of_two_that_want_to_begin_at_once_the_first_does() -> None:
    shot = snapshot(ahead(5.0, LEFT), ahead(9.0, RIGHT), y_m=CENTER)
    assert sides(shot, (1, -1), (2, 1)) == [-1, 0]
    assert sides(shot, (2, 1), (1, -1)) == [1, 0]


def test_across_the_start_of_the_loop_they_see_each_other_too() -> None:
    shot = snapshot(ahead(20.0, LEFT), s_m=490.0, y_m=0.76, v_y=0.76)
    assert sides(shot, (1, -1)) == [0]


@given(st.permutations([(0, 1), (1, -1), (2, 0), (3, -1), (4, 1)]))
def test_wishes_keep_their_order_and_are_kept_or_withdrawn(wanted: list[tuple[int, int]]) -> None:
    others = (ahead(8.0, LEFT), behind(9.0, CENTER), ahead(90.0, LEFT), ahead(95.0, RIGHT))
    left = sides(snapshot(*others, y_m=RIGHT), *wanted)
    assert all(kept in (0, side) for kept, (_, side) in zip(left, wanted, strict=True))
    by_row = dict(zip((row for row, _ in wanted), left, strict=True))
    assert abs(by_row[0]) + abs(by_row[1]) == 1  # one of each pair begins
    assert abs(by_row[3]) + abs(by_row[4]) == 1
