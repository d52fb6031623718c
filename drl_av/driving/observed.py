"""What the ego did in a decision that another model made: the nearest action, the lane change."""

from typing import NamedTuple

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, nearest_action, toward
from drl_av.driving.scene import LaneChange, Scene
from drl_av.traffic.road import ARRIVED_M, Road
from drl_av.traffic.snapshot import EGO, Snapshot

STILL_M = 1e-6
"""A shorter way sideways is none."""


class Observed(NamedTuple):
    """A decision as seen from outside."""

    action: Action
    lane_change: LaneChange | None
    """In progress after it."""


def observed(before: Scene, after: Snapshot, road: Road, config: Config) -> Observed:
    """The action nearest to what the ego did, and the lane change that it is in then (ours).

    A lane change begins where the ego leaves its lane's centre, is aborted where it turns round,
    and is over at a centre.
    """
    gained_m_s = float(after.speed_m_s[EGO]) - before.affordances.ego_speed_m_s
    acceleration = gained_m_s / config.simulation.decision_interval_s
    longitudinal = nearest_action(acceleration, config.ego)
    y_m = float(after.y_m[EGO])
    moved_m = y_m - before.affordances.ego_y_m
    sign = (moved_m > STILL_M) - (moved_m < -STILL_M)
    change = before.lane_change
    lateral = Lateral.KEEP
    if sign and (change is None or sign != change.sign):
        lateral = toward(sign)
        lane = before.affordances.lane
        change = LaneChange(lane, lane + sign) if change is None else change.reversed()
    lane = road.lane_of(y_m)
    if change is None or abs(y_m - road.center_m(lane)) <= ARRIVED_M:
        return Observed(Action(lateral, longitudinal), None)
    if (y_m - road.center_m(change.target)) * change.sign > 0:  # on to the lane after that
        change = LaneChange(change.target, change.target + change.sign)
    return Observed(Action(lateral, longitudinal), change)
