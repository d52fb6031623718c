"""The kind of scenario ``exit``: an open highway that the ego leaves by an off-ramp."""

from dataclasses import dataclass

from drl_av.traffic.kind import Edge, OpenPlan, OpenStart
from drl_av.traffic.off_ramp import OffRamp
from drl_av.traffic.open_road import BEYOND_M, START_M, open_kind


@dataclass(frozen=True)
class ExitDescription(OffRamp):
    """A highway with an off-ramp; the ego starts in the left lane."""

    def plan(self) -> OpenPlan:
        """Return the road: a highway before, beside and after its deceleration lane, and a ramp."""
        off_ramp, through = self.off_ramp(START_M), range(1, self.lanes + 1)
        road = self.road_to_exit(off_ramp)
        return OpenPlan(
            edges=(Edge("before", 0.0, off_ramp.begin_m, through), *self.exit_edges(off_ramp)),
            routes={"through": ("before", "exit", "after"), "exit": ("before", "exit", "off_ramp")},
            road=road,
            start=OpenStart(
                tuple(through), road.end_m + BEYOND_M, self.flow_per_h, self.lanes, START_M
            ),
        )


EXIT = open_kind(
    "a deceleration lane and its off-ramp, by which the ego leaves from the left lane",
    ExitDescription,
)
