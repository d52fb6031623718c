"""Collisions of the ego: found by the overlap of bodies, and told apart; pure geometry (ours)."""

import math

import numpy as np

from drl_av.traffic.road import Road
from drl_av.traffic.snapshot import EGO, Collision, CollisionKind, Snapshot


def overlapping(snapshot: Snapshot, road: Road) -> Collision | None:
    """The collision of the ego with a body that its own overlaps, or None."""
    ahead_m = np.abs(road.ahead_m(float(snapshot.s_m[EGO]), snapshot.s_m))
    beside_m = np.abs(snapshot.y_m - snapshot.y_m[EGO])
    touching = (ahead_m < (snapshot.length_m + snapshot.length_m[EGO]) / 2) & (
        beside_m < (snapshot.width_m + snapshot.width_m[EGO]) / 2
    )
    touching[EGO] = False
    return classify(snapshot, road, int(touching.argmax())) if touching.any() else None


def classify(snapshot: Snapshot, road: Road, other: int) -> Collision:
    """Who hit whom, from positions and velocities at the first moment of contact.

    The bodies met on the axis on which their overlap is younger, and sideways only if they were
    drawing near. Lengthwise the faster one hit the other, however far it came past it in one SUMO
    step; sideways the ego hit if it was moving towards the other.
    """
    ahead_m = float(road.ahead_m(float(snapshot.s_m[EGO]), snapshot.s_m[other : other + 1])[0])
    left_m = float(snapshot.y_m[other] - snapshot.y_m[EGO])
    sideways_m = (snapshot.width_m[other] + snapshot.width_m[EGO]) / 2 - abs(left_m)
    ego_lateral = float(snapshot.lateral_speed_m_s[EGO])
    speed = snapshot.speed_m_s[EGO] - snapshot.speed_m_s[other]
    lateral_speed = ego_lateral - snapshot.lateral_speed_m_s[other]
    met_ahead = speed > 0 or (speed == 0 and ahead_m >= 0)
    past_m = -ahead_m if met_ahead else ahead_m
    lengthwise_m = (snapshot.length_m[other] + snapshot.length_m[EGO]) / 2 + past_m
    sideways_s = sideways_m / abs(lateral_speed) if lateral_speed * left_m > 0 else math.inf
    lengthwise_s = lengthwise_m / abs(speed) if speed else math.inf
    if sideways_s < lengthwise_s:
        ego_moved_in = ego_lateral * left_m > 0
        kind = CollisionKind.HIT_BESIDE if ego_moved_in else CollisionKind.HIT_FROM_BESIDE
    else:
        kind = CollisionKind.HIT_AHEAD if met_ahead else CollisionKind.HIT_FROM_BEHIND
    return Collision(kind, snapshot.ids[other])
