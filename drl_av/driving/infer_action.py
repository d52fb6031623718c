"""The action and the lane change that describe the observed motion of an ego driven by SUMO."""

from drl_av.config import Config
from drl_av.driving.actions import Action, Lateral, nearest_action, toward
from drl_av.driving.scene import LaneChange, Scene
from drl_av.road.road import ARRIVED_M, Road
from drl_av.road.snapshot import EGO, Snapshot

STILL_M = 1e-6
"""A lateral movement of at most this distance, metres, within a decision counts as none."""


def infer_action(
    before: Scene, after: Snapshot, road: Road, config: Config
) -> tuple[Action, LaneChange | None]:
    """Return the action nearest to the ego's motion from ``before`` to ``after`` (ours).

    The second result is the lane change in progress after the decision, or None. A lane change
    begins when the ego leaves the centre of its lane. It is aborted when the ego reverses its
    lateral direction, and it ends at the centre of a lane.
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
        return Action(lateral, longitudinal), None
    if (y_m - road.center_m(change.target)) * change.sign > 0:  # it continues to the next lane
        change = LaneChange(change.target, change.target + change.sign)
    return Action(lateral, longitudinal), change
