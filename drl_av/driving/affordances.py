"""The 27 affordance indicators, the ego's observation of the vehicles and lanes around it."""

from typing import Any, NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing, inlined
from drl_av.config import ObservationConfig
from drl_av.road.road import (
    LANE_CHANGE_S,
    NO_CHANGE,
    Barrier,
    MandatoryChange,
    Road,
    RoadNumbers,
    SpeedLimit,
    allowed_speed,
    allowed_speed_in,
    around,
    is_beside,
    is_open,
    lane_end_m,
    lane_of,
    mandatory_change,
    may_cross,
    road_numbers,
)
from drl_av.road.snapshot import EGO, Snapshot, Vehicles

SLOTS = ("own_front", "own_rear", "right_front", "right_rear", "left_front", "left_rear")
INDICATORS: tuple[str, ...] = (
    *(f"{slot}_{state}" for slot in SLOTS for state in ("d_x", "v_x", "d_y", "v_y")),
    "ego_v_x",
    "ego_d_y",
    "ego_v_y",
)
"""Names of the 27 indicators, in the order of ``Indicators.values``.

For each of the six slots, d_x is the net gap to the neighbour, d_y is its lateral position, and v_x
and v_y are its velocities, all relative to the ego. Units are SI, left is positive.
"""
ROUTE_INDICATORS = ("lane_end", "way_changes", "way_distance")
"""Names of the indicators that ``observation.way`` adds (ours).

- lane_end: distance to the end of the ego's lane, divided by ``range_m``; 1 if no end is in range.
- way_changes: number of lane changes that the ego must make to reach its exit or to leave a lane
  that ends, left positive, divided by the number of lanes minus 1.
- way_distance: distance within which these lane changes must be complete, in ``ROUTE_SCALE_M``;
  at most 1, and 1 if no lane change is needed.
"""
ROUTE_SCALE_M = 1000.0
"""Distance, metres, at and above which ``way_distance`` is 1 (ours)."""


def observed_indicators(config: ObservationConfig) -> tuple[str, ...]:
    """Return the names of the indicators in an observation with these settings, in its order."""
    return INDICATORS + ROUTE_INDICATORS if config.way else INDICATORS


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


Ground = tuple[float, float, FloatArray]
"""What compiled functions need to know of the road around the ego, metres: the circumference, 0 on
an open road; the lane width; and the barriers, shape (barriers, 3)."""


class Indicators(NamedTuple):
    """The indicators as the function ``indicators`` writes them, in two arrays."""

    values: FloatArray
    """Shape (30,), float64: the 27 indicators in SI units, in the order of INDICATORS; then
    ``WITHIN``, ``ALLOWED`` and ``FRONT``. If no vehicle is in range, the gap is ``range_m``, the
    relative velocities are 0 and the lateral offset is that of the lane's centre. If the lane does
    not exist or is closed, these values are the same, except that the gap is 0."""
    codes: IntArray
    """Shape (10,), int64: the row of the neighbour in each of the six SLOTS, ``NO_VEHICLE`` without
    one, and N + 1 for the end of a lane; then ``LANE`` to ``CHANGES``."""
    ground: Ground
    range_m: float
    """The largest gap that is observed."""
    speed_limits: FloatArray
    """``RoadNumbers.speed_limits``; positions are measured like ``FRONT``."""


VALUES, CODES = 30, 10
"""Sizes of the two arrays that ``indicators`` fills."""
WITHIN, ALLOWED, FRONT = 27, 28, 29
"""Indices in the values, after the 27 indicators: the distance ``MandatoryChange.within_m``;
``Affordances.allowed_speed_m_s``; and the position of the ego's front bumper, in the coordinates of
the road's barriers and speed limits."""
LANE, RIGHT_LANE, LEFT_LANE, CHANGES = 6, 7, 8, 9
"""Indices in the codes, after the neighbours' rows: the ego's lane, whether there is a lane to the
right and to the left (1 or 0), and ``MandatoryChange.lanes``."""
NO_VEHICLE = -1
"""The row of a neighbour that is not there."""


@borrowing
def indicators(
    scene: Vehicles,
    road: RoadNumbers,
    range_m: float,
    values: FloatArray,
    codes: IntArray,
    viewer: int = EGO,
) -> None:
    """Compute the indicators of one scene (Sec. III); ``compute_indicators`` has the rules.

    ``scene`` is ``Snapshot.arrays``. The function fills ``values``, shape (30,), and ``codes``,
    shape (10,), which ``Indicators`` describes. They are those of the ego, or of another vehicle in
    its place, whose row is ``viewer``.
    """
    s_m, y_m, _, _, length_m, width_m = scene
    lane = lane_of(y_m[viewer], road.lane_width_m)
    own_m = lane * road.lane_width_m
    right_m, left_m = own_m - road.lane_width_m, own_m + road.lane_width_m
    lap_m, half_lap_m = road.lap_m, road.lap_m / 2
    own_s_m, own_length_m, half_lane_m = s_m[viewer], length_m[viewer], road.lane_width_m / 2
    for slot in range(6):
        values[4 * slot] = np.inf
        codes[slot] = NO_VEHICLE
    for row in range(len(s_m)):
        if row == viewer:
            continue
        ahead_m = around(s_m[row] - own_s_m + half_lap_m, lap_m) - half_lap_m
        behind, gap_m = ahead_m < 0.0, abs(ahead_m) - (length_m[row] + own_length_m) / 2
        reach_m = width_m[row] / 2 + half_lane_m
        for pair, center_m in enumerate((own_m, right_m, left_m)):
            slot = 2 * pair + behind  # no branch, because none could be foreseen
            nearest_m, its_row = values[4 * slot], codes[slot]
            is_nearer = (abs(y_m[row] - center_m) < reach_m) & (gap_m < nearest_m)
            values[4 * slot] = gap_m if is_nearer else nearest_m
            codes[slot] = row if is_nearer else its_row
    complete(scene, road, range_m, values, codes, viewer)


