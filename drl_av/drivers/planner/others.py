"""The other vehicles as the planner sees them: their positions, lanes, leaders and IDM.

Arrays have shape (N,) or (L, N) for N vehicles and L lanes.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.driving.affordances import Affordances
from drl_av.road.road import FloatArray
from drl_av.road.snapshot import EGO, Snapshot

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]
FAR_M = 1e6
"""The distance that stands for a vehicle that does not exist."""
STANDSTILL_GAP_M = 2.5
ACCELERATION_M_S2 = 1.5
COMFORTABLE_BRAKING_M_S2 = 2.0
"""These three IDM parameters are assumed for each vehicle; ``Watcher`` estimates the others."""
MOVING_M_S = 0.05
"""A vehicle whose lateral speed exceeds this is changing lanes."""
ALMOST_THERE = 0.1
"""A vehicle this close to a lane's centre, as a share of the lane's width, has reached it."""


class Lanes(NamedTuple):
    """The lanes that each of N vehicles uses, and the leader of each vehicle in these lanes."""

    member: BoolArray
    """Whether a vehicle uses a lane, shape (L, N)."""
    leader: IntArray
    """Index, among the N vehicles, of the next vehicle ahead in a common lane."""
    offset_m: FloatArray
    """The gap to the leader is the leader's position minus the own position plus this offset.

    Without a leader the offset is about FAR_M.
    """


class Others(NamedTuple):
    """The N other vehicles at one decision; arrays of shape (N,)."""

    ids: tuple[str, ...]
    x_m: FloatArray
    """Position of the vehicle's centre minus that of the ego's centre, positive ahead."""
    speed_m_s: FloatArray
    half_m: FloatArray
    """Distance between the centres at which the vehicle touches the ego."""
    now: Lanes
    """The lanes used now; a vehicle that is changing lanes uses the old and the new lane."""
    later: Lanes
    """The lanes used after the lane changes in progress."""


def wanted_gap(speed: FloatArray, closing: FloatArray, headway_s: FloatArray) -> FloatArray:
    """Return the gap s* that IDM desires, m.

    ``closing`` is positive if the gap shrinks, m/s. The arguments broadcast.
    """
    rate = 2 * math.sqrt(ACCELERATION_M_S2 * COMFORTABLE_BRAKING_M_S2)
    result: FloatArray = STANDSTILL_GAP_M + np.maximum(speed * (headway_s + closing / rate), 0.0)
    return result


def idm(
    speed: FloatArray,
    desired: FloatArray,
    headway_s: FloatArray,
    gap_m: FloatArray,
    closing: FloatArray,
) -> FloatArray:
    """Return the acceleration of the intelligent driver model (Treiber et al. 2000), m/s^2.

    ``desired`` is the desired speed. ``closing`` is positive if the gap shrinks, m/s. The arguments
    broadcast.
    """
    ratio = wanted_gap(speed, closing, headway_s) / np.maximum(gap_m, 0.1)
    relative = speed / desired
    relative = relative * relative
    result: FloatArray = ACCELERATION_M_S2 * (1 - relative * relative - ratio * ratio)
    return result


def others_of(snapshot: Snapshot, affordances: Affordances, lanes: int) -> Others:
    """Return the other vehicles of a snapshot, on a road with this number of lanes.

    A barrier of the road, such as the end of a lane, counts as a standing vehicle of length 0.
    """
    lap_m = affordances.circumference_m or FAR_M
    width_m, ego_m = affordances.lane_width_m, float(snapshot.length_m[EGO])
    barriers = [barrier for barrier in affordances.barriers if barrier.left_m > barrier.right_m]
    rest = np.zeros(len(barriers))
    x_m = snapshot.s_m[1:] - snapshot.s_m[EGO]
    x_m = (x_m + lap_m / 2) % lap_m - lap_m / 2
    x_m = np.append(x_m, [barrier.s_m + ego_m / 2 for barrier in barriers])
    speed, lateral, length_m, body_m = (
        np.append(values[1:], rest)
        for values in (
            snapshot.speed_m_s,
            snapshot.lateral_speed_m_s,
            snapshot.length_m,
            snapshot.width_m,
        )
    )
    centers_m = [(barrier.left_m + barrier.right_m) / 2 for barrier in barriers]
    place = np.append(snapshot.y_m[1:], centers_m) / width_m
    now, later = _members(place, lateral, body_m / width_m, lanes)
    return Others(
        snapshot.ids[1:] + tuple(f"barrier at {barrier.left_m} m" for barrier in barriers),
        x_m,
        speed,
        (length_m + ego_m) / 2,
        _lanes(x_m, length_m, now, lap_m),
        _lanes(x_m, length_m, later, lap_m),
    )


def _members(
    place: FloatArray, lateral: FloatArray, width: FloatArray, lanes: int
) -> tuple[BoolArray, BoolArray]:
    """Return which lanes each vehicle uses now, and after its lane change; both (L, N).

    ``place`` and ``width`` are lateral positions and body widths in units of a lane's width.
    """
    lane = np.arange(lanes)[:, None]
    aim = np.where(lateral > 0, np.ceil(place - ALMOST_THERE), np.floor(place + ALMOST_THERE))
    changes = np.abs(lateral) > MOVING_M_S
    there = changes & (lane == aim)
    now = (np.abs(place - lane) < (1 + width) / 2) | there
    return now, np.where(changes, there, np.abs(place - lane) <= 0.5)


def _lanes(x_m: FloatArray, length_m: FloatArray, member: BoolArray, lap_m: float) -> Lanes:
    n = len(x_m)
    if n == 0:
        return Lanes(member, np.zeros(0, dtype=np.intp), np.zeros(0))
    shared = (member[:, :, None] & member[:, None, :]).any(axis=0) & ~np.eye(n, dtype=np.bool_)
    ahead_m = np.where(shared, (x_m[None, :] - x_m[:, None]) % lap_m, FAR_M)
    leader = ahead_m.argmin(axis=1)
    round_m = ahead_m[np.arange(n), leader] - (x_m[leader] - x_m)
    return Lanes(member, leader, round_m - (length_m[leader] + length_m) / 2)
