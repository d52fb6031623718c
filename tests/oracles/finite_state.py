"""The finite-state machine, and what it sees, for many vehicles at once with arrays."""

from typing import NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray, IntArray
from drl_av.config import FiniteStateConfig
from drl_av.drivers.background.finite_state import CRUISE, FOLLOW, LANE_CHANGE
from drl_av.driving.affordances import SIDES
from drl_av.road.road import CENTERED_M, Road
from drl_av.road.snapshot import Snapshot


class Decisions(NamedTuple):
    """Decisions of R vehicles; arrays of shape (R,)."""

    acceleration_m_s2: FloatArray
    side: IntArray


OWN, RIGHT, LEFT = range(3)
"""Indices of the lane axis: a vehicle's own lane, the lane to its right, the lane to its left."""
FRONT, REAR = range(2)
"""Indices of the last axis: the neighbour ahead, the neighbour behind."""


class Surroundings(NamedTuple):
    """The nearest neighbours of R vehicles.

    The axes of the arrays are the vehicle, the lane (own, right, left), and front/rear.
    """

    has_lane: BoolArray
    """Shape (R, 3): whether the lane exists and is open; always True for the own lane."""
    gap_m: FloatArray
    """Shape (R, 3, 2): gap from bumper to bumper, never negative; inf without a neighbour."""
    relative_speed_m_s: FloatArray
    """Shape (R, 3, 2): speed of the neighbour minus that of the vehicle; 0 without a neighbour."""
    speed_m_s: FloatArray
    """Speed of each of the R vehicles; this field and the next have shape (R,)."""
    off_center_m: FloatArray
    """Offset from the centre of the own lane, left positive."""

    @property
    def under_way(self) -> BoolArray:
        """Whether each vehicle is changing lanes, that is, is off its lane's centre; shape (R,)."""
        return np.abs(self.off_center_m) > CENTERED_M


def surroundings(snapshot: Snapshot, road: Road, range_m: float, rows: IntArray) -> Surroundings:
    """Find the neighbours of R vehicles by the rules of ``compute_indicators``.

    ``rows``, shape (R,), holds the row index of each vehicle in the snapshot arrays.
    """
    y, speed = snapshot.y_m, snapshot.speed_m_s
    lane = np.floor(y[rows] / road.lane_width_m + 0.5).astype(np.intp)
    centers_m = lane[:, None] * road.lane_width_m + road.lane_width_m * np.array(SIDES)
    gap_m, other = _nearest(snapshot, road, centers_m, rows)
    there = gap_m <= range_m
    return Surroundings(
        has_lane=_has_lane(lane, road),
        gap_m=np.where(there, np.maximum(gap_m, 0.0), np.inf),
        relative_speed_m_s=np.where(there, speed[other] - speed[rows, None, None], 0.0),
        speed_m_s=speed[rows],
        off_center_m=y[rows] - centers_m[:, OWN],
    )


def _nearest(
    snapshot: Snapshot, road: Road, centers_m: FloatArray, rows: IntArray
) -> tuple[FloatArray, IntArray]:
    """Return the gaps to the nearest neighbours of R vehicles, m, and the neighbours' row indices.

    Both have shape (R, 3, 2); the axes are the vehicle, the lane (own, right, left) and front/rear.
    ``rows``, shape (R,), holds the row index of each vehicle; ``centers_m``, shape (R, 3), holds
    the y of the lanes' centres. A gap is negative if the bodies are side by side. Without a
    neighbour the gap is inf, and the row index is arbitrary.
    """
    length, looking = snapshot.length_m, np.arange(len(rows))
    ahead_m = road.ahead_m(snapshot.s_m[rows, None], snapshot.s_m)
    clearance_m = np.abs(ahead_m) - (length + length[rows, None]) / 2
    clearance_m[looking, rows] = np.inf
    in_front = (ahead_m >= 0.0)[:, None]
    sides = np.where(np.concatenate((in_front, ~in_front), 1), clearance_m[:, None], np.inf)
    reach_m = snapshot.width_m / 2 + road.lane_width_m / 2
    occupies = np.abs(snapshot.y_m - centers_m[:, :, None]) < reach_m
    distances = np.where(occupies[:, :, None], sides[:, None], np.inf)
    other = distances.argmin(axis=3)
    return np.take_along_axis(distances, other[..., None], axis=3)[..., 0], other


def _has_lane(lane: IntArray, road: Road) -> BoolArray:
    fenced = np.array((False, *road.open_lanes, False))
    places = np.clip(lane[:, None] + np.array(SIDES) + 1, 0, len(fenced) - 1)
    exists: BoolArray = fenced[places]
    exists[:, OWN] = True
    return exists


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
    states = np.where(neighbors.under_way | (side != 0), LANE_CHANGE, states)
    return states, Decisions(_acceleration(neighbors, states, desired_m_s, config), side)


def _longitudinal_states(
    neighbors: Surroundings, states: IntArray, config: FiniteStateConfig
) -> IntArray:
    """Return FOLLOW near the vehicle ahead, else CRUISE, with a hysteresis; shape (R,)."""
    headway_s = np.where(states == CRUISE, config.follow_headway_s, config.cruise_headway_s)
    near_m = config.standstill_gap_m + headway_s * neighbors.speed_m_s
    return np.where(neighbors.gap_m[:, OWN, FRONT] < near_m, FOLLOW, CRUISE)


def _side(
    neighbors: Surroundings, states: IntArray, desired_m_s: FloatArray, config: FiniteStateConfig
) -> IntArray:
    """Return the lane change that each vehicle wants: +1 left, -1 right, 0 none; shape (R,)."""
    leader_m_s = neighbors.speed_m_s + neighbors.relative_speed_m_s[:, OWN, FRONT]
    held_up = (states == FOLLOW) & (leader_m_s < desired_m_s - config.slow_leader_m_s)
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
    wide: BoolArray = (neighbors.gap_m[:, lane] > needed_m).all(axis=1)
    return neighbors.has_lane[:, lane] & wide


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
    own = np.where(states == CRUISE, np.inf, _behind(neighbors, OWN, config))
    leaning = np.sign(neighbors.off_center_m) * (states == LANE_CHANGE)
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
