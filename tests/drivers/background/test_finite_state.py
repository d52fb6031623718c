"""The finite-state machine: cruise, follow, change lanes, by gaps and relative speeds."""

import pytest
from hypothesis import given
from worlds import CENTER, LANE_M, LEFT, RIGHT, ROAD, Car, ahead, behind, scenes, snapshot

from drl_av.config import FiniteStateConfig
from drl_av.drivers.background.finite_state import CRUISE, FOLLOW, LANE_CHANGE, finite_state
from drl_av.driving.affordances import compute_indicators
from drl_av.driving.scene import Scene
from drl_av.road.snapshot import Snapshot

CONFIG = FiniteStateConfig()


def decide(
    shot: Snapshot, state: int = CRUISE, desired_m_s: float = 30.0
) -> tuple[int, float, int]:
    """The ego's next state, acceleration and side."""
    values, codes, *_ = compute_indicators(shot, ROAD, 250.0)
    after, acceleration, side = finite_state(values, codes, LANE_M, state, desired_m_s, CONFIG)
    return after, float(acceleration), side


FENCE = (Car(0.0, LEFT), Car(0.0, RIGHT))
"""A vehicle alongside on each side."""


def test_alone_it_cruises_towards_its_desired_speed() -> None:
    assert decide(snapshot()) == (CRUISE, 2.0, 0)  # 0.6 (30 - 20) = 6, but 2 at most
    assert decide(snapshot(), desired_m_s=21.0) == (CRUISE, pytest.approx(0.6), 0)
    assert decide(snapshot(), desired_m_s=19.0) == (CRUISE, pytest.approx(-0.6), 0)


@pytest.mark.parametrize(
    ("before", "gap_m", "after"),
    [
        (CRUISE, 42.6, CRUISE),  # 2.5 + 2 s * 20 m/s
        (CRUISE, 42.4, FOLLOW),
        (FOLLOW, 42.6, FOLLOW),  # it stays behind until 2.5 + 3 s * 20 m/s
        (FOLLOW, 62.4, FOLLOW),
        (FOLLOW, 62.6, CRUISE),
        (LANE_CHANGE, 50.0, FOLLOW),
    ],
)
def test_it_follows_from_2_s_on_and_cruises_again_from_3_s_on(
    before: int, gap_m: float, after: int
) -> None:
    assert decide(snapshot(ahead(gap_m), *FENCE), before)[0] is after


@pytest.mark.parametrize(
    ("gap_m", "speed_m_s", "acceleration_m_s2"),
    [
        (26.5, 20.0, 0.0),  # 2.5 + 1.2 s * 20 m/s: where it wants to be
        (36.5, 20.0, 1.0),  # 0.1 for each metre more
        (26.5, 18.0, -1.2),  # 0.6 for each m/s
        (20.5, 19.0, -1.2),
        (10.0, 10.0, -4.0),  # never harder
        (26.5, 30.0, 2.0),
    ],
)
def test_following_it_keeps_1_2_s(gap_m: float, speed_m_s: float, acceleration_m_s2: float) -> None:
    state, acceleration, side = decide(snapshot(ahead(gap_m, speed_m_s=speed_m_s), *FENCE))
    assert (state, side) == (FOLLOW, 0)
    assert acceleration == pytest.approx(acceleration_m_s2)


def test_behind_a_slow_vehicle_it_changes_to_the_left_where_both_sides_are_free() -> None:
    slow = ahead(30.0, speed_m_s=18.0)
    assert decide(snapshot(slow))[::2] == (LANE_CHANGE, 1)
    assert decide(snapshot(slow, Car(0.0, LEFT)))[::2] == (LANE_CHANGE, -1)
    assert decide(snapshot(slow, *FENCE))[::2] == (FOLLOW, 0)
    assert decide(snapshot(slow), desired_m_s=18.9)[::2] == (FOLLOW, 0)  # not slow for that one
    assert decide(snapshot(ahead(45.0, speed_m_s=18.0)))[::2] == (CRUISE, 0)  # not held up yet


def test_at_the_edge_of_the_road_it_changes_to_the_side_that_is_there() -> None:
    assert decide(snapshot(ahead(30.0, LEFT, 18.0), y_m=LEFT))[2] == -1
    assert decide(snapshot(ahead(30.0, RIGHT, 18.0), y_m=RIGHT))[2] == 1


@pytest.mark.parametrize(
    ("other", "side"),
    [
        (ahead(30.0, LEFT, 18.9), 0),  # 0.9 m/s faster than the one ahead is not worth it
        (ahead(30.0, LEFT, 19.1), 1),
        (ahead(62.6, LEFT, 17.0), 1),  # slower, but further than 3 s
        (behind(14.1, LEFT, 22.0), 1),  # 8 m + 3 s * 2 m/s
        (behind(13.9, LEFT, 22.0), 0),
        (behind(8.1, LEFT, 12.0), 1),  # falling behind: 8 m are enough, and needed
        (behind(7.9, LEFT, 12.0), 0),
        (ahead(8.1, LEFT, 26.0), 1),
        (ahead(7.9, LEFT, 26.0), 0),
    ],
)
def test_the_other_lane_must_be_worth_it_and_have_the_gaps(other: Car, side: int) -> None:
    shut = Car(0.0, RIGHT)
    assert decide(snapshot(ahead(30.0, speed_m_s=18.0), other, shut))[2] == side


def test_the_faster_of_two_lanes_is_taken() -> None:
    slow = ahead(30.0, speed_m_s=15.0)
    left, right = ahead(40.0, LEFT, 22.0), ahead(40.0, RIGHT, 23.0)
    assert decide(snapshot(slow, left, right))[2] == -1
    assert decide(snapshot(slow, left, right._replace(speed_m_s=21.0)))[2] == 1


@pytest.mark.parametrize("y_m", [CENTER + 0.76, CENTER + 1.52])
def test_changing_lanes_it_minds_the_vehicles_ahead_in_both_and_asks_for_nothing_more(
    y_m: float,
) -> None:
    # alone ahead in one of the two lanes, at its speed: 0.1 (16.5 - 26.5) = -1
    for lane_m in (CENTER, LEFT):
        state, acceleration, side = decide(snapshot(ahead(16.5, lane_m), y_m=y_m), LANE_CHANGE)
        assert (state, side) == (LANE_CHANGE, 0)
        assert acceleration == pytest.approx(-1.0)
    decoy = snapshot(ahead(16.5, RIGHT), y_m=y_m)
    assert decide(decoy, LANE_CHANGE) == (LANE_CHANGE, 2.0, 0)


def test_past_the_middle_it_still_minds_the_lane_that_it_leaves() -> None:
    # 0.76 m right of the left lane's centre, its body in both
    shot = snapshot(ahead(16.5, CENTER), y_m=LEFT - 0.76)
    assert decide(shot, LANE_CHANGE) == (LANE_CHANGE, pytest.approx(-1.0), 0)


def test_a_lane_change_that_sumo_did_not_begin_is_given_up() -> None:
    blocked = snapshot(ahead(30.0, speed_m_s=18.0), *FENCE)
    assert decide(blocked, LANE_CHANGE)[::2] == (FOLLOW, 0)


@given(scenes())
def test_wherever_it_is_it_stays_within_its_bounds_and_on_the_road(world: Scene) -> None:
    for state in (CRUISE, FOLLOW, LANE_CHANGE):
        _, acceleration, side = decide(world.snapshot, state, 25.0)
        assert abs(acceleration + 1) <= 3
        assert 0 <= ROAD.lane_of(float(world.snapshot.y_m[0])) + side <= 2
