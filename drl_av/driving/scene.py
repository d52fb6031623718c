"""The scene, the input of a decision: all vehicles, the indicators, the lane change in progress."""

from typing import NamedTuple

from drl_av.driving.affordances import Affordances
from drl_av.road.snapshot import Snapshot


class LaneChange(NamedTuple):
    """A lane change in progress; ``origin`` and ``target`` are lane indices, 0 is the rightmost.

    Its progress follows from the ego's lateral position alone. An abort exchanges ``origin`` and
    ``target``; the ego then needs as much time to return as it has needed so far.
    """

    origin: int
    target: int
    heading_rad: float = 0.0
    """Angle between the ego and its lane, atan(v_y / v_x), left positive; steering plant only."""

    @property
    def sign(self) -> int:
        """Direction of the lane change: +1 left, -1 right."""
        return 1 if self.target > self.origin else -1

    def reversed(self) -> "LaneChange":
        """Return the lane change back to the lane where this one started."""
        return LaneChange(self.target, self.origin, self.heading_rad)


class Scene(NamedTuple):
    """All information that a driver or a safety check may use for a decision.

    ``lane_change`` is the ego's lane change in progress, or None.
    """

    snapshot: Snapshot
    affordances: Affordances
    lane_change: LaneChange | None
