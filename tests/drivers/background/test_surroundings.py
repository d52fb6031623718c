"""What many vehicles see at once is what the ego would see in the place of each."""

import numpy as np
from hypothesis import given
from worlds import BARRICADED_ROAD, LEFT, RIGHT, ROAD, Car, ahead, behind, scenes, snapshot

from drl_av.drivers.background.surroundings import Surroundings, surroundings
from drl_av.driving.affordances import compute_affordances
from drl_av.driving.scene import Scene
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot


def seen_from(shot: Snapshot, row: int) -> Snapshot:
    """The same moment with the vehicle of a row as the ego."""
    order = [row, *(other for other in range(len(shot.ids)) if other != row)]
    arrays = ("s_m", "y_m", "speed_m_s", "lateral_speed_m_s", "length_m", "width_m")
    moved = {name: getattr(shot, name)[order] for name in arrays}
    return shot._replace(ids=tuple(shot.ids[other] for other in order), **moved)


def look(shot: Snapshot, *rows: int, road: Road = ROAD, range_m: float = 250.0) -> Surroundings:
    return surroundings(shot, road, range_m, np.array(rows, dtype=np.intp))


@given(scenes())
def test_each_row_is_the_affordances_of_a_snapshot_with_that_vehicle_as_the_ego(
    world: Scene,
) -> None:
    shot = world.snapshot
    rows = range(len(shot.ids))
    for road in (ROAD, BARRICADED_ROAD):
        for range_m in (250.0, 60.0):
            found = look(shot, *rows, road=road, range_m=range_m).vectors()
            for row in rows:
                expected = compute_affordances(seen_from(shot, row), road, range_m).vector()
                np.testing.assert_array_equal(found[row], expected)


def test_only_those_asked_for_look_and_in_their_order() -> None:
    shot = snapshot(ahead(20.0, speed_m_s=15.0), behind(40.0, LEFT))
    all_vehicles = look(shot, 0, 1, 2).vectors()
    np.testing.assert_array_equal(look(shot, 2, 0).vectors(), all_vehicles[[2, 0]])
    assert look(shot).vectors().shape == (0, 27)


def test_a_lane_change_is_under_way_off_the_centre_of_either_lane() -> None:
    # 1.52 m from the old centre; 3.04 m from it is 0.76 m short of the new one
    shot = snapshot(Car(50.0, RIGHT + 1.52), Car(90.0, RIGHT + 3.04), Car(140.0, LEFT - 0.05))
    neighbors = look(shot, 0, 1, 2, 3)
    assert neighbors.under_way.tolist() == [False, True, True, False]
    np.testing.assert_allclose(neighbors.off_center_m, [0.0, 1.52, -0.76, -0.05])
