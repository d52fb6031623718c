"""The kind of scenario ``merge``: an on-ramp joins an open highway by an acceleration lane."""

from dataclasses import dataclass

from drl_av.config.schema import setting
from drl_av.traffic.description import longest_m
from drl_av.traffic.kind import OpenStart
from drl_av.traffic.open_road import (
    BEYOND_M,
    Edge,
    OpenDescription,
    OpenPlan,
    open_kind,
)
from drl_av.traffic.road import OPEN_LAP_M, PartialLane, Road

GORE_M = 500.0
"""Position at which the ramp joins the highway."""
RAMP_ASIDE_M = 20.0
"""Lateral distance from the highway at which the start of the ramp is drawn."""
RAMP_SPEED_M_S = 15.0
"""Speed of the ego at its start on the ramp."""


@dataclass(frozen=True)
class MergeDescription(OpenDescription):
    """A highway with an on-ramp, which is lane 0; the ego starts on the ramp."""

    ramp_m: float = setting(
        100.0,
        "ours",
        "distance of the ego's start before the point where the ramp joins the highway, metres",
        low=20,
        high=400,
    )
    acceleration_lane_m: float = setting(
        250.0, "ours", "length of the acceleration lane, metres", low=50, high=2000
    )
    after_m: float = setting(
        500.0,
        "ours",
        "distance from the end of the acceleration lane to the end of the road, metres",
        low=50,
        high=40_000,
    )

    def plan(self) -> OpenPlan:
        """Return the road: a highway before, beside and after its acceleration lane, and a ramp."""
        lane_end_m = GORE_M + self.acceleration_lane_m
        end_m, front_m = lane_end_m + self.after_m, GORE_M - self.ramp_m
        begin_m = front_m - longest_m(self)
        through = range(1, self.lanes + 1)
        ramp = PartialLane(0, begin_m, lane_end_m, GORE_M, lane_end_m)
        road = Road(OPEN_LAP_M, self.lane_width_m, (True,) * (self.lanes + 1), end_m, (ramp,))
        return OpenPlan(
            edges=(
                Edge("before", 0.0, GORE_M, through),
                Edge("ramp", begin_m, GORE_M, range(1), drawn_aside_m=(RAMP_ASIDE_M, 0.0)),
                Edge("beside", GORE_M, lane_end_m, range(self.lanes + 1)),
                Edge("after", lane_end_m, end_m, through),
            ),
            routes={"through": ("before", "beside", "after"), "ramp": ("ramp", "beside", "after")},
            road=road,
            start=OpenStart(
                tuple(through), end_m + BEYOND_M, self.flow_per_h, 0, front_m, RAMP_SPEED_M_S
            ),
        )


MERGE = open_kind(
    "an on-ramp and its acceleration lane, from which the ego merges", MergeDescription
)
