"""The kind of scenario ``straight``: an open highway that vehicles enter and leave at its ends."""

from dataclasses import dataclass

from drl_av.config.schema import setting
from drl_av.traffic.kind import Edge, OpenPlan, OpenStart
from drl_av.traffic.open_road import BEYOND_M, START_M, OpenDescription, open_kind
from drl_av.traffic.road import OPEN_LAP_M, Road


@dataclass(frozen=True)
class StraightDescription(OpenDescription):
    """An open highway with inflow in each lane."""

    length_m: float = setting(
        2000.0, "ours", "distance from the ego's start to the end, metres", low=300, high=40_000
    )

    def plan(self) -> OpenPlan:
        """Return the road, which has one edge with all lanes."""
        end_m, lanes = START_M + self.length_m, range(self.lanes)
        return OpenPlan(
            edges=(Edge("road", 0.0, end_m, lanes),),
            routes={"road": ("road",)},
            road=Road(OPEN_LAP_M, self.lane_width_m, (True,) * self.lanes, end_m),
            start=OpenStart(tuple(lanes), end_m + BEYOND_M, self.flow_per_h, None, START_M),
        )


STRAIGHT = open_kind("an open highway with inflow at its beginning", StraightDescription)
