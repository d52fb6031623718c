"""Lanes and distances on a road, closed to a loop or open; pure geometry, no SUMO."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
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


@dataclass(frozen=True)
class PartialLane:
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


def allowed_speed(limits: Iterable[SpeedLimit], front_m: float = 0.0, step_s: float = 0.0) -> float:
    """Return the largest speed of the next SUMO step that keeps all limits, m/s (ours).

    The front of the vehicle is at ``front_m``, in the coordinate of ``limits``. With this speed v
    it can brake with b = ``LIMIT_BRAKING_M_S2`` to each limit w that begins in a distance d ahead:
    v h + (v^2 - w^2) / 2b = d, where h is ``step_s``. The result is inf where there is no limit.
    """
    most_m_s, slack_m_s = math.inf, LIMIT_BRAKING_M_S2 * step_s
    for begin_m, end_m, limit_m_s in limits:
        left_m = begin_m - front_m
        if left_m > 0.0:
            square = slack_m_s**2 + 2 * LIMIT_BRAKING_M_S2 * left_m + limit_m_s**2
            most_m_s = min(most_m_s, max(limit_m_s, math.sqrt(square) - slack_m_s))
        elif front_m < end_m:
            most_m_s = min(most_m_s, limit_m_s)
    return most_m_s


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

    def is_open(self, lane: int) -> bool:
        """Whether the lane exists somewhere on the road and is not barricaded."""
        return 0 <= lane < len(self.open_lanes) and self.open_lanes[lane]

    def is_partial(self, lane: int) -> bool:
        """Whether the lane begins or ends within the road."""
        return any(part.lane == lane for part in self.partial_lanes)

    def is_open_at(self, lane: int, s_m: float) -> bool:
        """Whether the lane exists at the position ``s_m`` along the road and is not barricaded."""
        return self.is_open(lane) and (
            self._part(lane, s_m) is not None or not self.is_partial(lane)
        )

    def is_beside(self, lane: int, other: int, s_m: float) -> bool:
        """Whether a vehicle at ``s_m`` may change from ``lane`` to the adjacent lane ``other``."""
        right = min(lane, other)
        part = self._part(right, s_m)
        joined = part is None or part.joined_from_m <= s_m < part.joined_to_m
        return joined and self.is_open_at(other, s_m)

    def lane_end_m(self, lane: int, s_m: float) -> float:
        """Return the position where the lane at position ``s_m`` ends; inf if it does not end."""
        part = self._part(lane, s_m)
        return math.inf if part is None else part.end_m

    def mandatory_change(self, lane: int, s_m: float) -> MandatoryChange:
        """Return the lane changes that the ego must make from ``lane`` at the position ``s_m``.

        If the lane ends before the ego's route does, the ego must change to the nearest lane that
        continues beyond this end. Otherwise, if the road has an exit, the ego must be in
        ``exit_lane`` before the exit; this also applies where ``exit_lane`` has not begun yet. The
        result is ``NO_CHANGE`` if no lane change is necessary.
        """
        end_m = self.lane_end_m(lane, s_m)
        if end_m < min(self.end_m, self.exit_m):
            return MandatoryChange(self._lanes_aside(lane, end_m), end_m - s_m)
        if lane > self.exit_lane and s_m < self.exit_m < math.inf:
            return MandatoryChange(self.exit_lane - lane, self.exit_m - s_m)
        return NO_CHANGE

    def misses_exit(self, lane: int, s_m: float) -> bool:
        """Whether a vehicle in this lane with its front at ``s_m`` has passed the ego's exit."""
        return lane > self.exit_lane and s_m >= self.exit_m

    def _lanes_aside(self, lane: int, end_m: float) -> int:
        """Return the number of lanes, left positive, from a lane that ends to one that goes on."""
        before_m = math.nextafter(end_m, -math.inf)
        aside = sorted(range(-lane, len(self.open_lanes) - lane), key=abs)
        return next(
            lanes
            for lanes in aside
            if self.is_open_at(lane + lanes, before_m)
            and self.lane_end_m(lane + lanes, before_m) > end_m
        )

    def _part(self, lane: int, s_m: float) -> PartialLane | None:
        """Return the partial lane with this index at the position ``s_m``, or None."""
        for part in self.partial_lanes:
            if part.lane == lane and part.begin_m <= s_m < part.end_m:
                return part
        return None

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

    def holds(self, y_m: float, width_m: float, s_m: float = 0.0) -> bool:
        """Whether a body of width ``width_m`` with its centre at ``y_m`` is on open lanes only.

        ``s_m`` is the position of the body's front along the road; only partial lanes depend on it.
        """
        half = self.lane_width_m / 2
        right = math.floor((y_m - width_m / 2 + half) / self.lane_width_m + ROUNDING)
        left = math.ceil((y_m + width_m / 2 + half) / self.lane_width_m - ROUNDING) - 1
        if not self.partial_lanes:
            return all(map(self.is_open, range(right, left + 1)))
        return self.is_open_at(right, s_m) and all(
            self.is_beside(lane, lane + 1, s_m) for lane in range(right, left)
        )

    def ahead_m(self, s_from_m: float | FloatArray, s_to_m: FloatArray) -> FloatArray:
        """Return the signed distance along the road from one position to another, metres.

        It is the shorter way, in [-lap_m/2, lap_m/2), and positive if ``s_to_m`` is ahead. Arrays
        broadcast.
        """
        half = self.lap_m / 2
        return (s_to_m - s_from_m + half) % self.lap_m - half
