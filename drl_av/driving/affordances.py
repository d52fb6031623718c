"""The 27 affordance indicators, the ego's observation of the vehicles and lanes around it."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.compiled import compiled
from drl_av.config import ObservationConfig
from drl_av.road.road import NO_CHANGE, Barrier, FloatArray, MandatoryChange, Road
from drl_av.road.road_numbers import (
    RoadNumbers,
    is_beside,
    is_open,
    lane_end_m,
    lane_of,
    mandatory_change,
    road_numbers,
)
from drl_av.road.snapshot import EGO, Snapshot

IntArray = npt.NDArray[np.int64]

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
    """Whether the lanes to the right and to the left exist and are open here."""
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

    def arrays(self) -> "Indicators":
        """Return the indicators as compiled functions take them."""
        rows = [NOBODY if slot is None else slot.vehicle for slot in self[:6]]
        lanes = self.lane, self.right_lane, self.left_lane, self.mandatory.lanes
        values = np.append(self.vector(), (self.mandatory.within_m, 0.0))
        barriers = np.array(self.barriers, dtype=np.float64).reshape(-1, 3)
        ground = float(self.circumference_m), float(self.lane_width_m), barriers
        return Indicators(values, np.array([*rows, *lanes], np.int64), ground, self.range_m)


Ground = tuple[float, float, FloatArray]
"""What compiled functions need to know of the road around the ego, metres: the circumference, 0 on
an open road; the lane width; and the barriers, shape (barriers, 3)."""


class Indicators(NamedTuple):
    """The indicators as the function ``indicators`` writes them, in two arrays."""

    values: FloatArray
    """Shape (29,), float64: the 27 indicators in SI units, in the order of INDICATORS; then
    ``WITHIN`` and ``FRONT``."""
    codes: IntArray
    """Shape (10,), int64: the row of the neighbour in each of the six SLOTS, ``NOBODY`` if there is
    none, and N + 1 for the end of a lane; then ``LANE`` to ``CHANGES``."""
    ground: Ground
    range_m: float
    """The largest gap that is observed."""


VALUES, CODES = 29, 10
"""Sizes of the two arrays that ``indicators`` fills."""
WITHIN, FRONT = 27, 28
"""Indices in the values, after the 27 indicators: the distance ``MandatoryChange.within_m``, and
the position of the ego's front bumper, in the coordinates of the road's barriers."""
LANE, RIGHT_LANE, LEFT_LANE, CHANGES = 6, 7, 8, 9
"""Indices in the codes, after the neighbours' rows: the ego's lane, whether there is a lane to the
right and to the left (1 or 0), and ``MandatoryChange.lanes``."""
NOBODY = -1
"""The row of a neighbour that is not there."""


@compiled
def indicators(
    s_m: FloatArray,
    y_m: FloatArray,
    speed_m_s: FloatArray,
    lateral_speed_m_s: FloatArray,
    length_m: FloatArray,
    width_m: FloatArray,
    road: RoadNumbers,
    range_m: float,
    values: FloatArray,
    codes: IntArray,
) -> None:
    """Compute the indicators of one scene (Sec. III); ``compute_affordances`` has the rules.

    The first six arrays are those of a snapshot, shape (1 + N,), the ego first. The function fills
    ``values``, shape (29,), and ``codes``, shape (10,), which ``Indicators`` describes.
    """
    vehicles, lane = len(s_m), lane_of(y_m[EGO], road.lane_width_m)
    own_m = lane * road.lane_width_m
    right_m, left_m = own_m - road.lane_width_m, own_m + road.lane_width_m
    lap_m, half_lap_m = road.lap_m, road.lap_m / 2
    ego_s_m, ego_length_m, half_lane_m = s_m[EGO], length_m[EGO], road.lane_width_m / 2
    for slot in range(6):
        values[4 * slot] = np.inf
        codes[slot] = NOBODY
    for row in range(1, vehicles):
        ahead_m = (s_m[row] - ego_s_m + half_lap_m) % lap_m - half_lap_m
        behind = 0
        if ahead_m < 0.0:
            ahead_m, behind = -ahead_m, 1
        gap_m, reach_m = (
            ahead_m - (length_m[row] + ego_length_m) / 2,
            width_m[row] / 2 + half_lane_m,
        )
        across_m = y_m[row]
        if gap_m < values[4 * behind] and -reach_m < across_m - own_m < reach_m:
            values[4 * behind], codes[behind] = gap_m, row
        if gap_m < values[4 * (2 + behind)] and -reach_m < across_m - right_m < reach_m:
            values[4 * (2 + behind)], codes[2 + behind] = gap_m, row
        if gap_m < values[4 * (4 + behind)] and -reach_m < across_m - left_m < reach_m:
            values[4 * (4 + behind)], codes[4 + behind] = gap_m, row
    front_m = ego_s_m + ego_length_m / 2
    codes[LANE], codes[CHANGES], values[WITHIN], values[FRONT] = lane, 0, np.inf, front_m
    codes[RIGHT_LANE], codes[LEFT_LANE] = is_open(lane - 1, road), is_open(lane + 1, road)
    if len(road.partial_lanes) > 0:
        for side in (-1, 1):  # the front must not have passed the end of the lane
            beside = is_beside(lane, lane + side, ego_s_m, road)
            beside = beside and is_beside(lane, lane + side, front_m, road)
            codes[RIGHT_LANE if side < 0 else LEFT_LANE] = beside
        for slot, sign in ((0, 0), (2, -1), (4, 1)):
            gap_m = lane_end_m(lane + sign, ego_s_m, road) - front_m
            if gap_m < values[4 * slot] and has_lane(codes, sign):
                values[4 * slot], codes[slot] = gap_m, vehicles
        codes[CHANGES], values[WITHIN] = mandatory_change(lane, front_m, road)
    for slot in range(6):
        _complete(slot, s_m, y_m, speed_m_s, lateral_speed_m_s, road, range_m, values, codes)
    values[24], values[25], values[26] = speed_m_s[EGO], y_m[EGO], lateral_speed_m_s[EGO]


@compiled
def _complete(
    slot: int,
    s_m: FloatArray,
    y_m: FloatArray,
    speed_m_s: FloatArray,
    lateral_speed_m_s: FloatArray,
    road: RoadNumbers,
    range_m: float,
    values: FloatArray,
    codes: IntArray,
) -> None:
    """Fill in the four indicators of a slot whose gap and row are known."""
    at, row, sign = 4 * slot, codes[slot], SIDES[slot // 2]
    center_m = (codes[LANE] + sign) * road.lane_width_m
    if values[at] > range_m or row == NOBODY:
        codes[slot] = NOBODY
        center_m = codes[LANE] * road.lane_width_m + sign * road.lane_width_m
        values[at] = range_m if has_lane(codes, sign) else 0.0
        values[at + 1], values[at + 2], values[at + 3] = 0.0, center_m - y_m[EGO], 0.0
        return
    values[at] = values[at] if values[at] > 0.0 else 0.0
    if row == len(s_m):
        values[at + 1], values[at + 2] = 0.0 - speed_m_s[EGO], center_m - y_m[EGO]
        values[at + 3] = 0.0 - lateral_speed_m_s[EGO]
        return
    values[at + 1] = speed_m_s[row] - speed_m_s[EGO]
    values[at + 2] = y_m[row] - y_m[EGO]
    values[at + 3] = lateral_speed_m_s[row] - lateral_speed_m_s[EGO]


def slot_of(sign: int) -> int:
    """Return the slot of the vehicle ahead in the own (0), left (+1) or right (-1) lane.

    The next slot is that of the vehicle behind.
    """
    return (0, 4, 2)[sign]


def has_lane(codes: IntArray, sign: int) -> bool:
    """Whether the ego's own (0), left (+1) or right (-1) lane exists and is open."""
    return sign == 0 or codes[RIGHT_LANE + (sign > 0)] == 1


