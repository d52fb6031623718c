"""The open highways: straight, on-ramp (merge), off-ramp (exit), and from ramp to ramp."""

import math
from dataclasses import dataclass, replace

from drl_av.config import EgoConfig
from drl_av.config.section import setting
from drl_av.errors import ScenarioError
from drl_av.road.road import OPEN_LAP_M, PartialLane, Road, lane_end_m, mandatory_change
from drl_av.scenarios.layout import Edge, OpenPlan, OpenStart
from drl_av.scenarios.open_road import BEYOND_M, START_M, OpenDescription
from drl_av.scenarios.road_description import longest_m

OFF_RAMP_ASIDE_M = 40.0
"""Lateral distance from the highway at which the end of the off-ramp is drawn."""
AFTER_M = 100.0
"""Length of the ego's way after the point where the off-ramp separates from the highway."""
SHORTEST_M = 10.0
"""Length of the shortest part of a road."""


@dataclass(frozen=True)
class OffRamp(OpenDescription):
    """A highway with a deceleration lane, which is lane 0 and becomes the off-ramp.

    approach_m: distance to the end of the deceleration lane, metres: from the ego's start, or from
        the end of the acceleration lane (ours)
    deceleration_lane_m: length of the deceleration lane, metres (ours)

    Raises:
        ScenarioError: ``approach_m`` is too short for the deceleration lane, or too short for the
            lane changes to the exit.
    """

    approach_m: float = setting(1000.0, low=100, high=40_000)
    deceleration_lane_m: float = setting(250.0, low=50, high=2000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.deceleration_lane_m > self.approach_m - SHORTEST_M:
            raise ScenarioError(
                f"The scenario's deceleration_lane_m is {self.deceleration_lane_m:g}, but must be "
                f"at most approach_m - {SHORTEST_M:g}, {self.approach_m - SHORTEST_M:g}."
            )
        require_usual_ego_reaches_exit(self.plan(), self.speed_limit_m_s)

    def off_ramp(self, from_m: float) -> PartialLane:
        """Return the lane that begins as deceleration lane and becomes the off-ramp at the exit.

        The exit is ``approach_m`` after the position ``from_m``, m along the road.
        """
        exit_m = from_m + self.approach_m
        begin_m = exit_m - self.deceleration_lane_m
        return PartialLane(0, begin_m, math.inf, begin_m, exit_m)

    def exit_edges(self, off_ramp: PartialLane) -> tuple[Edge, ...]:
        """Return three edges: highway with deceleration lane, highway after it, and off-ramp."""
        exit_m, through = off_ramp.joined_to_m, range(1, self.lanes + 1)
        return (
            Edge("exit", off_ramp.begin_m, exit_m, range(self.lanes + 1)),
            Edge("after", exit_m, exit_m + AFTER_M, through),
            Edge(
                "off_ramp",
                exit_m,
                exit_m + AFTER_M,
                range(1),
                drawn_aside_m=(0.0, OFF_RAMP_ASIDE_M),
            ),
        )

    def road_to_exit(self, *partial_lanes: PartialLane) -> Road:
        """Return the road with these partial lanes; the last one is the off-ramp of the ego."""
        exit_m = partial_lanes[-1].joined_to_m
        lanes, end_m = (True,) * (self.lanes + 1), exit_m + AFTER_M
        return Road(OPEN_LAP_M, self.lane_width_m, lanes, end_m, partial_lanes, exit_m)


def require_usual_ego_reaches_exit(plan: OpenPlan, speed_limit_m_s: float) -> None:
    """Raise ScenarioError if an ego of the default settings cannot reach the exit in time."""
    ego = EgoConfig()
    slow = replace(ego, max_speed_m_s=min(ego.max_speed_m_s, speed_limit_m_s))
    require_reachable(plan.road, plan.start, slow)


def require_reachable(road: Road, start: OpenStart, ego: EgoConfig) -> None:
    """Raise ScenarioError if the ego cannot change lanes to its exit in time without braking.

    Each lane change takes ``lane_change_duration_s`` at ``max_speed_m_s`` (ours). A road without an
    exit is accepted.
    """
    if road.exit_m == math.inf:
        return
    lane, from_m = start.ego_lane, start.ego_front_m
    if lane is None:
        lane = max(start.lanes)
    elif mandatory_change(lane, from_m, road)[0] > 0:
        lane, from_m = lane + 1, lane_end_m(lane, from_m, road)
    changes, left_m = lane - road.exit_lane, road.exit_m - from_m
    needed_m = changes * ego.lane_change_duration_s * ego.max_speed_m_s
    if left_m < needed_m:
        raise ScenarioError(
            f"The way to the exit is {left_m:g} m long, but {changes} lane "
            f"change{'s' * (changes > 1)} of {ego.lane_change_duration_s:g} s at "
            f"{ego.max_speed_m_s:g} m/s take{'s' * (changes == 1)} {needed_m:g} m: make approach_m "
            f"at least {math.ceil(needed_m)}, or begin an imported route at least "
            f"{math.ceil(needed_m - left_m)} m earlier."
        )


@dataclass(frozen=True)
class ExitDescription(OffRamp):
    """A highway with an off-ramp; the ego starts in the leftmost lane."""

    meaning = "a deceleration lane and its off-ramp, by which the ego leaves from the left lane"

    def plan(self) -> OpenPlan:
        """Return the road: highway before, beside and after the deceleration lane, and off-ramp."""
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


GORE_M = 500.0
"""Position at which the ramp joins the highway."""
ON_RAMP_ASIDE_M = 20.0
"""Lateral distance from the highway at which the start of the ramp is drawn."""
SPEED_M_S = 15.0
"""Speed of the ego at its start on the ramp."""


@dataclass(frozen=True)
class OnRamp(OpenDescription):
    """A highway with an on-ramp, which is lane 0; the ego starts on the ramp.

    ramp_m: distance of the ego's start before the point where the ramp joins the highway, metres
        (ours)
    acceleration_lane_m: length of the acceleration lane, metres (ours)
    """

    ramp_m: float = setting(100.0, low=20, high=400)
    acceleration_lane_m: float = setting(250.0, low=50, high=2000)

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
            Edge("ramp", ramp.begin_m, GORE_M, range(1), drawn_aside_m=(ON_RAMP_ASIDE_M, 0.0)),
            Edge("beside", GORE_M, ramp.end_m, range(self.lanes + 1)),
        )

    def start_on_ramp(self, end_m: float) -> OpenStart:
        """Return the start positions on a road on which the ego's way ends at ``end_m``."""
        through, front_m = tuple(range(1, self.lanes + 1)), GORE_M - self.ramp_m
        return OpenStart(through, end_m + BEYOND_M, self.flow_per_h, 0, front_m, SPEED_M_S)


