"""The open highways: straight, on-ramp (merge), off-ramp (exit), and from ramp to ramp."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

from drl_av.config import EgoConfig
from drl_av.config.section import setting
from drl_av.errors import ScenarioError
from drl_av.road.road import OPEN_LAP_M, PartialLane, Road, lane_end_m, mandatory_change
from drl_av.scenarios.layout import Edge, OpenPlan, OpenStart
from drl_av.scenarios.open_road import BEYOND_M, START_M, OpenDescription

ON_RAMP_ASIDE_M, OFF_RAMP_ASIDE_M = 20.0, 40.0
"""Lateral distance from the highway at which the start of the on-ramp and the end of the off-ramp
are drawn."""
GORE_M = 500.0
"""Position at which the on-ramp joins the highway."""
SPEED_M_S = 15.0
"""Speed of the ego at its start on the on-ramp."""
AFTER_M = 100.0
"""Length of the ego's way after the point where the off-ramp separates from the highway."""
SHORTEST_M = 10.0
"""Length of the shortest part of a road."""


def plan_with_ramps(
    description: OpenDescription,
    parts: tuple[str, ...],
    way: str,
    ego_front_m: float,
    after_m: float,
    *ramps: PartialLane,
) -> OpenPlan:
    """Return a highway with an on-ramp, an off-ramp, or both in this order, which are lane 0.

    Args:
        description: The description of the highway.
        parts: The names of its edges: before the lane of the first ramp, beside it, and so on.
        way: The name of the ego's route, which begins on the on-ramp or in the left lane.
        ego_front_m: Position of the ego's front bumper at the start.
        after_m: Length of the ego's way after the lane of the last ramp.
        ramps: The ramps, each joined to the highway along an acceleration or deceleration lane.
    """
    lanes, end_m = range(description.lanes + 1), ramps[-1].joined_to_m + after_m
    joints_m = (at_m for ramp in ramps for at_m in (ramp.joined_from_m, ramp.joined_to_m))
    ends_m = pairwise((0.0, *joints_m, end_m))
    edges = [
        Edge(name, begin_m, stop_m, lanes if place % 2 else lanes[1:])
        for place, (name, (begin_m, stop_m)) in enumerate(zip(parts, ends_m, strict=True))
    ]
    route, ego_lane, speed_m_s, exit_m = [*parts], lanes[-1], None, math.inf
    if (ramp := ramps[0]).begin_m < ramp.joined_from_m:
        route[0], ego_lane, speed_m_s = "ramp", 0, SPEED_M_S
        ends = ramp.begin_m, ramp.joined_from_m
        edges.insert(1, Edge("ramp", *ends, range(1), (ON_RAMP_ASIDE_M, 0.0)))
    if (ramp := ramps[-1]).joined_to_m < ramp.end_m:
        route[-1], exit_m = "off_ramp", ramp.joined_to_m
        edges.append(Edge("off_ramp", exit_m, end_m, range(1), (0.0, OFF_RAMP_ASIDE_M)))
    every, through = (True,) * len(lanes), tuple(lanes[1:])
    flow = end_m + BEYOND_M, description.flow_per_h
    return OpenPlan(
        edges=tuple(edges),
        routes={"through": parts, way: tuple(route)},
        road=Road(OPEN_LAP_M, description.lane_width_m, every, end_m, ramps, exit_m),
        start=OpenStart(through, *flow, ego_lane, ego_front_m, speed_m_s),
    )


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
        parts = "before", "exit", "after"
        return plan_with_ramps(self, parts, "exit", START_M, AFTER_M, self.off_ramp(START_M))


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
        begin_m = GORE_M - self.ramp_m - self.longest_m
        end_m = GORE_M + self.acceleration_lane_m
        return PartialLane(0, begin_m, end_m, GORE_M, end_m)


@dataclass(frozen=True)
class MergeDescription(OnRamp):
    """A highway with an on-ramp, from which the ego merges.

    after_m: distance from the end of the acceleration lane to the end of the road, metres (ours)
    """

    meaning = "an on-ramp and its acceleration lane, from which the ego merges"
    after_m: float = setting(500.0, low=50, high=40_000)

    def plan(self) -> OpenPlan:
        """Return the road: on-ramp, and highway before, beside and after the acceleration lane."""
        parts, front_m = ("before", "beside", "after"), GORE_M - self.ramp_m
        return plan_with_ramps(self, parts, "ramp", front_m, self.after_m, self.on_ramp)


@dataclass(frozen=True)
class RampToRampDescription(OnRamp, OffRamp):
    """A highway with an on-ramp and an off-ramp, which are both lane 0."""

    meaning = "an on-ramp, a highway and an off-ramp, by which the ego leaves"

    def plan(self) -> OpenPlan:
        """Return the road, on which the acceleration lane ends before the deceleration lane."""
        parts, front_m = ("before", "beside", "between", "exit", "after"), GORE_M - self.ramp_m
        ramps = self.on_ramp, self.off_ramp(self.on_ramp.end_m)
        return plan_with_ramps(self, parts, "way", front_m, AFTER_M, *ramps)


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
