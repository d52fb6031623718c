"""Bodies that touch while they move: found in each SUMO step, and who hit whom.

A step takes 0.5 s where nothing else is said; bodies are 5 m by 1.8 m, lanes 3.8 m apart.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import CARS, CENTER, LEFT, LENGTH_M, RIGHT, ROAD, WIDTH_M, Car, ahead, behind, snapshot

from drl_av.road.road import Road
from drl_av.road.snapshot import Collision, CollisionKind, Command, Snapshot
from drl_av.road.sweep import (
    KINDS,
    LATERAL_SPEED_M_S,
    NO_CONTACT,
    contact,
    moved,
    swept_collision,
    within_reach,
)
from verification.auditor import touching

STEP_S = 0.5
SMALL_ROAD = Road(100.0, 3.8, (True, True, True))


def after(shot: Snapshot, road: Road = ROAD, step_s: float = STEP_S) -> Snapshot:
    """The snapshot after a step at the speeds of the snapshot."""
    s_m = (shot.s_m + shot.speed_m_s * step_s) % road.lap_m
    return shot._replace(s_m=s_m, y_m=shot.y_m + shot.lateral_speed_m_s * step_s)


def collision(shot: Snapshot, road: Road = ROAD, step_s: float = STEP_S) -> Collision | None:
    """The ego's collision in the step that begins at a snapshot."""
    *before, _, _, length_m, width_m = shot.arrays
    now = after(shot, road, step_s).arrays[:2]
    row, kind, _ = swept_collision(*before, *now, length_m, width_m, road.lap_m)
    return None if kind == NO_CONTACT else Collision(KINDS[kind], shot.ids[row])


def kind(shot: Snapshot, road: Road = ROAD, step_s: float = STEP_S) -> CollisionKind | None:
    found = collision(shot, road, step_s)
    return None if found is None else found.kind


# Lengthwise


def test_ego_at_30_comes_right_through_a_standing_vehicle_within_a_step() -> None:
    # it moves 15 m: from 4 m behind, bumper to bumper, to 1 m before the other's front bumper
    found = collision(snapshot(ahead(4.0, speed_m_s=0.0), speed_m_s=30.0))
    assert found == Collision(CollisionKind.HIT_AHEAD, "vehicle1")


def test_a_vehicle_at_30_comes_right_through_the_standing_ego() -> None:
    found = collision(snapshot(behind(4.0, speed_m_s=30.0), speed_m_s=0.0))
    assert found == Collision(CollisionKind.HIT_FROM_BEHIND, "vehicle1")


def test_20_m_s_faster_ego_touches_one_9_99_m_ahead_within_half_a_second_and_none_at_10_m() -> None:
    assert kind(snapshot(ahead(9.99, speed_m_s=10.0), speed_m_s=30.0)) is CollisionKind.HIT_AHEAD
    assert kind(snapshot(ahead(10.0, speed_m_s=10.0), speed_m_s=30.0)) is None


def test_whom_the_ego_passes_in_the_next_lane_it_does_not_touch() -> None:
    assert kind(snapshot(ahead(4.0, LEFT, 0.0), speed_m_s=30.0)) is None
    assert kind(snapshot(behind(4.0, RIGHT, 30.0), speed_m_s=0.0)) is None


def test_a_follower_as_fast_as_the_ego_never_touches_it() -> None:
    assert kind(snapshot(behind(0.0), ahead(0.0))) is None


# Sideways


@pytest.mark.parametrize("side", [1, -1], ids=["left", "right"])
@pytest.mark.parametrize("offset_m", [-3.0, 0.0, 3.0])
def test_who_moves_into_the_vehicle_at_its_side_hits_it(side: int, offset_m: float) -> None:
    # 2.1 m between the centres; 0.38 m in the step, and 1.8 m are wide
    shot = snapshot(Car(offset_m, CENTER + 2.1 * side), v_y=0.76 * side)
    assert kind(shot) is CollisionKind.HIT_BESIDE
    shot = snapshot(Car(offset_m, CENTER + 2.1 * side, lateral_speed_m_s=-0.76 * side))
    assert kind(shot) is CollisionKind.HIT_FROM_BESIDE


