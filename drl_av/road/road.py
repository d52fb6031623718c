"""Lanes and distances on a road, closed to a loop or open; pure geometry, no SUMO.

The functions take a ``Road`` in Python, and its ``RoadNumbers`` in compiled functions; those that
are marked for compilation take numbers alone.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray
from drl_av.compiled import borrowing, inlined, squared

ROUNDING = 1e-9
"""Share of a lane width by which a body may lie over a lane marking, to allow for rounding."""
CENTERED_M = 0.1
"""A vehicle within this distance of its lane's centre may request a lane change (ours)."""
ARRIVED_M = 0.05
"""A lane change has ended if the vehicle is within this distance of a lane's centre (ours).

Smaller than ``CENTERED_M``: the check ``strict`` must not take a vehicle that still moves to a
centre for one that has arrived there.
"""


OPEN_LAP_M = 2.0**20
"""``Road.lap_m`` of each open road, about 1,000 km; a power of two avoids rounding errors."""


class PartialLane(NamedTuple):
    """A lane that begins or ends within an open road, such as an acceleration lane.

    It lies to the right or to the left of the lanes that extend along the whole road.
    """

    lane: int
    begin_m: float
    end_m: float
    joined_from_m: float
    """Start of the part in which vehicles may change between this lane and the lane to its left."""
    joined_to_m: float
    """End of the part that begins at ``joined_from_m``."""


class Barrier(NamedTuple):
    """An obstacle of zero length across a part of the road, which the ego must not pass."""

    s_m: float
    right_m: float
    left_m: float
    """The lateral positions of its two ends; they are equal if only a lane marking is blocked."""


class SpeedLimit(NamedTuple):
    """A part of a lane with its speed limit; a vehicle obeys it while its front is there."""

    begin_m: float
    end_m: float
    limit_m_s: float


LIMIT_BRAKING_M_S2 = 2.0
"""Braking with which the ego slows down for a lower speed limit ahead (ours)."""


def allowed_by(
    begin_m: float, end_m: float, limit_m_s: float, front_m: float, step_s: float
) -> float:
    """Return the largest speed of the next SUMO step that keeps one limit, m/s (ours).

    The front of the vehicle is at ``front_m``. With this speed v it can brake with b =
    ``LIMIT_BRAKING_M_S2`` to the limit w if that begins in a distance d ahead: v h + (v^2 - w^2) /
    2b = d, where h is ``step_s``. The result is inf where the limit does not apply.
    """
    left_m, slack_m_s = begin_m - front_m, LIMIT_BRAKING_M_S2 * step_s
    if left_m > 0.0 and limit_m_s < math.inf:
        square = squared(slack_m_s) + 2 * LIMIT_BRAKING_M_S2 * left_m + squared(limit_m_s)
        return max(limit_m_s, math.sqrt(square) - slack_m_s)
    return limit_m_s if front_m < end_m else math.inf


def allowed_speed(limits: Iterable[SpeedLimit], front_m: float = 0.0, step_s: float = 0.0) -> float:
    """Return the largest speed that keeps all limits (``allowed_by``), m/s; inf without a limit."""
    return min((allowed_by(*limit, front_m, step_s) for limit in limits), default=math.inf)


class ForbiddenLine(NamedTuple):
    """A part of a lane from which no vehicle may change to the lane on one side."""

    lane: int
    side: int
    """+1 if the change to the left is forbidden, -1 if the change to the right is."""
    begin_m: float
    end_m: float


LANE_CHANGE_S = 5.0
"""Time for which a line must be open ahead of an ego that begins to cross it, seconds (T_LC)."""
LANE_CHANGE_DUE_M = 400.0
"""Mandatory lane changes are urgent if less than this distance, metres, is left for each (ours)."""


class MandatoryChange(NamedTuple):
    """The lane changes that the ego must make to reach its exit or to leave a lane that ends."""

    lanes: int
    """Number of lane changes, positive to the left, negative to the right; 0 if none is needed."""
    within_m: float
    """Distance along the road within which they must be complete, metres; inf if none is needed."""


NO_CHANGE = MandatoryChange(0, math.inf)


