"""The 12 actions of the ego: 4 longitudinal times 3 lateral ones."""

import operator
from collections import namedtuple
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from drl_av.config import EgoConfig, SimulationConfig
from drl_av.errors import ConfigError


class Lateral(IntEnum):
    """The lateral part of an action: keep the lane, or change to the right or left lane."""

    KEEP = 0
    RIGHT = 1
    LEFT = 2

    @property
    def sign(self) -> int:
        """Direction across the road: +1 left, -1 right, 0 keep."""
        return SIGNS[self]


class Longitudinal(IntEnum):
    """The longitudinal part of an action: how the ego changes its speed."""

    MAINTAIN = 0
    ACCELERATE = 1
    BRAKE = 2
    HARD_BRAKE = 3

    def acceleration_m_s2(self, ego: EgoConfig) -> float:
        """Return the acceleration a_x of the action (Sec. IV-A), m/s^2; negative if it brakes."""
        return acceleration_of(self, ego)


KEEP, RIGHT, LEFT = range(3)
MAINTAIN, ACCELERATE, BRAKE, HARD_BRAKE = range(4)
"""The numbers of the lateral and of the longitudinal parts, for compiled functions."""
SIGNS = (0, -1, 1)
"""Direction across the road of each lateral part, by its number: +1 left, -1 right."""


_TIMES = ("step_length_s", "steps_per_decision", "decision_interval_s")

if TYPE_CHECKING:

    class EgoNumbers(EgoConfig, SimulationConfig):
        """The ``numbers`` of the ego and the times of a decision, for compiled functions."""

else:
    EgoNumbers = namedtuple("EgoNumbers", (*EgoConfig().numbers._fields, *_TIMES))


def ego_numbers(ego: EgoConfig, simulation: SimulationConfig) -> EgoNumbers:
    """Return the settings of the ego, and the times of a decision, as numbers."""
    numbers: Any = ego.numbers
    return EgoNumbers(*numbers, *(getattr(simulation, name) for name in _TIMES))


def acceleration_of(longitudinal: int, ego: EgoConfig) -> float:
    """Return the acceleration a_x of a longitudinal action (Sec. IV-A), m/s^2, by its number."""
    return (0.0, ego.accelerate_m_s2, -ego.brake_m_s2, -ego.hard_brake_m_s2)[longitudinal]


def nearest_action(acceleration_m_s2: float, ego: EgoConfig) -> Longitudinal:
    """Return the longitudinal action whose acceleration is nearest to the given one.

    If two actions are equally near, it is the one with the smaller number.
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


def action_of(number: Any) -> Action:
    """Return the action with this number, an integer or an array that holds one integer.

    Raises:
        ConfigError: ``number`` is not a whole number from 0 to 11.
    """
    try:
        index = operator.index(number.item() if isinstance(number, np.ndarray) else number)
    except (TypeError, ValueError):
        index = -1
    if not 0 <= index < len(ACTIONS):
        raise ConfigError(
            f"The policy returned {number!r}, but an action is a whole number from 0 to "
            f"{len(ACTIONS) - 1}."
        )
    return ACTIONS[index]


def toward(sign: int) -> Lateral:
    """Return the lateral action that moves left (+1), right (-1) or not at all (0)."""
    return (Lateral.KEEP, Lateral.LEFT, Lateral.RIGHT)[sign]