def test_sides_that_end_the_step_1_81_m_apart_do_not_touch_and_1_79_m_do() -> None:
    assert kind(snapshot(Car(1.0, CENTER + 2.19), v_y=0.76)) is None
    assert kind(snapshot(Car(1.0, CENTER + 2.17), v_y=0.76)) is CollisionKind.HIT_BESIDE


def test_ego_that_makes_way_is_hit_by_the_faster_one_behind_its_side() -> None:
    shot = snapshot(Car(0.0, CENTER - 2.0, lateral_speed_m_s=1.5), v_y=0.76)
    assert kind(shot) is CollisionKind.HIT_FROM_BESIDE


def test_ego_that_meets_another_half_way_hit_too() -> None:
    shot = snapshot(Car(0.0, CENTER + 2.4, lateral_speed_m_s=-0.76), v_y=0.76)
    assert kind(shot) is CollisionKind.HIT_BESIDE


# Both at once: 30 m/s past a standing vehicle takes 10 m, from 4 m behind it on 4 / 15 of the step


def test_ego_that_is_clear_of_the_lane_in_time_passes_the_standing_vehicle() -> None:
    # 1.1 m apart sideways and 1.8 m wide; 0.7 m to clear, of which 4 / 15 of the step are over
    for sideways_m_s, found in ((5.3, None), (5.2, CollisionKind.HIT_AHEAD)):
        shot = snapshot(ahead(4.0, CENTER + 1.1, 0.0), speed_m_s=30.0, v_y=-sideways_m_s)
        assert kind(shot) is found  # 5.25 m/s * 0.5 s * 4 / 15 = 0.7 m


def test_ego_that_moves_over_only_once_it_is_past_touches_no_vehicle() -> None:
    # bumper to bumper 5 m of overlap to undo at 20 m/s: half of the step; 2.3 m, 0.5 m to spare
    for sideways_m_s, found in ((1.99, None), (2.01, CollisionKind.HIT_BESIDE)):
        shot = snapshot(Car(0.0, CENTER + 2.3, 0.0), speed_m_s=20.0, v_y=sideways_m_s)
        assert kind(shot) is found


def test_a_tail_hit_while_swerving_away_is_a_rear_end_though_the_step_ends_side_by_side() -> None:
    # after 0.1 m, 5 ms, at 20 m/s; 0.38 m sideways in the whole step from 1.5 m: 1.88 m
    shot = snapshot(ahead(0.1, CENTER + 1.5, 5.0), speed_m_s=25.0, v_y=-0.76)
    assert kind(shot) is CollisionKind.HIT_AHEAD
    shot = snapshot(behind(0.1, CENTER + 1.5, 25.0), speed_m_s=5.0, v_y=-0.76)
    assert kind(shot) is CollisionKind.HIT_FROM_BEHIND


def test_touching_the_side_of_one_who_is_nearly_past_is_no_rear_end() -> None:
    # 4.9 m ahead and 5 m/s faster it is clear after 20 ms, and touched after 13 ms
    shot = snapshot(Car(4.9, CENTER + 1.81, 25.0), v_y=0.76)
    assert kind(shot) is CollisionKind.HIT_BESIDE
    shot = snapshot(Car(-4.9, CENTER + 1.81, 15.0, -0.76))
    assert kind(shot) is CollisionKind.HIT_FROM_BESIDE


# The loop


@pytest.mark.parametrize("s_m", [496.0, 0.5, 2.0])
def test_contact_across_the_seam_of_the_loop_is_found(s_m: float) -> None:
    slow, fast = ahead(4.0, speed_m_s=0.0), behind(4.0, speed_m_s=30.0)
    assert kind(snapshot(slow, s_m=s_m, speed_m_s=30.0)) is CollisionKind.HIT_AHEAD
    assert kind(snapshot(fast, s_m=s_m, speed_m_s=0.0)) is CollisionKind.HIT_FROM_BEHIND
    assert kind(snapshot(ahead(16.0, speed_m_s=0.0), s_m=s_m, speed_m_s=30.0)) is None


