"""The kind of scenario ``merge``: an on-ramp joins an open highway by an acceleration lane."""

from dataclasses import dataclass

from drl_av.config.schema import setting
from drl_av.traffic.on_ramp import OnRamp
from drl_av.traffic.open_road import Edge, OpenPlan, open_kind
from drl_av.traffic.road import OPEN_LAP_M, Road


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
        """Return the road: a highway before, beside and after its acceleration lane, and a ramp."""
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
