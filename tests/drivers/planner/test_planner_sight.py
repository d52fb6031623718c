"""What the planner sees of the other vehicles, and what it guesses about them."""

import numpy as np
import pytest
from worlds import LEFT, RIGHT, Car, ahead, behind, scene

from drl_av.drivers.planner.others import Others, idm, others_of
from drl_av.drivers.planner.parameter_estimator import Ahead, ParameterEstimator
from drl_av.road.road import FloatArray


def seen(*cars: Car) -> Others:
    world = scene(*cars)
    return others_of(world.snapshot, world.affordances, 3)


def gap_m(others: Others) -> FloatArray:
    lanes = others.now
    return others.x_m[lanes.leader] - others.x_m + lanes.offset_m


def test_each_vehicle_has_the_next_one_of_its_lane_as_leader_round_the_loop() -> None:
    others = seen(ahead(30.0), ahead(80.0), ahead(50.0, LEFT), behind(40.0))
    # bumper to bumper: 80 - 30 - 5; round the loop of 500 m: 500 - 85 - 45 - 5; a lap less 5 m
    assert others.now.leader[[0, 1, 3]].tolist() == [1, 3, 0]
    assert gap_m(others)[[0, 1]] == pytest.approx([45.0, 365.0])
    assert gap_m(others)[3] == pytest.approx(45.0 + 35.0 - 5.0)
    assert gap_m(others)[2] > 1e5  # alone in its lane


def test_a_vehicle_that_changes_lanes_is_in_both_and_later_in_its_target_lane() -> None:
    others = seen(ahead(30.0, 1.5, v_y=0.76), ahead(60.0, RIGHT), ahead(40.0, 1.5))
    assert others.now.member.T.tolist() == [
        [True, True, False],
        [True, False, False],
        [True, True, False],  # its body is over the line
    ]
    assert others.later.member.T.tolist() == [
        [False, True, False],
        [True, False, False],
        [True, False, False],
    ]


def test_a_vehicle_on_a_free_road_shows_its_desired_speed() -> None:
    others = seen(ahead(100.0, speed_m_s=22.0))
    watcher = ParameterEstimator(others)
    assert watcher.desired_m_s == pytest.approx(26.0)  # nothing is known of it
    for _ in range(8):
        watcher.observe(others, Ahead(np.array([1e6]), np.array([0.0])), 1.0)
    assert watcher.desired_m_s == pytest.approx(22.0, abs=0.1)


def test_a_vehicle_that_accelerates_on_a_free_road_wants_to_be_faster() -> None:
    watcher = ParameterEstimator(seen(ahead(100.0, speed_m_s=19.0)))
    # 0.5 m/s in a second of 1.5 m/s^2: 20 / (1 - 1 / 3) ** 0.25, about 22.1; its mean with nothing
    others = seen(ahead(100.0, speed_m_s=19.5))
    watcher.observe(others, Ahead(np.array([1e6]), np.array([0.0])), 1.0)
    assert watcher.desired_m_s == pytest.approx(19.5 / (2 / 3) ** 0.25)


def test_a_vehicle_in_a_queue_shows_the_headway_with_which_idm_keeps_its_gap() -> None:
    others = seen(ahead(100.0))
    watcher, queue = ParameterEstimator(others), Ahead(np.array([18.0]), np.array([0.0]))
    for _ in range(30):
        watcher.observe(others, queue, 1.0)
    speed = others.speed_m_s
    rate = idm(speed, watcher.desired_m_s, watcher.headway_s, queue.gap_m, queue.closing_m_s)
    assert rate == pytest.approx([0.0], abs=1e-3)
    assert 0.4 < watcher.headway_s[0] < 1.1


def test_estimates_belong_to_vehicles_that_enter_and_leave_the_road() -> None:
    others = seen(ahead(100.0, speed_m_s=22.0), ahead(100.0, LEFT, 24.0))
    free = Ahead(np.full(2, 1e6), np.zeros(2))
    watcher = ParameterEstimator(others._replace(ids=("a", "b")))
    for _ in range(8):
        watcher.observe(others._replace(ids=("a", "b")), free, 1.0)
    later = seen(ahead(100.0, LEFT, 25.0), ahead(50.0, RIGHT, 30.0))
    watcher.observe(later._replace(ids=("b", "c")), free, 1.0)  # a has left, c has entered
    # b accelerates: the fifth part of an observation of 25 / (1 - 1 / 1.5) ** 0.25, which is 32.9
    assert watcher.desired_m_s == pytest.approx([24 + (32.9 - 24) / 5, 30.0], abs=0.1)