def test_on_a_small_loop_the_ego_meets_the_one_that_is_nearer_behind_it() -> None:
    # 100 m round: a truck of 25 m whose centre is 49 m behind is 51 m ahead, 36 m to its rear
    # bumper, of which the ego drives 40 m in a second
    truck = Car(-49.0, CENTER, 0.0, length_m=25.0)
    shot = snapshot(truck, s_m=60.0, speed_m_s=40.0, road=SMALL_ROAD)
    assert kind(shot, SMALL_ROAD, 1.0) is CollisionKind.HIT_AHEAD
    shot = snapshot(truck._replace(offset_m=-45.0), s_m=60.0, speed_m_s=40.0, road=SMALL_ROAD)
    assert kind(shot, SMALL_ROAD, 1.0) is None  # 40 m to its rear bumper


def test_a_standing_vehicle_that_rounding_moves_back_has_not_driven_a_lap() -> None:
    there = moved(499.999, 0.0, 499.999 - 1e-12, 0.0, ROAD.lap_m)
    assert there == pytest.approx((499.999, 0.0, 0.0, 0.0), abs=1e-9)
    assert moved(499.0, 0.0, 14.0, 0.76, ROAD.lap_m) == pytest.approx((499.0, 0.0, 15.0, 0.76))


# Among many


def test_the_one_touched_first_is_named_among_many() -> None:
    shot = snapshot(
        ahead(40.0),
        Car(0.0, LEFT),
        ahead(8.0, speed_m_s=0.0),  # after 8 / 30 s
        behind(1.0, speed_m_s=34.0),  # after 1 / 4 s
        Car(0.0, RIGHT),
        speed_m_s=30.0,
    )
    assert collision(shot) == Collision(CollisionKind.HIT_FROM_BEHIND, "vehicle4")


def test_traffic_that_collides_with_itself_is_no_collision_of_the_ego_and_is_found() -> None:
    shot = snapshot(ahead(40.0, speed_m_s=30.0), ahead(49.0, speed_m_s=0.0), behind(90.0))
    assert collision(shot) is None
    assert touching(shot, after(shot), ROAD) == [("vehicle1", "vehicle2")]


def test_a_long_and_wide_vehicle_is_touched_sooner() -> None:
    # half of 18 m and of 5 m: 11.5 m; half of 2.5 m and of 1.8 m: 2.15 m
    truck = Car(21.4, CENTER, 10.0, length_m=18.0, width_m=2.5)
    assert kind(snapshot(truck, speed_m_s=30.0)) is CollisionKind.HIT_AHEAD
    assert kind(snapshot(truck._replace(offset_m=21.5), speed_m_s=30.0)) is None
    beside = Car(8.0, CENTER + 2.5, 20.0, -0.76, length_m=18.0, width_m=2.5)
    assert kind(snapshot(beside)) is CollisionKind.HIT_FROM_BESIDE
    assert kind(snapshot(beside._replace(width_m=1.8))) is None


@given(CARS, st.floats(0, 40, width=16), st.sampled_from([-0.76, 0.0, 0.76]))
def test_left_and_right_are_distinguished_alike(car: Car, speed: float, v_y: float) -> None:
    mirrored = car._replace(y_m=7.6 - car.y_m, lateral_speed_m_s=-car.lateral_speed_m_s)
    assert collision(snapshot(car, speed_m_s=speed, v_y=v_y)) == collision(
        snapshot(mirrored, speed_m_s=speed, v_y=-v_y)
    )


# Against a slow oracle


