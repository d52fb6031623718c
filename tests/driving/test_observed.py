"""The action of an ego that SUMO drives, from its positions before and after."""

import pytest
from worlds import CENTER, LEFT, ROAD, changing, scene, snapshot

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, Longitudinal, nearest_action
from drl_av.driving.scene import LaneChange, Scene, infer_action

CONFIG = Config()
MAINTAIN = Longitudinal.MAINTAIN


def seen(before: Scene, y_m: float, speed_m_s: float = 20.0) -> tuple[Action, LaneChange | None]:
    return infer_action(before, snapshot(y_m=y_m, speed_m_s=speed_m_s), ROAD, CONFIG)


@pytest.mark.parametrize(
    ("acceleration_m_s2", "action"),
    [
        *((9.0, Longitudinal.ACCELERATE), (1.1, Longitudinal.ACCELERATE)),
        *((1.0, MAINTAIN), (-0.9, MAINTAIN)),
        *((-2.9, Longitudinal.BRAKE), (-3.1, Longitudinal.HARD_BRAKE)),
    ],
)
def test_the_nearest_action(acceleration_m_s2: float, action: Longitudinal) -> None:
    assert nearest_action(acceleration_m_s2, CONFIG.ego) is action


def test_an_ego_that_gained_1_5_m_s_in_a_second_accelerated() -> None:
    assert seen(scene(), CENTER, 21.5) == ((Lateral.KEEP, Longitudinal.ACCELERATE), None)
    assert seen(scene(), CENTER, 16.5) == ((Lateral.KEEP, Longitudinal.HARD_BRAKE), None)


def test_a_lane_change_begins_continues_and_ends_on_the_centre() -> None:
    assert seen(scene(), CENTER + 0.76) == (Action(Lateral.LEFT, MAINTAIN), LaneChange(1, 2))
    assert seen(scene(), CENTER - 0.38) == (Action(Lateral.RIGHT, MAINTAIN), LaneChange(1, 0))
    on_the_way = changing(origin=1, target=2, seconds=3)  # over the line already
    assert seen(on_the_way, CENTER + 3.04) == (Action(Lateral.KEEP, MAINTAIN), LaneChange(1, 2))
    assert seen(on_the_way, LEFT - 0.04) == (Action(Lateral.KEEP, MAINTAIN), None)


def test_one_that_waits_between_the_lanes_is_still_changing_and_one_that_turns_aborts() -> None:
    on_the_way = changing(origin=1, target=2, seconds=2)
    assert seen(on_the_way, CENTER + 1.52) == (Action(Lateral.KEEP, MAINTAIN), LaneChange(1, 2))
    assert seen(on_the_way, CENTER + 0.76) == (Action(Lateral.RIGHT, MAINTAIN), LaneChange(2, 1))
    just_begun = changing(origin=1, target=2, seconds=1)
    assert seen(just_begun, CENTER) == (Action(Lateral.RIGHT, MAINTAIN), None)


def test_one_that_passes_a_centre_without_a_stop_continues_to_the_lane_after_that() -> None:
    on_the_way = changing(origin=0, target=1, seconds=4)
    found = seen(on_the_way, CENTER + 0.4)
    assert found == (Action(Lateral.KEEP, MAINTAIN), LaneChange(1, 2))
