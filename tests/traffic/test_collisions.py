"""The ego hit, or was hit: told from positions and velocities at the first moment of contact."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from worlds import CARS, CENTER, LEFT, LENGTH_M, RIGHT, ROAD, WIDTH_M, Car, snapshot

from drl_av.traffic.collisions import classify, overlapping
from drl_av.traffic.snapshot import Collision, CollisionKind, Snapshot


def kind_of(shot: Snapshot) -> CollisionKind | None:
    collision = overlapping(shot, ROAD)
    return None if collision is None else collision.kind


def test_ego_at_30_runs_into_the_tail_of_a_vehicle_at_10() -> None:
    # centres 4.5 m apart: half a metre of overlap, 25 ms old; side by side they always were
    shot = snapshot(Car(4.5, CENTER, 10.0), speed_m_s=30.0)
    assert overlapping(shot, ROAD) == Collision(CollisionKind.HIT_AHEAD, "vehicle1")


def test_ego_at_10_is_run_into_from_behind() -> None:
    shot = snapshot(Car(-4.5, CENTER, 30.0), speed_m_s=10.0)
    assert overlapping(shot, ROAD) == Collision(CollisionKind.HIT_FROM_BEHIND, "vehicle1")


def test_bumpers_may_come_close_but_5_m_between_centres_is_no_collision() -> None:
    assert kind_of(snapshot(Car(5.0, CENTER, 10.0), speed_m_s=30.0)) is None
    assert kind_of(snapshot(Car(4.99, CENTER, 10.0), speed_m_s=30.0)) is CollisionKind.HIT_AHEAD


def test_sides_may_come_close_but_1_8_m_between_centres_is_no_collision() -> None:
    assert kind_of(snapshot(Car(1.0, CENTER + 1.81), v_y=0.76)) is None
    assert kind_of(snapshot(Car(1.0, CENTER + 1.79), v_y=0.76)) is CollisionKind.HIT_BESIDE


@pytest.mark.parametrize("side", [1, -1], ids=["left", "right"])
@pytest.mark.parametrize("offset_m", [-3.0, 0.0, 3.0])
def test_ego_swipes_the_vehicle_at_its_side(side: int, offset_m: float) -> None:
    shot = snapshot(Car(offset_m, CENTER + 1.6 * side), v_y=0.76 * side)
    assert kind_of(shot) is CollisionKind.HIT_BESIDE


@pytest.mark.parametrize("side", [1, -1], ids=["left", "right"])
@pytest.mark.parametrize("offset_m", [-3.0, 0.0, 3.0])
def test_ego_in_its_lane_is_swiped_from_the_side(side: int, offset_m: float) -> None:
    shot = snapshot(Car(offset_m, CENTER + 1.6 * side, lateral_speed_m_s=-0.76 * side))
    assert kind_of(shot) is CollisionKind.HIT_FROM_BESIDE


def test_ego_that_makes_way_is_swiped_by_the_faster_one_and_does_not_swipe() -> None:
    shot = snapshot(Car(0.0, CENTER - 1.6, lateral_speed_m_s=1.5), v_y=0.76)
    assert kind_of(shot) is CollisionKind.HIT_FROM_BESIDE


def test_ego_that_meets_another_in_the_middle_hit_too() -> None:
    shot = snapshot(Car(0.0, CENTER + 1.6, lateral_speed_m_s=-0.76), v_y=0.76)
    assert kind_of(shot) is CollisionKind.HIT_BESIDE


def test_rear_end_during_a_lane_change_is_still_a_rear_end() -> None:
    # 0.2 m of length overlap at 20 m/s is 10 ms old, 1.3 m sideways at 0.76 m/s 1.7 s
    shot = snapshot(Car(4.8, CENTER + 0.5, 5.0), speed_m_s=25.0, v_y=0.76)
    assert kind_of(shot) is CollisionKind.HIT_AHEAD


def test_one_so_fast_that_a_sumo_step_brings_it_past_the_middle_of_the_ego_hit_from_behind() -> (
    None
):
    # at 25.5 m/s it moves 12.75 m in half a second: 12 m behind before, 0.75 m ahead after
    shot = snapshot(Car(0.75, CENTER, 25.5), speed_m_s=0.0)
    assert kind_of(shot) is CollisionKind.HIT_FROM_BEHIND
    shot = snapshot(Car(-0.75, CENTER, 0.0), speed_m_s=25.5)
    assert kind_of(shot) is CollisionKind.HIT_AHEAD


def test_a_tail_hit_while_swerving_away_is_a_rear_end_though_the_step_ends_side_by_side() -> None:
    # SUMO moves forward, finds the contact, then moves sideways: 1.9 m apart in the end
    shot = snapshot(Car(4.6, CENTER + 1.9, 7.0), speed_m_s=22.5, v_y=-0.76)
    assert classify(shot, ROAD, 1).kind is CollisionKind.HIT_AHEAD
    shot = snapshot(Car(-4.6, CENTER + 1.9, 22.5), speed_m_s=7.0, v_y=-0.76)
    assert classify(shot, ROAD, 1).kind is CollisionKind.HIT_FROM_BEHIND


def test_touching_the_side_of_one_who_is_nearly_past_is_no_rear_end() -> None:
    # 4.9 m ahead and 5 m/s faster: lengthwise they have overlapped for 9.9 m, 2 s
    assert kind_of(snapshot(Car(4.9, CENTER + 1.7, 25.0), v_y=0.76)) is CollisionKind.HIT_BESIDE
    other = Car(-4.9, CENTER + 1.7, 15.0, -0.76)
    assert kind_of(snapshot(other)) is CollisionKind.HIT_FROM_BESIDE


def test_side_swipe_while_overtaking_is_still_a_side_swipe() -> None:
    # 0.1 m sideways at 0.76 m/s is 0.13 s old, 4 m of length overlap at 5 m/s 0.8 s
    shot = snapshot(Car(1.0, CENTER + 1.7, 15.0), v_y=0.76)
    assert kind_of(shot) is CollisionKind.HIT_BESIDE


@pytest.mark.parametrize(("s_m", "offset_m"), [(499.0, 4.0), (1.0, -4.0), (1.0, 4.0)])
def test_contact_across_the_seam_of_the_loop_is_found(s_m: float, offset_m: float) -> None:
    shot = snapshot(Car(offset_m, CENTER, 20.0 - offset_m), s_m=s_m)
    front, rear = CollisionKind.HIT_AHEAD, CollisionKind.HIT_FROM_BEHIND
    assert kind_of(shot) is (front if offset_m > 0 else rear)


def test_the_one_touched_is_named_among_many() -> None:
    shot = snapshot(Car(40.0), Car(0.0, LEFT), Car(-4.0, CENTER, 30.0), Car(0.0, RIGHT))
    assert overlapping(shot, ROAD) == Collision(CollisionKind.HIT_FROM_BEHIND, "vehicle3")


def test_traffic_that_collides_with_itself_is_no_collision_of_the_ego() -> None:
    assert kind_of(snapshot(Car(40.0), Car(41.0))) is None


def test_a_long_and_wide_vehicle_is_touched_sooner() -> None:
    truck = Car(10.0, CENTER, 10.0, length_m=18.0, width_m=2.5)
    assert kind_of(snapshot(truck, speed_m_s=30.0)) is CollisionKind.HIT_AHEAD
    beside = truck._replace(y_m=CENTER + 2.1, lateral_speed_m_s=-0.76, speed_m_s=20.0)
    assert kind_of(snapshot(beside)) is CollisionKind.HIT_FROM_BESIDE


def test_ego_hit_names_the_three_kinds_that_are_its_doing() -> None:
    guilty = {kind for kind in CollisionKind if kind.ego_hit}
    assert guilty == {
        CollisionKind.HIT_AHEAD,
        CollisionKind.HIT_BESIDE,
        CollisionKind.HIT_EDGE,
    }


@given(st.lists(CARS, min_size=1, max_size=8), st.floats(0, 499))
def test_a_collision_is_found_exactly_where_two_rectangles_overlap(
    cars: list[Car], s_m: float
) -> None:
    assume(all(abs(abs(car.offset_m) - LENGTH_M) > 1e-6 for car in cars))
    touching = {
        f"vehicle{row}"
        for row, car in enumerate(cars, 1)
        if abs(car.offset_m) < LENGTH_M and abs(car.y_m - CENTER) < WIDTH_M
    }
    collision = overlapping(snapshot(*cars, s_m=s_m), ROAD)
    assert collision.other in touching if collision else not touching


@given(CARS, st.floats(0, 40, width=16), st.sampled_from([-0.76, 0.0, 0.76]))
def test_left_and_right_are_told_apart_alike(car: Car, speed: float, v_y: float) -> None:
    mirrored = car._replace(y_m=7.6 - car.y_m, lateral_speed_m_s=-car.lateral_speed_m_s)
    affordances = classify(snapshot(car, speed_m_s=speed, v_y=v_y), ROAD, 1)
    in_a_mirror = classify(snapshot(mirrored, speed_m_s=speed, v_y=-v_y), ROAD, 1)
    assert affordances == in_a_mirror