def approaches(rng: np.random.Generator, n: int, step_s: float) -> np.ndarray:
    """Rows of ego and other: s, y, speed, lateral speed each; they come near in the step."""
    lap_m = ROAD.lap_m
    speed, lateral = rng.uniform(0, 40, (n, 2)), rng.choice([-0.76, -0.3, 0.0, 0.3, 0.76], (n, 2))
    middle_m = rng.uniform(0, lap_m, n)
    meet_s = rng.uniform(-0.5, 1.5, n) * step_s
    apart_m = rng.uniform(-8, 8, n)
    s_m = middle_m[:, None] + np.column_stack([np.zeros(n), apart_m]) - speed * meet_s[:, None]
    y_m = 3.8 + np.column_stack([np.zeros(n), rng.uniform(-3, 3, n)])
    return np.stack([s_m % lap_m, y_m, speed, lateral], axis=2)


@pytest.mark.parametrize("step_s", [1.0, 0.5, 0.25, 0.1])
def test_of_10_000_random_approaches_exactly_those_that_overlap_on_the_way_are_found(
    step_s: float,
) -> None:
    shares = np.linspace(0.0, 1.0, 2001)
    missed = phantom = met = 0
    for ego, other in approaches(np.random.default_rng(5), 10_000, step_s):
        relative = other - ego
        ahead_m = (relative[0] + 250) % 500 - 250 + relative[2] * step_s * shares
        left_m = relative[1] + relative[3] * step_s * shares
        depth_m = np.minimum(LENGTH_M - np.abs(ahead_m), WIDTH_M - np.abs(left_m)).max()
        one, two = (
            moved(s, y, (s + v * step_s) % 500, y + u * step_s, ROAD.lap_m)
            for s, y, v, u in (ego, other)
        )
        touches = contact(one, two, LENGTH_M, WIDTH_M, ROAD.lap_m)[1] != NO_CONTACT
        met += touches
        missed += not touches and depth_m > 0
        phantom += touches and depth_m < -40 * step_s / 2000
    assert (missed, phantom) == (0, 0)
    assert 2000 < met < 8000


# Who is looked at


@given(
    st.lists(CARS, min_size=1, max_size=8),
    st.floats(0, 499),
    st.floats(0, 30),
    st.sampled_from([-0.76, 0.0, 0.76]),
    st.sampled_from([1, 2, 4]),
)
def test_a_vehicle_that_touches_the_ego_in_a_decision_was_within_its_reach(
    cars: list[Car], s_m: float, speed: float, v_y: float, steps: int
) -> None:
    shot = snapshot(*cars, s_m=s_m, speed_m_s=speed, v_y=v_y)
    step_s = 1.0 / steps
    commands = [Command(speed, CENTER + v_y * step_s * (n + 1), v_y) for n in range(steps)]
    others = range(1, len(shot.ids))
    touched = {row for row in others if collision(shot.of_rows([0, row]), step_s=1.0)}
    assert touched <= set(reached(shot, commands, step_s))


def reached(shot: Snapshot, commands: list[Command], step_s: float) -> list[int]:
    bounds = np.array((shot.length_m.max(), shot.width_m.max(), LATERAL_SPEED_M_S, ROAD.lap_m))
    return within_reach(np.array(shot.arrays[:3]), commands, step_s, bounds)


def test_a_vehicle_that_could_stop_at_once_or_accelerate_hard_is_within_reach() -> None:
    # a decision of two steps: the ego drives 20 m; 10 m/s^2 more are 7.5 m more
    def rows(*cars: Car, y_m: float = CENTER) -> list[int]:
        commands = [Command(20.0, CENTER, 0.0), Command(20.0, y_m, 0.0)]
        return reached(snapshot(*cars), commands, STEP_S)

    assert rows(ahead(19.9), ahead(20.1), behind(7.4), behind(7.6)) == [1, 3]
    assert rows(behind(17.4, speed_m_s=30.0), behind(17.6, speed_m_s=30.0)) == [1]
    assert rows(Car(0.0, LEFT), Car(0.0, LEFT - 0.6), Car(0.0, RIGHT)) == [2]
    assert rows(Car(0.0, LEFT), Car(0.0, RIGHT), y_m=CENTER + 0.76) == [1]
    assert rows(Car(0.0, LEFT), Car(0.0, RIGHT), y_m=CENTER - 0.76) == [2]
    assert rows() == []
