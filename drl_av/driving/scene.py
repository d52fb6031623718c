"""What a decision may rest on: the vehicles, the indicators, and a lane change in progress."""

from typing import NamedTuple

from drl_av.driving.affordances import Affordances
from drl_av.traffic.snapshot import Snapshot


class LaneChange(NamedTuple):
    """A lane change in progress, from the lane it came from to the lane it goes to.

    Where the ego is on the way stands in its lateral position alone: an abort turns the two
    lanes round, so that the way back takes as long as the way there.
    """

    origin: int
    target: int
    heading_rad: float = 0.0
    """Steering plant: angle between the ego and its lane, left positive; atan(v_y / v_x)."""

    @property
    def sign(self) -> int:
        """Direction across the road: left +1, right -1."""
        return 1 if self.target > self.origin else -1

    def reversed(self) -> "LaneChange":
        """The same lane change aborted."""
        return LaneChange(self.target, self.origin, self.heading_rad)


class Scene(NamedTuple):
    """All that a decision may rest on."""

    snapshot: Snapshot
    affordances: Affordances
    lane_change: LaneChange | None
