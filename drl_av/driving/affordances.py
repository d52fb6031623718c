"""The 27 affordance indicators, the ego's observation of the vehicles and lanes around it."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import ObservationConfig
from drl_av.road.road import (
    LANE_CHANGE_S,
    NO_CHANGE,
    Barrier,
    FloatArray,
    MandatoryChange,
    Road,
    SpeedLimit,
    allowed_speed,
)
from drl_av.road.snapshot import EGO, Snapshot

SLOTS = ("own_front", "own_rear", "right_front", "right_rear", "left_front", "left_rear")
INDICATORS: tuple[str, ...] = (
    *(f"{slot}_{state}" for slot in SLOTS for state in ("d_x", "v_x", "d_y", "v_y")),
    "ego_v_x",
    "ego_d_y",
    "ego_v_y",
)
"""Names of the 27 indicators, in the order of ``Affordances.vector()``.

For each of the six slots, d_x is the net gap to the neighbour, d_y is its lateral position, and v_x
and v_y are its velocities, all relative to the ego. ``indicator_meaning`` gives units and signs.
"""
WAY_INDICATORS = ("lane_end", "way_changes", "way_distance")
"""Names of the indicators that ``observation.way`` adds (ours).

- lane_end: distance to the end of the ego's lane, divided by ``range_m``; 1 if no end is in range.
- way_changes: number of lane changes that the ego must make to reach its exit or to leave a lane
  that ends, left positive, divided by the number of lanes minus 1.
- way_distance: distance within which these lane changes must be complete, divided by ``WAY_M``;
  at most 1, and 1 if no lane change is needed.
"""
WAY_M = 1000.0
"""Distance, metres, at and above which ``way_distance`` is 1 (ours)."""
_MEANINGS = {
    "d_x": "net gap, bumper to bumper, m",
    "v_x": "relative velocity, m/s; negative for a vehicle ahead that comes nearer",
    "d_y": "relative lateral position, m; left positive",
    "v_y": "relative lateral velocity, m/s; left positive",
    "ego_v_x": "speed of the ego, m/s",
    "ego_d_y": "lateral position of the ego from the centre of the rightmost lane, m",
    "ego_v_y": "lateral velocity of the ego, m/s; left positive",
}


def indicator_meaning(name: str) -> str:
    """Return what an indicator means, with its unit."""
    return _MEANINGS[name if name in _MEANINGS else name[-3:]]


def observed_indicators(config: ObservationConfig) -> tuple[str, ...]:
    """Return the names of the indicators in an observation with these settings, in its order."""
    return INDICATORS + WAY_INDICATORS if config.way else INDICATORS


SIDES = (0, -1, 1)
"""Directions of the own, the right and the left lane, in the order of SLOTS; left is +1."""


class Neighbor(NamedTuple):
    """The nearest vehicle ahead of the ego or behind it in one lane; values relative to the ego."""

    vehicle: int
    """Index of the vehicle in the snapshot, 1 to N; a larger index stands for the end of a lane."""
    gap_m: float
    """Net gap, bumper to bumper; 0 if the vehicle is beside the ego."""
    relative_speed_m_s: float
    """Speed of the vehicle minus that of the ego."""
    lateral_offset_m: float
    """Lateral position of the vehicle minus that of the ego; left positive."""
    relative_lateral_speed_m_s: float
    """Lateral velocity of the vehicle minus that of the ego; left positive."""


class Affordances(NamedTuple):
    """The affordance indicators by name; a missing vehicle is None, a missing lane is False."""

    own_front: Neighbor | None
    own_rear: Neighbor | None
    right_front: Neighbor | None
    right_rear: Neighbor | None
    left_front: Neighbor | None
    left_rear: Neighbor | None
    right_lane: bool
    left_lane: bool
    """Whether the lanes to the right and to the left exist, are open here, and may be entered: no
    forbidden line lies between, neither here nor ahead, until the ego could have crossed it."""
    lane: int
    """Index of the lane that contains the ego's centre; 0 is the rightmost lane."""
    lane_center_m: float
    """Lateral position of that lane's centre, as ``ego_y_m``."""
    lane_width_m: float
    range_m: float
    ego_speed_m_s: float
    ego_y_m: float
    """Lateral position of the ego's centre, left positive; 0 is the rightmost lane's centre."""
    ego_lateral_speed_m_s: float
    circumference_m: float = 0.0
    """Length of the loop; 0 for a road of unlimited length."""
    barriers: tuple[Barrier, ...] = ()
    """The barriers ahead of the ego; their ``s_m`` is the distance from the ego's front bumper."""
    mandatory: MandatoryChange = NO_CHANGE
    """The lane changes that the ego must make to reach its exit or to leave a lane that ends. Their
    ``within_m`` is measured from the ego's front bumper."""
    speed_limits: tuple[SpeedLimit, ...] = ()
    """The speed limits of the ego's lane here and ahead, at their distances from its front bumper.
    Empty if the road has one limit, which no setting may exceed."""

    @property
    def allowed_speed_m_s(self) -> float:
        """The largest speed with which the ego keeps the limits here and ahead; inf without any."""
        return allowed_speed(self.speed_limits)

    def front(self, sign: int) -> Neighbor | None:
        """Return the vehicle ahead in the ego's own (0), left (+1) or right (-1) lane, or None."""
        return (self.own_front, self.left_front, self.right_front)[sign]

    def rear(self, sign: int) -> Neighbor | None:
        """Return the vehicle behind in the ego's own (0), left (+1) or right (-1) lane, or None."""
        return (self.own_rear, self.left_rear, self.right_rear)[sign]

    def has_lane(self, sign: int) -> bool:
        """Whether the ego's own (0), left (+1) or right (-1) lane exists and is open."""
        return (True, self.left_lane, self.right_lane)[sign]

    @property
    def lane_end_gap_m(self) -> float:
        """Distance from the ego's front to the end of its lane, metres; at most ``range_m``."""
        gaps_m = (
            gap_m
            for gap_m, right_m, left_m in self.barriers
            if right_m < self.lane_center_m < left_m
        )
        return min((self.range_m, *gaps_m))

    def vector(self) -> FloatArray:
        """Return the 27 indicators in SI units, shape (27,), float64, in the order of INDICATORS.

        If no vehicle is in range, the gap is ``range_m``, the relative velocities are 0 and the
        lateral offset is that of the lane's centre. If the lane does not exist or is closed, these
        values are the same, except that the gap is 0.
        """
        values: list[float] = []
        for slot, sign in zip(self[:6], (0, 0, -1, -1, 1, 1), strict=True):
            if slot is not None:
                values += slot[1:]
            else:
                gap_m = self.range_m if self.has_lane(sign) else 0.0
                center_m = self.lane_center_m + sign * self.lane_width_m
                values += (gap_m, 0.0, center_m - self.ego_y_m, 0.0)
        values += (self.ego_speed_m_s, self.ego_y_m, self.ego_lateral_speed_m_s)
        return np.array(values)


