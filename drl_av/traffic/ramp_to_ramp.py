"""The kind of scenario ``ramp_to_ramp``: from an on-ramp over the highway to the next off-ramp."""

from dataclasses import dataclass

from drl_av.traffic.exit import OffRamp
from drl_av.traffic.kind import Edge, OpenPlan
from drl_av.traffic.merge import OnRamp
from drl_av.traffic.open_road import open_kind


@dataclass(frozen=True)
class RampToRampDescription(OnRamp, OffRamp):
    """A highway with an on-ramp and an off-ramp, which are both lane 0."""

    def plan(self) -> OpenPlan:
        """Return the road, on which the acceleration lane ends before the deceleration lane."""
        ramp = self.on_ramp
        off_ramp = self.off_ramp(ramp.end_m)
        road = self.road_to_exit(ramp, off_ramp)
        return OpenPlan(
            edges=(
                *self.entrance_edges,
                Edge("between", ramp.end_m, off_ramp.begin_m, range(1, self.lanes + 1)),
                *self.exit_edges(off_ramp),
            ),
            routes={
                "through": ("before", "beside", "between", "exit", "after"),
                "way": ("ramp", "beside", "between", "exit", "off_ramp"),
            },
            road=road,
            start=self.start_on_ramp(road.end_m),
        )


RAMP_TO_RAMP = open_kind(
    "an on-ramp, a highway and an off-ramp, by which the ego leaves", RampToRampDescription
)
