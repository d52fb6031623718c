"""Gaps and lanes on a road, closed to a loop or open; pure geometry, no SUMO."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ROUNDING = 1e-9
"""Share of a lane by which a body may lie beyond a line, because numbers are rounded."""
CENTERED_M = 0.1
"""A vehicle this near its lane's centre is in no lane change, and may request one (ours)."""
ARRIVED_M = 0.05
"""A lane change has ended this near a lane's centre (ours).

Smaller than ``CENTERED_M``: the check ``strict`` must not take a vehicle that still moves to a
centre for one that has arrived there.
"""


OPEN_LAP_M = 2.0**20
"""Lap of every open road, about 1,000 km; a power of two, so that positions are not rounded."""


@dataclass(frozen=True)
class PartialLane:
    """A lane of an open road that begins or ends on the way, as an acceleration lane does."""

    lane: int
    begin_m: float
    end_m: float
    joined_from_m: float
    """From here on vehicles may change between it and the lane to its left."""
    joined_to_m: float
    """Up to here they may; elsewhere the two lanes are divided."""


class Barrier(NamedTuple):
    """An obstacle of no length across a part of the road, at which the ego must stop."""

    s_m: float
    right_m: float
    left_m: float
    """It extends between these two lateral positions, which are the same for a line."""


@dataclass(frozen=True)
class Road:
    """Parallel lanes, closed to a loop or open; lane 0 is the rightmost.

    Lateral positions ``y`` are metres from the centre of lane 0, left positive. Positions ``s``
    along the road are in [0, lap_m).
    """

    lap_m: float
    """The circumference of a loop. An open road is a short part of a lap of ``OPEN_LAP_M``, so that
    the shorter way round between two places on it is always the way along the road."""
    lane_width_m: float
    open_lanes: tuple[bool, ...]
    """One flag for each lane, rightmost first; False is a barricaded lane, which does not count."""
    end_m: float = math.inf
    """Where the ego's way along an open road ends; inf on a loop."""
    partial_lanes: tuple[PartialLane, ...] = ()
    """The lanes that do not extend along the whole road; they lie beside its other lanes."""

    @property
    def is_loop(self) -> bool:
        """Whether the road is closed to a loop."""
        return self.end_m == math.inf

    def lane_of(self, y_m: float) -> int:
        """Index of the lane at lateral position ``y_m``; the lane may be off the road."""
        return math.floor(y_m / self.lane_width_m + 0.5)

    def center_m(self, lane: int) -> float:
        """Lateral position of a lane's centre, metres."""
        return lane * self.lane_width_m

    def is_open(self, lane: int) -> bool:
        """Whether the lane exists somewhere on the road and is not barricaded."""
        return 0 <= lane < len(self.open_lanes) and self.open_lanes[lane]

    def is_open_at(self, lane: int, s_m: float) -> bool:
        """Whether the lane exists at a place of the road and is not barricaded."""
        return self.is_open(lane) and (
            self._part(lane, s_m) is not None
            or all(part.lane != lane for part in self.partial_lanes)
        )

    def is_beside(self, lane: int, other: int, s_m: float) -> bool:
        """Whether a vehicle may change from a lane to the next one at a place of the road."""
        right = min(lane, other)
        part = self._part(right, s_m)
        joined = part is None or part.joined_from_m <= s_m < part.joined_to_m
        return joined and self.is_open_at(other, s_m)

    def lane_end_m(self, lane: int, s_m: float) -> float:
        """Where the lane at a place of the road ends; inf if it does not end."""
        part = self._part(lane, s_m)
        return math.inf if part is None else part.end_m

    def _part(self, lane: int, s_m: float) -> PartialLane | None:
        for part in self.partial_lanes:
            if part.lane == lane and part.begin_m <= s_m < part.end_m:
                return part
        return None

    @cached_property
    def barriers(self) -> tuple[Barrier, ...]:
        """What stands on the road: the end of each lane, and where two lanes part."""
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

        ``s_m`` is the place of the body's front, which matters where lanes begin and end.
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
        """Signed distance along the road by the shorter way, in [-lap/2, lap/2); ahead positive."""
        half = self.lap_m / 2
        return (s_to_m - s_from_m + half) % self.lap_m - half