@inlined
def complete(
    scene: Vehicles,
    road: RoadNumbers,
    range_m: float,
    values: FloatArray,
    codes: IntArray,
    viewer: int,
) -> None:
    """Compute all that ``indicators`` computes but the gaps and rows of the slots, now known."""
    s_m, y_m, speed_m_s, lateral_speed_m_s, length_m, _ = scene
    lane, vehicles = lane_of(y_m[viewer], road.lane_width_m), len(s_m)
    own_s_m, own_m = s_m[viewer], lane * road.lane_width_m
    front_m = own_s_m + length_m[viewer] / 2
    codes[LANE], codes[CHANGES], values[WITHIN], values[FRONT] = lane, 0, np.inf, front_m
    codes[RIGHT_LANE], codes[LEFT_LANE] = is_open(lane - 1, road), is_open(lane + 1, road)
    if len(road.partial_lanes) > 0:
        for side in (-1, 1):  # the front must not have passed the end of the lane
            beside = is_beside(lane, lane + side, own_s_m, road)
            beside = beside and is_beside(lane, lane + side, front_m, road)
            codes[RIGHT_LANE if side < 0 else LEFT_LANE] = beside
        for slot, sign in ((0, 0), (2, -1), (4, 1)):
            gap_m = lane_end_m(lane + sign, own_s_m, road) - front_m
            if gap_m < values[4 * slot] and has_lane(codes, sign):
                values[4 * slot], codes[slot] = gap_m, vehicles
        codes[CHANGES], values[WITHIN] = mandatory_change(lane, front_m, road)
    values[ALLOWED] = allowed_speed_in(road.speed_limits, lane, front_m, 0.0)
    if len(road.forbidden_lines) > 0:
        for side in (-1, 1):
            share = 1 - side * (y_m[viewer] - own_m) / road.lane_width_m
            to_m = front_m + speed_m_s[viewer] * share * LANE_CHANGE_S
            if not may_cross(lane, side, own_s_m, to_m, road):
                codes[RIGHT_LANE if side < 0 else LEFT_LANE] = 0
    values[24], values[25] = speed_m_s[viewer], y_m[viewer]
    values[26] = lateral_speed_m_s[viewer]
    for slot in range(6):
        at, row, sign = 4 * slot, codes[slot], SIDES[slot // 2]
        if values[at] > range_m or row == NO_VEHICLE:
            codes[slot] = NO_VEHICLE
            values[at] = range_m if has_lane(codes, sign) else 0.0
            its_m = own_m + sign * road.lane_width_m - values[25]
            values[at + 1], values[at + 2], values[at + 3] = 0.0, its_m, 0.0
            continue
        values[at] = values[at] if values[at] > 0.0 else 0.0
        its_m_s, its_y_m, its_lateral_m_s = 0.0, (lane + sign) * road.lane_width_m, 0.0
        if row < vehicles:  # else the end of a lane
            its_m_s, its_y_m, its_lateral_m_s = speed_m_s[row], y_m[row], lateral_speed_m_s[row]
        values[at + 1], values[at + 2] = its_m_s - values[24], its_y_m - values[25]
        values[at + 3] = its_lateral_m_s - values[26]


def gap_in(values: FloatArray, codes: IntArray, slot: int) -> float:
    """Return the gap to the neighbour in a slot, metres; inf if there is none."""
    return np.inf if codes[slot] == NO_VEHICLE else values[4 * slot]


def slot_of(sign: int) -> int:
    """Return the slot of the vehicle ahead in the own (0), left (+1) or right (-1) lane.

    The next slot is that of the vehicle behind.
    """
    return (0, 4, 2)[sign]


def has_lane(codes: IntArray, sign: int) -> bool:
    """Whether the ego's own (0), left (+1) or right (-1) lane exists and is open."""
    return sign == 0 or codes[RIGHT_LANE + (sign > 0)] == 1


def compute_indicators(snapshot: Snapshot, road: Road, range_m: float) -> Indicators:
    """Find the nearest vehicle ahead and behind in the ego's own, right and left lane (Sec. III).

    ``range_m`` is the largest gap that is observed. A vehicle occupies every lane that its body
    overlaps. On a loop a vehicle is ahead if the shorter way from the ego to it leads forward,
    otherwise behind. A vehicle exactly beside the ego counts as ahead. The end of a lane counts as
    a standing vehicle.
    """
    values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
    numbers = road_numbers(road)
    indicators.fast(snapshot.arrays, numbers, float(range_m), values, codes, EGO)
    return Indicators(values, codes, ground_of(numbers), range_m, numbers.speed_limits)


def ground_of(road: RoadNumbers) -> Ground:
    """Return the road as ``Indicators`` hold it."""
    return road.lap_m if road.end_m == np.inf else 0.0, road.lane_width_m, road.barriers


def affordances_of(indicators: Indicators, road: Road) -> Affordances:
    """Return the indicators by name from the arrays that ``indicators`` has filled."""
    values, codes, (circumference_m, lane_width_m, _), range_m, _ = indicators
    number, code = values.tolist(), codes.tolist()
    lane, partial = code[LANE], road.partial_lanes
    neighbors: dict[str, Any] = {
        name: None if row == NO_VEHICLE else Neighbor(row, *number[4 * slot : 4 * slot + 4])
        for slot, (name, row) in enumerate(zip(SLOTS, code[:6], strict=True))
    }
    return Affordances(
        **neighbors,
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
        speed_limits=_limits_ahead(road, lane, number[FRONT]) if road.speed_limits else (),
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
