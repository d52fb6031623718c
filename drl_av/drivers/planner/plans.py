"""The plans that the planner compares: an intent for each second of the forecast (ours)."""

from enum import IntEnum
from itertools import product

import numpy as np

from drl_av.drivers.planner.others import IntArray

SEGMENTS_S = (2, 5, 13)
"""Lengths of the three parts of a forecast; a plan has one intent for each part."""


class Intent(IntEnum):
    """The ego's intent in one second; a lane change begins as soon as the check permits it."""

    KEEP = 0
    BRAKE = 1
    """Keep the lane and brake."""
    LEFT = 2
    RIGHT = 3
    LEFT_YIELDING = 4
    """Change to the left, and brake until this is permitted, to let a vehicle there pass first."""
    RIGHT_YIELDING = 5


SIDE = np.array([0, 0, 1, -1, 1, -1])
"""Direction of each intent's lane change: left +1, right -1, none 0."""
YIELDS = np.array([False, True, False, False, True, True])
"""Whether the ego brakes with each intent."""


def _plans() -> IntArray:
    """Return all plans, except those with the intent BRAKE after an intent to change lanes."""
    intents = product(Intent, Intent, (Intent.KEEP, Intent.LEFT, Intent.RIGHT))
    useful = [plan for plan in intents if plan[1] != Intent.BRAKE or SIDE[plan[0]] == 0]
    return np.repeat(np.array(useful, dtype=np.intp), SEGMENTS_S, axis=1)


PLANS = _plans()
"""All P plans: the intent of each second of the forecast, shape (P, seconds)."""


def usable_plans(is_changing: bool, has_right: bool, has_left: bool) -> IntArray:
    """Return the rows of ``PLANS`` that the ego can begin now, shape (usable plans, seconds).

    A row holds one ``Intent`` for each second. A plan is not usable if it begins with a change to a
    lane that does not exist: ``has_right`` and ``has_left`` say which lanes beside the ego exist.
    During a lane change (``is_changing``) all plans are usable.
    """
    first = SIDE[PLANS[:, 0]]
    off_road = (first == 1) & (not has_left) | (first == -1) & (not has_right)
    return PLANS if is_changing else PLANS[~off_road]


def next_second(plan: IntArray) -> IntArray:
    """Return the rest of a plan after its first second, with the intent KEEP added at its end."""
    rest: IntArray = np.append(plan[1:], Intent.KEEP)
    return rest
