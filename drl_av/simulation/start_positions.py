"""The positions and speeds at which the vehicles of an episode start: random, but safe."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.road.road import FloatArray, Road

COMFORTABLE_BRAKING_M_S2 = 2.0
"""Braking with which each vehicle can stop behind the vehicle ahead at the start."""


class StartPositions(NamedTuple):
    """The start positions of vehicles along a ring; one row for each vehicle, the ego's first."""

    lane: npt.NDArray[np.intp]
    front_m: FloatArray
    """Position of the front bumper along the ring."""
    gap_m: FloatArray
    """Net gap to the vehicle ahead in the same lane."""
    leader: npt.NDArray[np.intp]
    """Row of the vehicle ahead in the same lane."""


def random_lanes(
    rng: np.random.Generator, n: int, road: Road, room: int, evenness: float
) -> npt.NDArray[np.intp]:
    """Draw the lane indices of ``n`` vehicles, shape (n,); the first is the lane of the ego.

    The ego is in each open lane with the same probability. For the other vehicles the probabilities
    of the lanes are drawn once, from a Dirichlet distribution with the parameter ``evenness``.
    ``room`` is the number of vehicles that fit on all open lanes together; no lane is overfilled.
    """
    open_lanes = np.flatnonzero(road.open_lanes)
    berths = np.full(len(open_lanes), room // len(open_lanes))
    shares = rng.dirichlet(np.full(len(open_lanes), evenness))
    draws, chosen, row = rng.random(n), np.empty(n, dtype=np.intp), 0
    while row < n:  # first for the ego, then until a lane is full
        chances = np.where(berths > 0, shares if row else 1.0, 0.0)
        if not chances.any():
            chances = (berths > 0).astype(float)
        limits = (chances / chances.sum()).cumsum()  # as rng.choice does, without its checks
        wanted = (limits / limits[-1]).searchsorted(draws[row : n if row else 1], side="right")
        for place, left in enumerate(berths):
            fills = np.flatnonzero(wanted == place)
            if 0 < left <= len(fills):
                wanted = wanted[: fills[left - 1] + 1]
        chosen[row : row + len(wanted)] = wanted
        berths -= np.bincount(wanted, minlength=len(berths))
        row += len(wanted)
    return open_lanes[chosen]


def ring_places(
    rng: np.random.Generator,
    lane: npt.NDArray[np.intp],
    ring_m: float,
    pitch_m: FloatArray,
    start_gap_m: float,
) -> StartPositions:
    """Draw the positions of vehicles in their lanes, along a ring of ``ring_m`` metres.

    ``pitch_m`` is the length of each vehicle plus ``start_gap_m``, the smallest gap.
    """
    n = len(lane)
    front_m, gap_m, leader = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.intp)
    for index in np.unique(lane):
        members = np.flatnonzero(lane == index)
        spare_m = rng.dirichlet(np.ones(len(members))) * (ring_m - pitch_m[members].sum())
        ends = np.cumsum(spare_m + pitch_m[members])
        front_m[members] = (rng.uniform(0, ring_m) + ends) % ring_m
        leader[members] = np.concatenate((members[1:], members[:1]))
        gap_m[members] = np.concatenate((spare_m[1:], spare_m[:1])) + start_gap_m
    return StartPositions(lane, front_m, gap_m, leader)


def safe_speeds(
    desired: FloatArray, headway: FloatArray, gap_m: FloatArray, leader: npt.NDArray[np.intp]
) -> FloatArray:
    """Return the largest safe start speed of each vehicle, m/s; all arrays have shape (n,).

    A vehicle does not exceed its desired speed, and keeps its headway. It can stop behind the
    vehicle ahead, in row ``leader``, if both brake with ``COMFORTABLE_BRAKING_M_S2``.
    """
    free_m = np.maximum(gap_m - STANDSTILL_GAP_M, 0.0)
    speed = np.minimum(desired, free_m / headway)
    for _ in range(len(speed)):
        reach = np.sqrt(speed[leader] ** 2 + 2 * COMFORTABLE_BRAKING_M_S2 * free_m)
        slower = np.minimum(speed, reach)
        if (slower == speed).all():
            break
        speed = slower
    return speed


def safe_speed(desired: float, headway_s: float, gap_m: float, speed_ahead: float) -> float:
    """Return the largest safe start speed of one vehicle, m/s, as ``safe_speeds`` does.

    ``speed_ahead`` is the speed of the vehicle ahead, m/s; without one ``gap_m`` is inf.
    """
    free_m = max(gap_m - STANDSTILL_GAP_M, 0.0)
    reach = math.sqrt(speed_ahead * speed_ahead + 2 * COMFORTABLE_BRAKING_M_S2 * free_m)
    return min(desired, free_m / headway_s, reach)
