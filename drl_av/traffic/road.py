"""Gaps and lanes on a circular road; pure geometry, no SUMO."""

import math
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Road:
    """A closed loop of parallel lanes of equal length; lane 0 is the rightmost.

    Lateral positions ``y`` are metres from the centre of lane 0, left positive.
    """

    circumference_m: float
    lane_width_m: float
    open_lanes: tuple[bool, ...]
    """One flag for each lane, rightmost first; False is a barricaded lane, which does not count."""

    def lane_of(self, y_m: float) -> int:
        """Index of the lane at lateral position ``y_m``; the lane may be off the road."""
        return math.floor(y_m / self.lane_width_m + 0.5)

    def center_m(self, lane: int) -> float:
        """Lateral position of a lane's centre, metres."""
        return lane * self.lane_width_m

    def is_open(self, lane: int) -> bool:
        """Whether the lane exists and is not barricaded."""
        return 0 <= lane < len(self.open_lanes) and self.open_lanes[lane]

    def holds(self, y_m: float, width_m: float) -> bool:
        """Whether a body of width ``width_m`` with its centre at ``y_m`` is on open lanes only."""
        half = self.lane_width_m / 2
        right = math.floor((y_m - width_m / 2 + half) / self.lane_width_m + ROUNDING)
        left = math.ceil((y_m + width_m / 2 + half) / self.lane_width_m - ROUNDING) - 1
        return all(map(self.is_open, range(right, left + 1)))

    def ahead_m(self, s_from_m: float | FloatArray, s_to_m: FloatArray) -> FloatArray:
        """Signed distance along the loop by the shorter way, in [-C/2, C/2); positive is ahead."""
        half = self.circumference_m / 2
        return (s_to_m - s_from_m + half) % self.circumference_m - half
