"""The scene, which is the input of a decision: vehicles, indicators, lane change in progress."""

from typing import NamedTuple

from drl_av.driving.affordances import Affordances
from drl_av.traffic.snapshot import Snapshot


class LaneChange(NamedTuple):
    """A lane change in progress, from the lane it came from to the lane it goes to.

    The ego's lateral position alone says how far the lane change has advanced. An abort exchanges
    the two lanes, so that the way back takes as long as the way there took.
    """

    origin: int
    target: int
    heading_rad: float = 0.0
    """Angle between the ego and its lane, atan(v_y / v_x), left positive; steering plant only."""

    @property
    def sign(self) -> int:
        """Direction of the lane change: left +1, right -1."""
        return 1 if self.target > self.origin else -1

    def reversed(self) -> "LaneChange":
        """The lane change back to the lane where this one started."""
        return LaneChange(self.target, self.origin, self.heading_rad)


class Scene(NamedTuple):
    """All information that a driver or a safety check may use for a decision."""

    snapshot: Snapshot
    affordances: Affordances
    lane_change: LaneChange | None