@dataclass(frozen=True)
class Road:
    """Parallel lanes, closed to a loop or open; lane 0 is the rightmost.

    Lateral positions ``y`` are metres from the centre of lane 0, left positive. Positions ``s``
    along the road are in [0, lap_m).
    """

    lap_m: float
    """The circumference of a loop. An open road is a short part of a loop of ``OPEN_LAP_M``, so the
    shorter way between two positions is always the way along the road."""
    lane_width_m: float
    open_lanes: tuple[bool, ...]
    """One flag for each lane, rightmost first; False if the lane is barricaded."""
    end_m: float = math.inf
    """The position at which the ego's way along an open road ends; inf on a loop."""
    partial_lanes: tuple[PartialLane, ...] = ()
    """The lanes that do not extend along the whole road."""
    exit_m: float = math.inf
    """The position up to which a vehicle can enter the ego's exit; inf without an exit."""
    exit_lane: int = 0
    """The leftmost lane that leads to the exit; each lane to its right leads there too."""
    speed_limits: tuple[tuple[SpeedLimit, ...], ...] = ()
    """For each lane its parts in driving order, each with its limit; empty if the road has one
    limit, which no setting may exceed."""
    forbidden_lines: tuple[ForbiddenLine, ...] = ()

    @cached_property
    def is_loop(self) -> bool:
        """Whether the road is closed to a loop."""
        return self.end_m == math.inf

    def lane_of(self, y_m: float) -> int:
        """Return the index of the lane that contains ``y_m``; the road may not have this lane."""
        return math.floor(y_m / self.lane_width_m + 0.5)

    def center_m(self, lane: int) -> float:
        """Return the lateral position of a lane's centre, metres."""
        return lane * self.lane_width_m

    def misses_exit(self, lane: int, s_m: float) -> bool:
        """Whether a vehicle in this lane with its front at ``s_m`` has passed the ego's exit."""
        return lane > self.exit_lane and s_m >= self.exit_m

    @cached_property
    def barriers(self) -> tuple[Barrier, ...]:
        """The obstacles where partial lanes end, and where one separates from its neighbour."""
        found = []
        for part in self.partial_lanes:
            line_m = self.center_m(part.lane) + self.lane_width_m / 2
            if part.end_m < math.inf:
                found.append(Barrier(part.end_m, line_m - self.lane_width_m, line_m))
            if part.joined_to_m < part.end_m:
                found.append(Barrier(part.joined_to_m, line_m, line_m))
        return tuple(found)

    def ahead_m(self, s_from_m: float | FloatArray, s_to_m: FloatArray) -> FloatArray:
        """Return the signed distance along the road from one position to another, metres.

        It is the shorter way, in [-lap_m/2, lap_m/2), and positive if ``s_to_m`` is ahead. Arrays
        broadcast.
        """
        half = self.lap_m / 2
        return (s_to_m - s_from_m + half) % self.lap_m - half


class RoadNumbers(NamedTuple):
    """A road as numbers and arrays; the fields of ``Road`` have the same names and meanings."""

    lap_m: float
    lane_width_m: float
    open_lanes: BoolArray
    """Shape (lanes,), rightmost lane first."""
    end_m: float
    exit_m: float
    exit_lane: int
    partial_lanes: FloatArray
    """Shape (partial lanes, 5); the columns are the fields of ``PartialLane``."""
    barriers: FloatArray
    """Shape (barriers, 3); the columns are the fields of ``Barrier``."""
    speed_limits: FloatArray
    """Shape (limits, 4): the lane, and the fields of its ``SpeedLimit``."""
    forbidden_lines: FloatArray
    """Shape (lines, 4); the columns are the fields of ``ForbiddenLine``."""


def is_open(lane: int, road: Road | RoadNumbers) -> bool:
    """Return whether the lane exists somewhere on the road and is not barricaded."""
    return 0 <= lane < len(road.open_lanes) and bool(road.open_lanes[lane])


def is_partial(lane: int, road: Road | RoadNumbers) -> bool:
    """Return whether the lane begins or ends within the road."""
    found = False
    for row in range(len(road.partial_lanes)):
        found = found or bool(road.partial_lanes[row][0] == lane)
    return found


def partial_lane(lane: int, s_m: float, road: Road | RoadNumbers) -> int:
    """Return the row of the partial lane with this index at the position ``s_m``, or -1."""
    for row in range(len(road.partial_lanes)):
        part = road.partial_lanes[row]
        if part[0] == lane and part[1] <= s_m < part[2]:
            return row
    return -1


def is_open_at(lane: int, s_m: float, road: Road | RoadNumbers) -> bool:
    """Return whether the lane exists at ``s_m`` along the road and is not barricaded."""
    if not is_open(lane, road):
        return False
    return not is_partial(lane, road) or partial_lane(lane, s_m, road) >= 0


def is_beside(lane: int, other: int, s_m: float, road: Road | RoadNumbers) -> bool:
    """Return whether a vehicle at ``s_m`` may change from ``lane`` to the adjacent ``other``."""
    row = partial_lane(min(lane, other), s_m, road)
    if row >= 0 and not road.partial_lanes[row][3] <= s_m < road.partial_lanes[row][4]:
        return False
    return is_open_at(other, s_m, road)


def lane_end_m(lane: int, s_m: float, road: Road | RoadNumbers) -> float:
    """Return the position where the lane at position ``s_m`` ends; inf if it does not end."""
    row = partial_lane(lane, s_m, road)
    return math.inf if row < 0 else road.partial_lanes[row][2]


