"""The 27 indicators: what the ego knows of the road around it."""

import numpy as np
import pytest
from hypothesis import given
from worlds import (
    ACROSS_THE_SEAM,
    ALONE,
    BARRICADED_ROAD,
    CENTER,
    LEFT,
    LONG_ROAD,
    RIGHT,
    ROAD,
    Car,
    ahead,
    behind,
    scene,
    scenes,
)

from drl_av.config import ObservationConfig
from drl_av.driving.affordances import INDICATORS
from drl_av.driving.observation_scale import ObservationScale
from drl_av.driving.scene import Scene
from drl_av.road.road import Road

SLOTS = ("own_front", "own_rear", "right_front", "right_rear", "left_front", "left_rear")
PAPER_ORDER = [f"{slot}_{state}" for slot in SLOTS for state in ("d_x", "v_x", "d_y", "v_y")]
PAPER_ORDER += ["ego_v_x", "ego_d_y", "ego_v_y"]


def indicator(seen: Scene, name: str) -> float:
    return float(seen.indicators.values[PAPER_ORDER.index(name)])


def slot(seen: Scene, name: str) -> list[float]:
    """d_x, v_x, d_y, v_y of one slot."""
    return [indicator(seen, f"{name}_{state}") for state in ("d_x", "v_x", "d_y", "v_y")]


def test_there_are_27_in_the_order_of_the_contract() -> None:
    assert list(INDICATORS) == PAPER_ORDER
    assert len(ALONE.indicators.values) == 30


def test_six_vehicles_and_the_ego_fill_the_vector_each_in_its_place() -> None:
    seen = scene(
        behind(60, LEFT, 31.0),
        ahead(50, LEFT, 26.0, v_y=-0.76),
        behind(40, RIGHT, 19.0),
        ahead(30, RIGHT, 18.0),
        behind(20, CENTER, 24.0, v_y=0.5),
        ahead(10, CENTER, 17.0),
        speed_m_s=22.0,
        v_y=0.25,
    )
    assert seen.indicators.values[:27] == pytest.approx(
        [
            *(10, -5, 0, -0.25),
            *(20, 2, 0, 0.25),
            *(30, -4, -3.8, -0.25),
            *(40, -3, -3.8, -0.25),
            *(50, 4, 3.8, -1.01),
            *(60, 9, 3.8, -0.25),
            *(22, 3.8, 0.25),
        ]
    )


def test_the_nearest_vehicle_of_a_lane_is_meant_not_the_first_listed_nor_the_slowest() -> None:
    seen = scene(ahead(80, speed_m_s=1.0), ahead(30, speed_m_s=21.0), ahead(50))
    assert slot(seen, "own_front") == [30, 1, 0, 0]


def test_nearest_is_by_bumper_not_by_centre() -> None:
    truck = Car(30.0, length_m=20.0)  # centre at 30 m, rear bumper 17.5 m ahead
    car = Car(25.0)  # centre at 25 m, rear bumper 20 m ahead
    assert indicator(scene(car, truck), "own_front_d_x") == 17.5


def test_a_vehicle_straddling_two_lanes_is_seen_in_both() -> None:
    seen = scene(ahead(20, y_m=1.9))  # on the line between right and centre
    assert slot(seen, "own_front") == pytest.approx([20, 0, -1.9, 0])
    assert slot(seen, "right_front") == pytest.approx([20, 0, -1.9, 0])
    assert seen.affordances.left_front is None


@pytest.mark.parametrize(
    ("y_m", "in_center", "in_left"),
    [
        (CENTER + 0.99, True, False),  # left side at 5.69, the line at 5.7
        (CENTER + 1.01, True, True),
        (CENTER + 2.79, True, True),  # its centre is over the line, its right side is not
        (CENTER + 2.81, False, True),
    ],
)
def test_a_body_of_1_8_m_occupies_the_lanes_that_it_overlaps(
    y_m: float, in_center: bool, in_left: bool
) -> None:
    seen = scene(ahead(20, y_m))
    assert (seen.affordances.own_front is not None) is in_center
    assert (seen.affordances.left_front is not None) is in_left


def test_the_lane_of_the_ego_is_the_one_its_centre_is_in_and_the_others_follow() -> None:
    others = (ahead(10, RIGHT), ahead(20, CENTER), ahead(30, LEFT))
    before = scene(*others, y_m=1.52, v_y=0.76)  # 2 s into a change from the right lane
    assert before.affordances.lane == 0
    assert slot(before, "own_front") == pytest.approx([10, 0, -1.52, -0.76])
    assert slot(before, "left_front") == pytest.approx([20, 0, 2.28, -0.76])
    after = scene(*others, y_m=2.28, v_y=0.76)  # 3 s
    assert after.affordances.lane == 1
    assert slot(after, "right_front") == pytest.approx([10, 0, -2.28, -0.76])
    assert slot(after, "own_front") == pytest.approx([20, 0, 1.52, -0.76])
    assert slot(after, "left_front") == pytest.approx([30, 0, 5.32, -0.76])


