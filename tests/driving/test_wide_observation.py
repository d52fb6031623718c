"""The wide observation: five lanes, in each four vehicles ahead and two behind."""

import math

import numpy as np
import pytest
from hypothesis import given
from worlds import CENTER, LEFT, RIGHT, ROAD, Car, ahead, behind, scene, scenes

from drl_av.driving.scene import LaneChange, Scene
from drl_av.driving.wide_observation import (
    WIDE_NAMES,
    WIDE_SIZE,
    observe_wide,
    scratch,
    wide_observation,
)
from drl_av.road.road import Road, road_numbers

FARTHEST = math.log(1 + 250 / 5)


def observed(seen: Scene, road: Road = ROAD) -> dict[str, float]:
    values = observe_wide(seen.snapshot, road, 250.0, 30.0, seen.lanes)
    return dict(zip(WIDE_NAMES, values.tolist(), strict=True))


def slot(values: dict[str, float], name: str) -> list[float]:
    """Net gap in metres, relative speed and speed in m/s, and lateral offset in lane widths."""
    gap, v_x, d_y, speed = (values[f"{name}_{state}"] for state in ("gap", "v_x", "d_y", "speed"))
    return [5 * (math.exp(gap * FARTHEST) - 1), 10 * v_x, d_y, 20 + 10 * speed]


def test_each_vehicle_is_in_the_place_of_its_lane_and_rank() -> None:
    cars = [
        *(ahead(gap_m, CENTER, speed) for gap_m, speed in ((90, 13), (30, 11), (60, 12))),
        *(ahead(gap_m, CENTER, speed) for gap_m, speed in ((150, 15), (120, 14))),
        *(behind(gap_m, RIGHT, speed) for gap_m, speed in ((70, 25), (20, 24), (99, 26))),
        ahead(40, LEFT, 28.0),
    ]
    values = observed(scene(*cars, speed_m_s=22.0))
    for rank, (gap_m, speed) in enumerate(((30, 11), (60, 12), (90, 13), (120, 14)), start=1):
        assert slot(values, f"own_front_{rank}") == pytest.approx(
            [gap_m, speed - 22, 0, speed], abs=1e-3
        )
    assert slot(values, "right_rear_1") == pytest.approx([20, 2, 0, 24], abs=1e-3)
    assert slot(values, "right_rear_2") == pytest.approx([70, 3, 0, 25], abs=1e-3)
    assert slot(values, "left_front_1") == pytest.approx([40, 6, 0, 28], abs=1e-3)
    # nobody there: one out of range that drives 30 m/s
    assert slot(values, "left_front_2") == pytest.approx([250, 8, 0, 30], abs=1e-2)


def test_a_body_on_a_line_is_in_both_lanes_and_its_offset_tells_so() -> None:
    values = observed(scene(ahead(25, 1.9, 18.0, v_y=0.76)))
    assert slot(values, "own_front_1") == pytest.approx([25, -2, -0.5, 18], abs=1e-3)
    assert slot(values, "right_front_1") == pytest.approx([25, -2, 0.5, 18], abs=1e-3)
    assert values["left_front_1_gap"] == 1.0


def test_a_lane_beyond_the_road_is_a_wall_and_the_flags_say_which_exist() -> None:
    values = observed(scene(y_m=RIGHT, speed_m_s=25.0))
    assert slot(values, "right_front_1") == pytest.approx([0, -25, 0, 0], abs=1e-3)
    assert slot(values, "left_2_rear_2") == pytest.approx([250, 5, 0, 30], abs=1e-2)
    flags = ("lane_right", "lane_left", "lane_right_2", "lane_left_2")
    assert [values[f"ego_{flag}"] for flag in flags] == [0, 1, 0, 1]


def test_the_ego_knows_its_speed_its_place_and_its_lane_change() -> None:
    ego = {"y_m": CENTER - 0.76, "v_y": -0.76, "speed_m_s": 27.0}
    values = observed(scene(**ego, lane_change=LaneChange(1, 0)))
    states = ("speed", "d_y", "v_y", "lane_change", "lane_change_rest")
    assert [values[f"ego_{state}"] for state in states] == pytest.approx([0.7, -0.2, -1, -1, -0.8])
    # without lanes that end there is no way to go
    way = ("lane_end", "way_changes", "way_distance")
    assert [values[f"ego_{name}"] for name in way] == [1, 0, 1]


def test_a_vehicle_farther_than_half_a_lap_ahead_is_behind() -> None:
    values = observed(scene(Car(260.0, CENTER, 21.0)))
    assert values["own_front_1_gap"] == 1.0
    assert slot(values, "own_rear_1") == pytest.approx([235, 1, 0, 21], abs=1e-2)


@given(seen=scenes())
def test_the_nearest_vehicles_are_those_of_the_paper_s_indicators(seen: Scene) -> None:
    values, affordances = observed(seen), seen.affordances
    for place, lane in (("front", 0), ("rear", 1)):
        for name, slots in (("own", 0), ("right", 2), ("left", 4)):
            neighbor = affordances[slots + lane]
            if neighbor is not None:
                gap_m, v_x, _, _ = slot(values, f"{name}_{place}_1")
                assert gap_m == pytest.approx(neighbor.gap_m, rel=1e-3, abs=1e-3)
                assert v_x == pytest.approx(neighbor.relative_speed_m_s, abs=1e-3)


@given(seen=scenes())
def test_compiled_and_plain_python_give_the_same_bytes(seen: Scene) -> None:
    plain = np.zeros(WIDE_SIZE, np.float32)
    wide_observation.python(
        seen.snapshot.arrays, road_numbers(ROAD), 250.0, 30.0, *seen.lanes, plain, *scratch()
    )
    compiled = observe_wide(seen.snapshot, ROAD, 250.0, 30.0, seen.lanes)
    assert plain.tobytes() == compiled.tobytes()
    assert np.isfinite(plain).all()
    assert (np.abs(plain) <= 6).all()
