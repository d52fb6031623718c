"""The 12 discrete decisions: 4 longitudinal x 3 lateral."""

from enum import IntEnum
from typing import NamedTuple

from drl_av.config import EgoConfig


class Lateral(IntEnum):
    """Stay in the lane, or change to the lane at the right or left."""

    KEEP = 0
    RIGHT = 1
    LEFT = 2

    @property
    def sign(self) -> int:
        """Direction of travel across the road: left +1, right -1, keep 0."""
        return (0, -1, 1)[self]


class Longitudinal(IntEnum):
    """What the ego does with its speed."""

    MAINTAIN = 0
    ACCELERATE = 1
    BRAKE = 2
    HARD_BRAKE = 3

    def acceleration_m_s2(self, ego: EgoConfig) -> float:
        """The number behind the word, a_x of Sec. IV-A."""
        return (0.0, ego.accelerate_m_s2, -ego.brake_m_s2, -ego.hard_brake_m_s2)[self]


def nearest_action(acceleration_m_s2: float, ego: EgoConfig) -> Longitudinal:
    """The action whose acceleration is nearest to a given one; of two as near the gentler one."""
    return min(Longitudinal, key=lambda one: abs(one.acceleration_m_s2(ego) - acceleration_m_s2))


_LONGITUDINAL_WORDS = ("maintain", "accelerate", "brake", "hard brake")
_LATERAL_WORDS = ("keep lane", "change right", "change left")


class Action(NamedTuple):
    """One decision."""

    lateral: Lateral
    longitudinal: Longitudinal

    @property
    def number(self) -> int:
        """Place among the 12 actions, ``4 * lateral + longitudinal``."""
        return 4 * self.lateral + self.longitudinal

    def __str__(self) -> str:
        return f"{_LONGITUDINAL_WORDS[self.longitudinal]}, {_LATERAL_WORDS[self.lateral]}"


ACTIONS: tuple[Action, ...] = tuple(
    Action(lateral, longitudinal) for lateral in Lateral for longitudinal in Longitudinal
)
"""All 12, in the order of their numbers."""


def toward(sign: int) -> Lateral:
    """The lateral action that moves left (+1), right (-1) or not at all (0)."""
    return (Lateral.KEEP, Lateral.LEFT, Lateral.RIGHT)[sign]