def test_gaps_are_right_across_the_seam_of_the_loop() -> None:
    assert slot(ACROSS_THE_SEAM, "own_front") == [5, 0, 0, 0]
    assert slot(ACROSS_THE_SEAM, "own_rear") == [9, 0, 0, 0]
    seen = scene(behind(5.0), ahead(9.0), s_m=2.0)
    assert indicator(seen, "own_rear_d_x") == 5
    assert indicator(seen, "own_front_d_x") == 9


def test_a_vehicle_is_ahead_or_behind_by_the_shorter_way_and_never_both() -> None:
    ahead_by_240 = scene(Car(240.0))
    assert indicator(ahead_by_240, "own_front_d_x") == 235
    assert ahead_by_240.affordances.own_rear is None  # not 255 - 5 behind
    behind_by_240 = scene(Car(260.0))
    assert indicator(behind_by_240, "own_rear_d_x") == 235
    assert behind_by_240.affordances.own_front is None


@given(scenes())
def test_no_vehicle_fills_both_ends_of_a_lane_and_no_gap_is_negative(world: Scene) -> None:
    for sign in (0, 1, -1):
        front, rear = world.affordances.front(sign), world.affordances.rear(sign)
        for neighbor in (front, rear):
            assert neighbor is None or 0 <= neighbor.gap_m <= 245
        if front is not None and rear is not None:
            assert front.vehicle != rear.vehicle
    assert (world.indicators.values[0:24:4] >= 0).all()


@pytest.mark.parametrize("offset_m", [0.0, 2.0, 4.99])
def test_a_vehicle_alongside_has_no_gap_not_a_negative_one(offset_m: float) -> None:
    assert slot(scene(Car(offset_m, LEFT, 23.0)), "left_front") == [0, 3, 3.8, 0]


def test_a_vehicle_alongside_is_behind_where_its_centre_is() -> None:
    seen = scene(Car(-0.5, LEFT, 23.0))
    assert seen.affordances.left_front is None
    assert slot(seen, "left_rear") == [0, 3, 3.8, 0]


def test_a_missing_vehicle_is_250_m_away_at_the_ego_speed_in_the_centre_of_its_lane() -> None:
    seen = scene(y_m=3.8 + 0.76, v_y=0.76, speed_m_s=25.0)
    expected = [
        *(250, 0, -0.76, 0) * 2,
        *(250, 0, -4.56, 0) * 2,
        *(250, 0, 3.04, 0) * 2,
        *(25, 4.56, 0.76),
    ]
    assert seen.indicators.values[:27] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("y_m", "road", "missing", "there"),
    [
        (RIGHT, ROAD, "right", "left"),
        (LEFT, ROAD, "left", "right"),
        (CENTER, BARRICADED_ROAD, "right", "left"),
    ],
    ids=["off the right edge", "off the left edge", "barricaded"],
)
def test_a_lane_that_is_none_has_no_gap_where_an_empty_one_has_250_m(
    y_m: float, road: Road, missing: str, there: str
) -> None:
    seen = scene(y_m=y_m, road=road)
    offset_m = 3.8 if missing == "left" else -3.8
    for end in ("front", "rear"):
        assert slot(seen, f"{missing}_{end}") == pytest.approx([0, 0, offset_m, 0])
        assert slot(seen, f"{there}_{end}") == pytest.approx([250, 0, -offset_m, 0])


def test_the_range_is_250_m_of_net_gap() -> None:
    at_250 = scene(ahead(250.0, speed_m_s=1.0), road=LONG_ROAD)
    assert slot(at_250, "own_front") == [250, -19, 0, 0]
    beyond = scene(ahead(250.5, speed_m_s=1.0), behind(251.0), road=LONG_ROAD)
    assert beyond.affordances.own_front is None
    assert beyond.affordances.own_rear is None
    assert slot(beyond, "own_front") == [250, 0, 0, 0]


def test_a_shorter_range_fills_in_its_own_length() -> None:
    seen = scene(ahead(101.0), range_m=100.0)
    assert indicator(seen, "own_front_d_x") == 100


def test_observation_is_scaled_by_the_documented_constants() -> None:
    scale = ObservationScale(ObservationConfig(), 30.0, ROAD)
    seen = scene(ahead(50, speed_m_s=15.0), behind(10, LEFT, v_y=-0.76), y_m=CENTER)
    observed = scale(seen.indicators.values[:27])
    assert observed.dtype == np.float32
    assert observed[:4] == pytest.approx([0.5, -0.5, 0, 0])
    assert observed[4:8] == pytest.approx([2.5, 0, 0, 0])
    assert observed[20:24] == pytest.approx([0.1, 0, 1, -1])
    assert observed[24:] == pytest.approx([1 / 3, 0, 0], abs=1e-6)  # 20 of 0 to 30 m/s


@given(scenes())
def test_every_observation_lies_in_the_box(world: Scene) -> None:
    scale = ObservationScale(ObservationConfig(), 30.0, ROAD)
    observed = scale(world.indicators.values[:27])
    assert (np.abs(observed) <= scale.bounds).all()
    assert np.isfinite(scale.bounds).all()
    assert (scale.bounds > 0).all()