def mandatory_change(lane: int, s_m: float, road: Road | RoadNumbers) -> tuple[int, float]:
    """Return the lane changes that the ego must make from ``lane`` at the position ``s_m``.

    If the lane ends before the ego's route does, the ego must change to the nearest lane that
    continues beyond this end. Otherwise, if the road has an exit, the ego must be in ``exit_lane``
    before the exit; this also applies where ``exit_lane`` has not begun yet.

    Returns:
        The fields of ``MandatoryChange``; those of ``NO_CHANGE`` if no lane change is necessary.
    """
    end_m = lane_end_m(lane, s_m, road)
    if end_m < min(road.end_m, road.exit_m):
        return lanes_aside(lane, end_m, road), end_m - s_m
    if lane > road.exit_lane and s_m < road.exit_m < math.inf:
        return road.exit_lane - lane, road.exit_m - s_m
    return 0, math.inf


def lanes_aside(lane: int, end_m: float, road: Road | RoadNumbers) -> int:
    """Return the number of lanes, left positive, from a lane that ends to one that goes on."""
    before_m = np.nextafter(end_m, -math.inf)
    for distance in range(len(road.open_lanes)):
        for lanes in (-distance, distance):
            other = lane + lanes
            if is_open_at(other, before_m, road) and lane_end_m(other, before_m, road) > end_m:
                return lanes
    return 0


def holds(y_m: float, width_m: float, s_m: float, road: Road | RoadNumbers) -> bool:
    """Return whether a body of width ``width_m`` with its centre at ``y_m`` is on open lanes only.

    ``s_m`` is the position of the body's front along the road; only partial lanes depend on it.
    """
    half_m = road.lane_width_m / 2
    right = math.floor((y_m - width_m / 2 + half_m) / road.lane_width_m + ROUNDING)
    left = math.ceil((y_m + width_m / 2 + half_m) / road.lane_width_m - ROUNDING) - 1
    found = is_open_at(right, s_m, road)
    for lane in range(right, left):
        found = found and is_beside(lane, lane + 1, s_m, road)
    return found


@lru_cache(maxsize=64)
def road_numbers(road: Road) -> RoadNumbers:
    """Return a road as numbers."""
    limits = [(lane, *one) for lane, found in enumerate(road.speed_limits) for one in found]
    return RoadNumbers(
        float(road.lap_m),
        float(road.lane_width_m),
        np.array(road.open_lanes, dtype=np.bool_),
        float(road.end_m),
        float(road.exit_m),
        int(road.exit_lane),
        np.array(road.partial_lanes, dtype=np.float64).reshape(-1, 5),
        np.array(road.barriers, dtype=np.float64).reshape(-1, 3),
        np.array(limits, dtype=np.float64).reshape(-1, 4),
        np.array(road.forbidden_lines, dtype=np.float64).reshape(-1, 4),
    )


@inlined
def lane_of(y_m: float, lane_width_m: float) -> int:
    """Return the index of the lane that contains ``y_m``, as ``Road.lane_of``."""
    return math.floor(y_m / lane_width_m + 0.5)


@borrowing
def may_cross(lane: int, side: int, from_m: float, to_m: float, road: RoadNumbers) -> bool:
    """Whether no ``ForbiddenLine`` lies on this side of the lane in a part of the road."""
    for row in range(len(road.forbidden_lines)):
        line = road.forbidden_lines[row]
        if line[0] == lane and line[1] == side and line[2] <= to_m and from_m < line[3]:
            return False
    return True


@borrowing
def allowed_speed_in(limits: FloatArray, lane: int, front_m: float, step_s: float) -> float:
    """Return ``allowed_speed`` in a lane; ``limits`` are ``RoadNumbers.speed_limits``."""
    most_m_s = np.inf
    for row in range(len(limits)):
        if limits[row, 0] == lane:
            limit = limits[row, 1], limits[row, 2], limits[row, 3]
            most_m_s = min(most_m_s, allowed_by(*limit, front_m, step_s))
    return most_m_s


@inlined
def ahead_m(s_from_m: float, s_to_m: float, lap_m: float) -> float:
    """Return the signed distance along the road, the shorter way, as ``Road.ahead_m``."""
    return around(s_to_m - s_from_m + lap_m / 2, lap_m) - lap_m / 2


def around(x_m: float, lap_m: float) -> float:
    """Return ``x_m % lap_m``, to the bit, but without a division if ``x_m`` is within two laps."""
    if -lap_m <= x_m < 2.0 * lap_m:  # without a branch that depends on the vehicle
        from_m = x_m + lap_m if x_m < 0.0 else x_m
        return from_m - lap_m if x_m >= lap_m else from_m
    return x_m % lap_m
