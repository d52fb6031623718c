"""The 12 discrete decisions: 4 longitudinal x 3 lateral."""

from enum import IntEnum
from typing import NamedTuple

from drl_av.config import EgoConfig


class Lateral(IntEnum):
    """The lateral part of an action: keep the lane, or change to the right or left lane."""

    KEEP = 0
    RIGHT = 1
    LEFT = 2

    @property
    def sign(self) -> int:
        """Direction across the road: left +1, right -1, keep 0."""
        return (0, -1, 1)[self]


class Longitudinal(IntEnum):
    """The longitudinal part of an action: how the ego changes its speed."""

    MAINTAIN = 0
    ACCELERATE = 1
    BRAKE = 2
    HARD_BRAKE = 3

    def acceleration_m_s2(self, ego: EgoConfig) -> float:
        """Acceleration of the action, a_x of Sec. IV-A; negative if the action brakes."""
        return (0.0, ego.accelerate_m_s2, -ego.brake_m_s2, -ego.hard_brake_m_s2)[self]


def nearest_action(acceleration_m_s2: float, ego: EgoConfig) -> Longitudinal:
    """The action with the acceleration nearest to a given one, m/s^2.

    If two actions are equally near, the gentler one.
    """
    return min(Longitudinal, key=lambda one: abs(one.acceleration_m_s2(ego) - acceleration_m_s2))


_LONGITUDINAL_WORDS = ("maintain", "accelerate", "brake", "hard brake")
_LATERAL_WORDS = ("keep lane", "change right", "change left")


class Action(NamedTuple):
    """One of the 12 actions: a lateral and a longitudinal part."""

    lateral: Lateral
    longitudinal: Longitudinal

    @property
    def number(self) -> int:
        """Number of the action, 0 to 11: ``4 * lateral + longitudinal``."""
        return 4 * self.lateral + self.longitudinal

    def __str__(self) -> str:
        return f"{_LONGITUDINAL_WORDS[self.longitudinal]}, {_LATERAL_WORDS[self.lateral]}"


ACTIONS: tuple[Action, ...] = tuple(
    Action(lateral, longitudinal) for lateral in Lateral for longitudinal in Longitudinal
)
"""All 12 actions, in the order of their numbers."""


def toward(sign: int) -> Lateral:
    """The lateral action that moves left (+1), right (-1) or not at all (0)."""
    return (Lateral.KEEP, Lateral.LEFT, Lateral.RIGHT)[sign]