def compute_affordances(snapshot: Snapshot, road: Road, range_m: float) -> Affordances:
    """Find the nearest vehicle ahead and behind in the ego's own, right and left lane (Sec. III).

    ``range_m`` is the largest gap that is observed. A vehicle occupies every lane that its body
    overlaps. On a loop a vehicle is ahead if the shorter way from the ego to it leads forward,
    otherwise behind. A vehicle exactly beside the ego counts as ahead. The end of a lane counts as
    a standing vehicle.
    """
    values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
    numbers = road_numbers(road)
    indicators.fast(*snapshot.arrays, numbers, float(range_m), values, codes)
    return affordances_of(Indicators(values, codes, ground_of(numbers), range_m), road)


def ground_of(road: RoadNumbers) -> Ground:
    """Return the road as ``Indicators`` hold it."""
    return road.lap_m if road.end_m == np.inf else 0.0, road.lane_width_m, road.barriers


def affordances_of(indicators: Indicators, road: Road) -> Affordances:
    """Return the indicators by name from the arrays that ``indicators`` has filled."""
    values, codes, (circumference_m, lane_width_m, _), range_m = indicators
    number, code = values.tolist(), codes.tolist()
    lane, partial = code[LANE], road.partial_lanes
    own_front, own_rear, right_front, right_rear, left_front, left_rear = (
        None if row == NOBODY else Neighbor(row, *number[4 * slot : 4 * slot + 4])
        for slot, row in enumerate(code[:6])
    )
    return Affordances(
        own_front,
        own_rear,
        right_front,
        right_rear,
        left_front,
        left_rear,
        right_lane=code[RIGHT_LANE] == 1,
        left_lane=code[LEFT_LANE] == 1,
        lane=lane,
        lane_center_m=road.center_m(lane),
        lane_width_m=lane_width_m,
        range_m=range_m,
        ego_speed_m_s=number[24],
        ego_y_m=number[25],
        ego_lateral_speed_m_s=number[26],
        circumference_m=circumference_m,
        barriers=_ahead(road, number[FRONT]) if partial else (),
        mandatory=MandatoryChange(code[CHANGES], number[WITHIN]) if partial else NO_CHANGE,
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
        self.road, self.range_m, self.max_speed_m_s = road, config.range_m, max_speed_m_s
        self.lanes = len(road.open_lanes)
        """Number of lanes of the road."""
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
