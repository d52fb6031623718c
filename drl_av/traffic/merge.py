"""The kind of scenario ``merge``: an on-ramp joins an open highway by an acceleration lane."""

from dataclasses import dataclass

from drl_av.config.schema import setting
from drl_av.traffic.description import longest_m
from drl_av.traffic.kind import Edge, OpenPlan, OpenStart
from drl_av.traffic.open_road import BEYOND_M, OpenDescription, open_kind
from drl_av.traffic.road import OPEN_LAP_M, PartialLane, Road

GORE_M = 500.0
"""Position at which the ramp joins the highway."""
ASIDE_M = 20.0
"""Lateral distance from the highway at which the start of the ramp is drawn."""
SPEED_M_S = 15.0
"""Speed of the ego at its start on the ramp."""


@dataclass(frozen=True)
class OnRamp(OpenDescription):
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

    @property
    def on_ramp(self) -> PartialLane:
        """The ramp and its acceleration lane; vehicles can change lanes only on the latter."""
        begin_m = GORE_M - self.ramp_m - longest_m(self)
        end_m = GORE_M + self.acceleration_lane_m
        return PartialLane(0, begin_m, end_m, GORE_M, end_m)

    @property
    def entrance_edges(self) -> tuple[Edge, ...]:
        """Three edges: highway before the ramp, ramp, and highway with the acceleration lane."""
        ramp, through = self.on_ramp, range(1, self.lanes + 1)
        return (
            Edge("before", 0.0, GORE_M, through),
            Edge("ramp", ramp.begin_m, GORE_M, range(1), drawn_aside_m=(ASIDE_M, 0.0)),
            Edge("beside", GORE_M, ramp.end_m, range(self.lanes + 1)),
        )

    def start_on_ramp(self, end_m: float) -> OpenStart:
        """Return the start positions on a road on which the ego's way ends at ``end_m``."""
        through, front_m = tuple(range(1, self.lanes + 1)), GORE_M - self.ramp_m
        return OpenStart(through, end_m + BEYOND_M, self.flow_per_h, 0, front_m, SPEED_M_S)


@dataclass(frozen=True)
class MergeDescription(OnRamp):
    """A highway with an on-ramp, from which the ego merges."""

    after_m: float = setting(
        500.0,
        "ours",
        "distance from the end of the acceleration lane to the end of the road, metres",
        low=50,
        high=40_000,
    )

    def plan(self) -> OpenPlan:
        """Return the road: on-ramp, and highway before, beside and after the acceleration lane."""
        ramp = self.on_ramp
        end_m = ramp.end_m + self.after_m
        every = (True,) * (self.lanes + 1)
        return OpenPlan(
            edges=(
                *self.entrance_edges,
                Edge("after", ramp.end_m, end_m, range(1, self.lanes + 1)),
            ),
            routes={"through": ("before", "beside", "after"), "ramp": ("ramp", "beside", "after")},
            road=Road(OPEN_LAP_M, self.lane_width_m, every, end_m, (ramp,)),
            start=self.start_on_ramp(end_m),
        )


MERGE = open_kind(
    "an on-ramp and its acceleration lane, from which the ego merges", MergeDescription
)
