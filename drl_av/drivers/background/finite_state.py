"""A finite-state machine that drives many vehicles: cruise, follow, change lanes.

The states, and their conditions on gaps and relative speeds, are those of Zhang, Li, Girard and
Kolmanovsky 2017; the control in each state is ours.
"""

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from drl_av.config import FiniteStateConfig
from drl_av.drivers.background.surroundings import FRONT, LEFT, OWN, RIGHT, Surroundings
from drl_av.drivers.driver import Decisions
from drl_av.traffic.road import FloatArray

IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]


class State(IntEnum):
    """The states of a vehicle."""

    CRUISE = 0
    FOLLOW = 1
    LANE_CHANGE = 2


def finite_state(
    neighbors: Surroundings, states: IntArray, desired_m_s: FloatArray, config: FiniteStateConfig
) -> tuple[IntArray, Decisions]:
    """The next states and the decisions; ``states`` and ``desired_m_s`` have shape (R,).

    A vehicle behind a slow vehicle changes to the better lane if the gaps there are large enough.
    If SUMO does not begin the lane change, the vehicle gives it up at the next decision.
    """
    states = _longitudinal_states(neighbors, states, config)
    side = np.where(neighbors.under_way, 0, _side(neighbors, states, desired_m_s, config))
    states = np.where(neighbors.under_way | (side != 0), State.LANE_CHANGE, states)
    return states, Decisions(_acceleration(neighbors, states, desired_m_s, config), side)


def _longitudinal_states(
    neighbors: Surroundings, states: IntArray, config: FiniteStateConfig
) -> IntArray:
    """Follow if the vehicle ahead is near; to begin requires a smaller gap than to continue."""
    headway_s = np.where(states == State.CRUISE, config.follow_headway_s, config.cruise_headway_s)
    near_m = config.standstill_gap_m + headway_s * neighbors.speed_m_s
    return np.where(neighbors.gap_m[:, OWN, FRONT] < near_m, State.FOLLOW, State.CRUISE)


def _side(
    neighbors: Surroundings, states: IntArray, desired_m_s: FloatArray, config: FiniteStateConfig
) -> IntArray:
    """The better lane: left (+1), right (-1) or no lane change (0); left if both are equal."""
    leader_m_s = neighbors.speed_m_s + neighbors.relative_speed_m_s[:, OWN, FRONT]
    held_up = (states == State.FOLLOW) & (leader_m_s < desired_m_s - config.slow_leader_m_s)
    left, right = (
        np.where(held_up & _clear(neighbors, lane, config), _gain(neighbors, lane, config), -np.inf)
        for lane in (LEFT, RIGHT)
    )
    better = np.maximum(left, right) >= config.worthwhile_gain_m_s
    return np.where(better, np.where(left >= right, 1, -1), 0)


def _clear(neighbors: Surroundings, lane: int, config: FiniteStateConfig) -> BoolArray:
    """Whether a lane exists and has gaps for a lane change ahead and behind."""
    closing_m_s = neighbors.relative_speed_m_s[:, lane] * (-1.0, 1.0)
    needed_m = config.lane_change_gap_m + config.lane_change_time_s * np.maximum(closing_m_s, 0)
    clear: BoolArray = neighbors.has_lane[:, lane] & (neighbors.gap_m[:, lane] > needed_m).all(
        axis=1
    )
    return clear


def _gain(neighbors: Surroundings, lane: int, config: FiniteStateConfig) -> FloatArray:
    """Speed of the vehicle ahead in another lane minus that in the own lane; inf if it is far."""
    far_m = config.standstill_gap_m + config.cruise_headway_s * neighbors.speed_m_s
    speed = neighbors.relative_speed_m_s
    faster_m_s = speed[:, lane, FRONT] - speed[:, OWN, FRONT]
    return np.where(neighbors.gap_m[:, lane, FRONT] > far_m, np.inf, faster_m_s)


def _acceleration(
    neighbors: Surroundings, states: IntArray, desired_m_s: FloatArray, config: FiniteStateConfig
) -> FloatArray:
    """Approach the desired speed, but keep behind the vehicles ahead in the occupied lanes."""
    free = config.speed_gain_per_s * (desired_m_s - neighbors.speed_m_s)
    own = np.where(states == State.CRUISE, np.inf, _behind(neighbors, OWN, config))
    leaning = np.sign(neighbors.off_center_m) * (states == State.LANE_CHANGE)
    left = np.where(leaning > 0, _behind(neighbors, LEFT, config), np.inf)
    right = np.where(leaning < 0, _behind(neighbors, RIGHT, config), np.inf)
    wanted = np.minimum.reduce((free, own, left, right))
    limited: FloatArray = np.clip(wanted, -config.braking_m_s2, config.acceleration_m_s2)
    return limited


def _behind(neighbors: Surroundings, lane: int, config: FiniteStateConfig) -> FloatArray:
    """Acceleration that keeps the headway to the vehicle ahead, m/s^2; inf without one."""
    kept_m = config.standstill_gap_m + config.headway_s * neighbors.speed_m_s
    to_spare_m = neighbors.gap_m[:, lane, FRONT] - kept_m
    closing_m_s = -neighbors.relative_speed_m_s[:, lane, FRONT]
    return config.gap_gain_per_s2 * to_spare_m - config.speed_gain_per_s * closing_m_s
