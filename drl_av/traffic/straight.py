"""``straight``: an open highway, on which vehicles enter at the beginning and leave at the end."""

from dataclasses import dataclass

from drl_av.config.schema import setting
from drl_av.traffic.kind import OpenStart
from drl_av.traffic.open_road import (
    BEYOND_M,
    Edge,
    OpenDescription,
    OpenPlan,
    open_kind,
)
from drl_av.traffic.road import OPEN_LAP_M, Road

START_M = 300.0
"""Where the ego starts, so that all followers in range are on the road."""


@dataclass(frozen=True)
class StraightDescription(OpenDescription):
    """An open highway with inflow in each lane."""

    length_m: float = setting(
        2000.0, "ours", "way of the ego from its start to the end, metres", low=300, high=40_000
    )

    def plan(self) -> OpenPlan:
        """One edge with all lanes."""
        end_m, lanes = START_M + self.length_m, range(self.lanes)
        return OpenPlan(
            edges=(Edge("road", 0.0, end_m, lanes),),
            routes={"road": ("road",)},
            road=Road(OPEN_LAP_M, self.lane_width_m, (True,) * self.lanes, end_m),
            start=OpenStart(tuple(lanes), end_m + BEYOND_M, self.flow_per_h, None, START_M),
        )


STRAIGHT = open_kind("an open highway with inflow at its beginning", StraightDescription)
