"""An off-ramp, which parts from an open highway as its deceleration lane; the ego leaves by it."""

import math
from dataclasses import dataclass

from drl_av.config.schema import setting
from drl_av.errors import ScenarioError
from drl_av.traffic.kind import Edge
from drl_av.traffic.open_road import OpenDescription
from drl_av.traffic.road import OPEN_LAP_M, PartialLane, Road

ASIDE_M = 40.0
"""Lateral distance from the highway at which the end of the off-ramp is drawn."""
AFTER_M = 100.0
"""Distance from the point where the off-ramp parts from the highway to the end of the ego's way."""
SHORTEST_M = 10.0
"""Length of the shortest part of a road."""


@dataclass(frozen=True)
class OffRamp(OpenDescription):
    """A highway with a deceleration lane, which is lane 0 and becomes the off-ramp.

    Raises:
        ScenarioError: the deceleration lane is longer than the way to its end.
    """

    approach_m: float = setting(
        1000.0,
        "ours",
        "distance to the end of the deceleration lane, metres: from the ego's start, or from the "
        "end of the acceleration lane",
        low=100,
        high=40_000,
    )
    deceleration_lane_m: float = setting(
        250.0, "ours", "length of the deceleration lane, metres", low=50, high=2000
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.deceleration_lane_m > self.approach_m - SHORTEST_M:
            raise ScenarioError(
                f"The scenario's deceleration_lane_m is {self.deceleration_lane_m:g}, but must be "
                f"at most approach_m - {SHORTEST_M:g}, {self.approach_m - SHORTEST_M:g}."
            )

    def off_ramp(self, from_m: float) -> PartialLane:
        """Return the deceleration lane and the off-ramp, which is divided from the highway.

        ``from_m`` is the position at which the way to the exit begins.
        """
        exit_m = from_m + self.approach_m
        begin_m = exit_m - self.deceleration_lane_m
        return PartialLane(0, begin_m, math.inf, begin_m, exit_m)

    def exit_edges(self, off_ramp: PartialLane) -> tuple[Edge, ...]:
        """Return the highway beside the deceleration lane and after it, and the off-ramp."""
        exit_m, through = off_ramp.joined_to_m, range(1, self.lanes + 1)
        return (
            Edge("exit", off_ramp.begin_m, exit_m, range(self.lanes + 1)),
            Edge("after", exit_m, exit_m + AFTER_M, through),
            Edge("off_ramp", exit_m, exit_m + AFTER_M, range(1), drawn_aside_m=(0.0, ASIDE_M)),
        )

    def road_to_exit(self, *partial_lanes: PartialLane) -> Road:
        """Return the road on which the ego's way leads over the last of these lanes."""
        exit_m = partial_lanes[-1].joined_to_m
        lanes, end_m = (True,) * (self.lanes + 1), exit_m + AFTER_M
        return Road(OPEN_LAP_M, self.lane_width_m, lanes, end_m, partial_lanes, exit_m)
