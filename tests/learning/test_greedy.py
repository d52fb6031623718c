"""The learned driver decides by value, and begins no lane change for next to nothing."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import ALONE, changing

from drl_av.driving.actions import ACTIONS, Lateral
from drl_av.driving.scene import Scene
from drl_av.learning.greedy import GreedyDriver
from drl_av.learning.qnetwork import GreedyPolicy

MAINTAIN, ACCELERATE = 0, 1
MAINTAIN_RIGHT, ACCELERATE_LEFT = 4, 9
S_T: Any = np.zeros(27, np.float32)
UNDER_WAY = changing(origin=1, target=2, seconds=1)


class Stated(GreedyPolicy):
    """The values that a story gives, -1 for what it does not name."""

    def __init__(self, values: dict[int, float]) -> None:
        self._stated = values

    def values(self, s_t: Any) -> Any:
        return np.array([self._stated.get(number, -1.0) for number in range(12)], np.float32)


def decided(values: dict[int, float], margin: float, scene: Scene = ALONE) -> int:
    return GreedyDriver(Stated(values), margin).act(scene, S_T).number


@pytest.mark.parametrize(
    ("left", "margin", "expected"),
    [
        (0.53, 0.0, ACCELERATE_LEFT),  # the paper's: any difference will do
        (0.53, 0.02, ACCELERATE_LEFT),  # 0.51 is still more than 0.5
        (0.51, 0.02, ACCELERATE),  # 0.49 is not
        (0.53, 0.04, ACCELERATE),
    ],
)
def test_a_lane_change_begins_only_where_it_is_worth_the_margin(left, margin, expected) -> None:
    values = {MAINTAIN: 0.3, ACCELERATE: 0.5, MAINTAIN_RIGHT: 0.2, ACCELERATE_LEFT: left}
    assert decided(values, margin) == expected


def test_what_has_begun_goes_on_or_back_by_value_alone() -> None:
    back, on = {ACCELERATE: 0.5, MAINTAIN_RIGHT: 0.501}, {ACCELERATE: 0.5, ACCELERATE_LEFT: 0.501}
    assert decided(back, 0.2, UNDER_WAY) == MAINTAIN_RIGHT
    assert decided(on, 0.2, UNDER_WAY) == ACCELERATE_LEFT
    assert decided(back, 0.2) == decided(on, 0.2) == ACCELERATE


@given(
    values=st.lists(st.floats(-4, 1, width=32), min_size=12, max_size=12),
    margin=st.floats(0.001, 3),
)
def test_the_margin_decides_between_lanes_and_never_between_speeds(values, margin) -> None:
    number = decided(dict(enumerate(values)), margin)
    lateral = ACTIONS[number].lateral
    alike = [a for a, action in enumerate(ACTIONS) if action.lateral is lateral]
    keeping = max(values[:4])
    assert values[number] == max(values[a] for a in alike)
    if lateral is Lateral.KEEP:
        assert max(values[4:]) - keeping < margin + 1e-5
    else:
        assert values[number] == max(values[4:])
        assert values[number] - keeping > margin - 1e-5
