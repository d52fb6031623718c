"""The plans that the planner compares: an intent for each second of the forecast (ours)."""

from enum import IntEnum
from itertools import product

import numpy as np

from drl_av.drivers.planner.others import IntArray

SEGMENTS_S = (2, 5, 13)
"""A plan has one intent in each of these parts of the forecast."""


class Intent(IntEnum):
    """What the ego intends at a moment; a lane change begins as soon as it is permitted."""

    KEEP = 0
    BRAKE = 1
    """Keep the lane and brake."""
    LEFT = 2
    RIGHT = 3
    LEFT_YIELDING = 4
    """Brake until the lane change to the left is permitted, as to change behind a neighbour."""
    RIGHT_YIELDING = 5


SIDE = np.array([0, 0, 1, -1, 1, -1])
"""Direction of each intent: left +1, right -1."""
YIELDS = np.array([False, True, False, False, True, True])
"""Whether an intent brakes."""


def _plans() -> IntArray:
    """All combinations, but without braking for its own sake after a lane change."""
    intents = product(Intent, Intent, (Intent.KEEP, Intent.LEFT, Intent.RIGHT))
    useful = [plan for plan in intents if plan[1] != Intent.BRAKE or SIDE[plan[0]] == 0]
    return np.repeat(np.array(useful, dtype=np.intp), SEGMENTS_S, axis=1)


PLANS = _plans()
"""All plans, shape (P, seconds)."""


def usable_plans(is_changing: bool, has_right: bool, has_left: bool) -> IntArray:
    """The plans that do not begin with a lane change off the road, shape (P, seconds)."""
    first = SIDE[PLANS[:, 0]]
    off_road = (first == 1) & (not has_left) | (first == -1) & (not has_right)
    return PLANS if is_changing else PLANS[~off_road]


def next_second(plan: IntArray) -> IntArray:
    """The rest of a plan one second later; it keeps the lane at its end."""
    rest: IntArray = np.append(plan[1:], Intent.KEEP)
    return rest