def compute_affordances(snapshot: Snapshot, road: Road, range_m: float) -> Affordances:
    """Find the nearest vehicle ahead and behind in the ego's own, right and left lane (Sec. III).

    ``range_m`` is the largest gap that is observed. A vehicle occupies every lane that its body
    overlaps. On a loop a vehicle is ahead if the shorter way from the ego to it leads forward,
    otherwise behind. A vehicle exactly beside the ego counts as ahead. The end of a lane counts as
    a standing vehicle.
    """
    # lists: numpy arrays take twice as long for so few vehicles
    s_m, y_m = snapshot.s_m.tolist(), snapshot.y_m.tolist()
    speed, lateral = snapshot.speed_m_s.tolist(), snapshot.lateral_speed_m_s.tolist()
    length_m, width_m = snapshot.length_m.tolist(), snapshot.width_m.tolist()
    lane = road.lane_of(y_m[EGO])
    own_m = road.center_m(lane)
    right_m, left_m = own_m - road.lane_width_m, own_m + road.lane_width_m
    lap_m, half_lap_m = road.lap_m, road.lap_m / 2
    ego_s_m, ego_length_m, half_lane_m = s_m[EGO], length_m[EGO], road.lane_width_m / 2
    gaps_m, rows = [math.inf] * len(SLOTS), [EGO] * len(SLOTS)
    vehicles = enumerate(zip(s_m, y_m, length_m, width_m, strict=True))
    next(vehicles)  # the ego
    for row, (at_m, across_m, its_length_m, its_width_m) in vehicles:
        ahead_m = (at_m - ego_s_m + half_lap_m) % lap_m - half_lap_m
        if ahead_m < 0.0:
            ahead_m, own, right, left = -ahead_m, 1, 3, 5
        else:
            own, right, left = 0, 2, 4
        gap_m, reach_m = ahead_m - (its_length_m + ego_length_m) / 2, its_width_m / 2 + half_lane_m
        if gap_m < gaps_m[own] and -reach_m < across_m - own_m < reach_m:
            gaps_m[own], rows[own] = gap_m, row
        if gap_m < gaps_m[right] and -reach_m < across_m - right_m < reach_m:
            gaps_m[right], rows[right] = gap_m, row
        if gap_m < gaps_m[left] and -reach_m < across_m - left_m < reach_m:
            gaps_m[left], rows[left] = gap_m, row
    partial, front_m = road.partial_lanes, ego_s_m + ego_length_m / 2
    beside = {-1: road.is_open(lane - 1), 1: road.is_open(lane + 1)}
    if partial:
        for side in beside:  # the front must not have passed the end of the lane
            both_m = (ego_s_m, front_m)
            beside[side] = all(road.is_beside(lane, lane + side, at_m) for at_m in both_m)
        for slot, sign in ((0, 0), (2, -1), (4, 1)):
            gap_m = road.lane_end_m(lane + sign, ego_s_m) - front_m
            if gap_m < gaps_m[slot] and (sign == 0 or beside[sign]):
                gaps_m[slot], rows[slot] = gap_m, len(y_m)
                y_m.append(road.center_m(lane + sign))
                speed.append(0.0)
                lateral.append(0.0)
    ego_speed, ego_y_m, ego_lateral = speed[EGO], y_m[EGO], lateral[EGO]
    if road.forbidden_lines:
        for side in beside:
            share = 1 - side * (ego_y_m - own_m) / road.lane_width_m
            to_m = front_m + ego_speed * share * LANE_CHANGE_S
            beside[side] = beside[side] and road.may_cross(lane, side, ego_s_m, to_m)
    own_front, own_rear, right_front, right_rear, left_front, left_rear = [
        None
        if gap_m > range_m
        else Neighbor(
            row,
            gap_m if gap_m > 0.0 else 0.0,
            speed[row] - ego_speed,
            y_m[row] - ego_y_m,
            lateral[row] - ego_lateral,
        )
        for gap_m, row in zip(gaps_m, rows, strict=True)
    ]
    return Affordances(
        own_front,
        own_rear,
        right_front,
        right_rear,
        left_front,
        left_rear,
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
        mandatory=road.mandatory_change(lane, front_m) if partial else NO_CHANGE,
        speed_limits=_limits_ahead(road, lane, front_m) if road.speed_limits else (),
    )


