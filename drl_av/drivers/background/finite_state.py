"""Drives many background vehicles by a finite-state machine: cruise, follow, change lanes.

The states, and their conditions on gaps and relative speeds, are those of Zhang, Li, Girard and
Kolmanovsky 2017; the control in each state is ours. Arrays have one row for each of R vehicles.
"""

from enum import IntEnum

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, FiniteStateConfig
from drl_av.drivers.background.surroundings import FRONT, LEFT, OWN, RIGHT, Surroundings
from drl_av.drivers.driver import Decisions
from drl_av.random_streams import Stream, generator
from drl_av.road.road import FloatArray

IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]


class State(IntEnum):
    """The state of a vehicle in the finite-state machine."""

    CRUISE = 0
    FOLLOW = 1
    LANE_CHANGE = 2


def finite_state(
    neighbors: Surroundings, states: IntArray, desired_m_s: FloatArray, config: FiniteStateConfig
) -> tuple[IntArray, Decisions]:
    """Return the next state, shape (R,), and the decision of each of R vehicles.

    ``states`` and the desired speeds ``desired_m_s`` have shape (R,). A vehicle behind a slow
    leader requests a change to the faster neighbouring lane if the gaps in that lane are large
    enough. If SUMO has not begun that lane change by the next decision, the vehicle returns to
    FOLLOW or CRUISE.
    """
    states = _longitudinal_states(neighbors, states, config)
    side = np.where(neighbors.under_way, 0, _side(neighbors, states, desired_m_s, config))
    states = np.where(neighbors.under_way | (side != 0), State.LANE_CHANGE, states)
    return states, Decisions(_acceleration(neighbors, states, desired_m_s, config), side)


def _longitudinal_states(
    neighbors: Surroundings, states: IntArray, config: FiniteStateConfig
) -> IntArray:
    """Return FOLLOW near the vehicle ahead, else CRUISE, with a hysteresis; shape (R,)."""
    headway_s = np.where(states == State.CRUISE, config.follow_headway_s, config.cruise_headway_s)
    near_m = config.standstill_gap_m + headway_s * neighbors.speed_m_s
    return np.where(neighbors.gap_m[:, OWN, FRONT] < near_m, State.FOLLOW, State.CRUISE)


def _side(
    neighbors: Surroundings, states: IntArray, desired_m_s: FloatArray, config: FiniteStateConfig
) -> IntArray:
    """Return the lane change that each vehicle wants: +1 left, -1 right, 0 none; shape (R,)."""
    leader_m_s = neighbors.speed_m_s + neighbors.relative_speed_m_s[:, OWN, FRONT]
    held_up = (states == State.FOLLOW) & (leader_m_s < desired_m_s - config.slow_leader_m_s)
    left, right = (
        np.where(held_up & _clear(neighbors, lane, config), _gain(neighbors, lane, config), -np.inf)
        for lane in (LEFT, RIGHT)
    )
    better = np.maximum(left, right) >= config.worthwhile_gain_m_s
    return np.where(better, np.where(left >= right, 1, -1), 0)


def _clear(neighbors: Surroundings, lane: int, config: FiniteStateConfig) -> BoolArray:
    """Return whether ``lane`` exists and its gaps are large enough to enter it; shape (R,)."""
    closing_m_s = neighbors.relative_speed_m_s[:, lane] * (-1.0, 1.0)
    needed_m = config.lane_change_gap_m + config.lane_change_time_s * np.maximum(closing_m_s, 0)
    clear: BoolArray = neighbors.has_lane[:, lane] & (neighbors.gap_m[:, lane] > needed_m).all(
        axis=1
    )
    return clear


def _gain(neighbors: Surroundings, lane: int, config: FiniteStateConfig) -> FloatArray:
    """Return the gain in speed of a change to ``lane``, m/s, shape (R,); inf if it is free."""
    far_m = config.standstill_gap_m + config.cruise_headway_s * neighbors.speed_m_s
    speed = neighbors.relative_speed_m_s
    faster_m_s = speed[:, lane, FRONT] - speed[:, OWN, FRONT]
    return np.where(neighbors.gap_m[:, lane, FRONT] > far_m, np.inf, faster_m_s)


def _acceleration(
    neighbors: Surroundings, states: IntArray, desired_m_s: FloatArray, config: FiniteStateConfig
) -> FloatArray:
    """Return the smallest acceleration that the desired speed and the leaders demand, (R,)."""
    free = config.speed_gain_per_s * (desired_m_s - neighbors.speed_m_s)
    own = np.where(states == State.CRUISE, np.inf, _behind(neighbors, OWN, config))
    leaning = np.sign(neighbors.off_center_m) * (states == State.LANE_CHANGE)
    left = np.where(leaning > 0, _behind(neighbors, LEFT, config), np.inf)
    right = np.where(leaning < 0, _behind(neighbors, RIGHT, config), np.inf)
    wanted = np.minimum.reduce((free, own, left, right))
    limited: FloatArray = np.clip(wanted, -config.braking_m_s2, config.acceleration_m_s2)
    return limited


def _behind(neighbors: Surroundings, lane: int, config: FiniteStateConfig) -> FloatArray:
    """Return the acceleration that keeps the headway in ``lane``, m/s^2, (R,); inf if free."""
    kept_m = config.standstill_gap_m + config.headway_s * neighbors.speed_m_s
    to_spare_m = neighbors.gap_m[:, lane, FRONT] - kept_m
    closing_m_s = -neighbors.relative_speed_m_s[:, lane, FRONT]
    return config.gap_gain_per_s2 * to_spare_m - config.speed_gain_per_s * closing_m_s


class HardBraking:
    """Replaces the decisions of vehicles that brake hard.

    At each decision a separate random generator draws which vehicles begin to brake. They then
    brake for ``traffic.hard_brake_s`` seconds. ``n`` is the number of rows in a snapshot.
    """

    def __init__(self, seed: int, n: int, config: Config) -> None:
        self._rng = generator(seed, Stream.HARD_BRAKING)
        self._left = np.zeros(n, dtype=np.intp)
        self._config = config

    def __call__(self, decisions: Decisions, rows: npt.NDArray[np.intp]) -> Decisions:
        """Return the decisions; a vehicle that brakes hard keeps its lane.

        ``rows``, shape (R,), holds each vehicle's row index in the snapshot arrays.
        """
        traffic, timing = self._config.traffic, self._config.simulation
        chance = traffic.hard_brakes_per_s * timing.decision_interval_s
        begins = (self._rng.random(len(rows)) < chance) & (self._left[rows] == 0)
        left = np.where(begins, traffic.hard_brake_s, self._left[rows])
        self._left[rows] = np.maximum(left - 1, 0)
        braking_m_s2 = self._config.finite_state.braking_m_s2
        return Decisions(
            np.where(left > 0, -braking_m_s2, decisions.acceleration_m_s2),
            np.where(left > 0, 0, decisions.side),
        )
