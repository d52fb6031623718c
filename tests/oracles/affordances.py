"""The indicators of a scene, in plain Python."""

import math

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.driving.affordances import SLOTS, Affordances, Neighbor
from drl_av.road.road import (
    NO_CHANGE,
    Barrier,
    MandatoryChange,
    Road,
    is_beside,
    is_open,
    lane_end_m,
    mandatory_change,
)
from drl_av.road.snapshot import EGO, Snapshot


def compute_affordances(snapshot: Snapshot, road: Road, range_m: float) -> Affordances:
    """Find the nearest vehicle ahead and behind in the ego's own, right and left lane (Sec. III).

    ``range_m`` is the largest gap that is observed. A vehicle occupies every lane that its body
    overlaps. On a loop a vehicle is ahead if the shorter way from the ego to it leads forward,
    otherwise behind. A vehicle exactly beside the ego counts as ahead. The end of a lane counts as
    a standing vehicle.
    """
    s_m, y_m = snapshot.s_m.tolist(), snapshot.y_m.tolist()
    speed, lateral = snapshot.speed_m_s.tolist(), snapshot.lateral_speed_m_s.tolist()
    length_m, width_m = snapshot.length_m.tolist(), snapshot.width_m.tolist()
    lane = road.lane_of(y_m[EGO])
    own_m = road.center_m(lane)
    centers_m = own_m, own_m - road.lane_width_m, own_m + road.lane_width_m
    lap_m, half_lap_m = road.lap_m, road.lap_m / 2
    ego_s_m, ego_length_m, half_lane_m = s_m[EGO], length_m[EGO], road.lane_width_m / 2
    gaps_m, rows = [math.inf] * len(SLOTS), [EGO] * len(SLOTS)
    vehicles = enumerate(zip(s_m, y_m, length_m, width_m, strict=True))
    next(vehicles)  # the ego
    for row, (at_m, across_m, its_length_m, its_width_m) in vehicles:
        ahead_m = (at_m - ego_s_m + half_lap_m) % lap_m - half_lap_m
        slots, ahead_m = ((1, 3, 5), -ahead_m) if ahead_m < 0.0 else ((0, 2, 4), ahead_m)
        gap_m, reach_m = ahead_m - (its_length_m + ego_length_m) / 2, its_width_m / 2 + half_lane_m
        for slot, center_m in zip(slots, centers_m, strict=True):
            if gap_m < gaps_m[slot] and -reach_m < across_m - center_m < reach_m:
                gaps_m[slot], rows[slot] = gap_m, row
    partial, front_m = road.partial_lanes, ego_s_m + ego_length_m / 2
    beside = {-1: is_open(lane - 1, road), 1: is_open(lane + 1, road)}
    if partial:
        for side in beside:  # the front must not have passed the end of the lane
            both_m = (ego_s_m, front_m)
            beside[side] = all(is_beside(lane, lane + side, at_m, road) for at_m in both_m)
        for slot, sign in ((0, 0), (2, -1), (4, 1)):
            gap_m = lane_end_m(lane + sign, ego_s_m, road) - front_m
            if gap_m < gaps_m[slot] and (sign == 0 or beside[sign]):
                gaps_m[slot], rows[slot] = gap_m, len(y_m)
                y_m.append(road.center_m(lane + sign))
                speed.append(0.0)
                lateral.append(0.0)
    ego_speed, ego_y_m, ego_lateral = speed[EGO], y_m[EGO], lateral[EGO]
    neighbors: list[Neighbor | None] = []
    for gap_m, row in zip(gaps_m, rows, strict=True):
        moves = speed[row] - ego_speed, y_m[row] - ego_y_m, lateral[row] - ego_lateral
        near_m = gap_m if gap_m > 0.0 else 0.0
        neighbors.append(None if gap_m > range_m else Neighbor(row, near_m, *moves))
    return Affordances(
        *neighbors,
        right_lane=beside[-1],
        left_lane=beside[1],
        lane=lane,
        lane_center_m=own_m,
        lane_width_m=road.lane_width_m,
        range_m=range_m,
        ego_speed_m_s=ego_speed,
        ego_y_m=ego_y_m,
        ego_lateral_speed_m_s=ego_lateral,
        circumference_m=road.lap_m if road.is_loop else 0.0,
        barriers=_ahead(road, front_m) if partial else (),
        mandatory=MandatoryChange(*mandatory_change(lane, front_m, road)) if partial else NO_CHANGE,
    )


def _ahead(road: Road, front_m: float) -> tuple[Barrier, ...]:
    """Return the barriers ahead; their ``s_m`` is the distance from the ego's front bumper."""
    gaps = (barrier._replace(s_m=barrier.s_m - front_m) for barrier in road.barriers)
    return tuple(gap for gap in gaps if gap.s_m >= 0.0)


def has_lane(affordances: Affordances, sign: int) -> bool:
    """Whether the ego's own (0), left (+1) or right (-1) lane exists and is open."""
    return (True, affordances.left_lane, affordances.right_lane)[sign]


def vector(affordances: Affordances) -> FloatArray:
    """Return the 27 indicators in SI units, shape (27,), in the order of INDICATORS."""
    values: list[float] = []
    for slot, sign in zip(affordances[:6], (0, 0, -1, -1, 1, 1), strict=True):
        gap_m = affordances.range_m if has_lane(affordances, sign) else 0.0
        center_m = affordances.lane_center_m + sign * affordances.lane_width_m
        empty = gap_m, 0.0, center_m - affordances.ego_y_m, 0.0
        values += empty if slot is None else slot[1:]
    ego = affordances.ego_speed_m_s, affordances.ego_y_m, affordances.ego_lateral_speed_m_s
    return np.array([*values, *ego])