def _limits_ahead(road: Road, lane: int, front_m: float) -> tuple[SpeedLimit, ...]:
    """Return a lane's speed limits here and ahead, at their distances from the ego's front."""
    if not 0 <= lane < len(road.speed_limits):
        return ()
    return tuple(
        SpeedLimit(begin_m - front_m, end_m - front_m, limit_m_s)
        for begin_m, end_m, limit_m_s in road.speed_limits[lane]
        if end_m > front_m
    )


def _ahead(road: Road, front_m: float) -> tuple[Barrier, ...]:
    """Return the barriers ahead; their ``s_m`` is the distance from the ego's front bumper."""
    gaps = (barrier._replace(s_m=barrier.s_m - front_m) for barrier in road.barriers)
    return tuple(gap for gap in gaps if gap.s_m >= 0.0)


class ObservationScale:
    """Scales the 27 indicators to about [-1, 1] for the input of the network (ours).

    First, half of the top speed is subtracted from the ego's speed, and the middle of the road from
    the ego's lateral position. Then each indicator is divided by a constant of the config, and
    clipped to [-bounds, bounds].
    """

    def __init__(self, config: ObservationConfig, max_speed_m_s: float, road: Road) -> None:
        vehicle = (
            config.gap_scale_m,
            config.speed_scale_m_s,
            config.lateral_scale_m,
            config.lateral_speed_scale_m_s,
        )
        self.lanes = len(road.open_lanes)
        """Number of lanes of the road."""
        self.max_speed_m_s = max_speed_m_s
        middle_m = road.lane_width_m * (self.lanes - 1) / 2
        half_speed = max_speed_m_s / 2
        self.offset = np.array([0.0] * 24 + [half_speed, middle_m, 0.0])
        self.scale = np.array(
            [*vehicle * 6, half_speed, config.lateral_scale_m, config.lateral_speed_scale_m_s]
        )
        widest_m = road.lane_width_m * (self.lanes + 1)
        limits = (config.range_m, 60.0, widest_m, 4.0)
        half_road_m = road.lane_width_m * self.lanes / 2
        ends = np.array([*limits * 6, half_speed, half_road_m, 4.0]) / self.scale
        self.bounds: npt.NDArray[np.float32] = ends.astype(np.float32)
        """Largest absolute value of each scaled indicator, shape (27,)."""
        self._least = -self.bounds

    def __call__(self, vector: FloatArray) -> npt.NDArray[np.float32]:
        """Scale indicators in SI units, shape (..., 27); return float32 of the same shape."""
        scaled = ((vector - self.offset) / self.scale).astype(np.float32)
        # np.minimum uses AVX-512, after which SUMO's next step takes 15 % longer
        clipped: npt.NDArray[np.float32] = scaled.clip(self._least, self.bounds)
        return clipped