@dataclass(frozen=True)
class MergeDescription(OnRamp):
    """A highway with an on-ramp, from which the ego merges.

    after_m: distance from the end of the acceleration lane to the end of the road, metres (ours)
    """

    meaning = "an on-ramp and its acceleration lane, from which the ego merges"
    after_m: float = setting(500.0, low=50, high=40_000)

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


@dataclass(frozen=True)
class RampToRampDescription(OnRamp, OffRamp):
    """A highway with an on-ramp and an off-ramp, which are both lane 0."""

    meaning = "an on-ramp, a highway and an off-ramp, by which the ego leaves"

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


@dataclass(frozen=True)
class StraightDescription(OpenDescription):
    """An open highway with inflow in each lane.

    length_m: distance from the ego's start to the end, metres (ours)
    """

    meaning = "an open highway with inflow at its beginning"
    length_m: float = setting(2000.0, low=300, high=40_000)

    def plan(self) -> OpenPlan:
        """Return the road, which has one edge with all lanes."""
        end_m, lanes = START_M + self.length_m, range(self.lanes)
        return OpenPlan(
            edges=(Edge("road", 0.0, end_m, lanes),),
            routes={"road": ("road",)},
            road=Road(OPEN_LAP_M, self.lane_width_m, (True,) * self.lanes, end_m),
            start=OpenStart(tuple(lanes), end_m + BEYOND_M, self.flow_per_h, None, START_M),
        )
