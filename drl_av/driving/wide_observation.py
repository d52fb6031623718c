"""The wide observation: the vehicles of five lanes, four ahead and two behind the ego (ours).

The 27 indicators of the paper show the next vehicle in three lanes. A driver that is to choose the
lane which is fastest a minute later also has to see the vehicles beyond those.
"""

import math

import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.compiled import borrowing
from drl_av.driving.affordances import ROUTE_SCALE_M
from drl_av.road.road import (
    Road,
    RoadNumbers,
    ahead_m,
    is_beside,
    is_open_at,
    lane_end_m,
    lane_of,
    mandatory_change,
    road_numbers,
)
from drl_av.road.snapshot import EGO, Snapshot, Vehicles

AHEAD, BEHIND = 4, 2
"""Number of vehicles in each lane, ahead of the ego and behind it."""
SLOTS_OF_A_LANE = AHEAD + BEHIND
LANES_ASIDE = (0, -1, 1, -2, 2)
"""The lanes around the ego, left positive: its own, those beside it, and those beyond."""
STATES = ("gap", "v_x", "d_y", "speed")
EGO_STATES = (
    *("speed", "d_y", "v_y", "lane_change", "lane_change_rest"),
    *("lane_right", "lane_left", "lane_right_2", "lane_left_2"),
    *("lane_end", "way_changes", "way_distance"),
)
_LANE_WORDS = ("own", "right", "left", "right_2", "left_2")
WIDE_NAMES: tuple[str, ...] = (
    *(
        f"{lane}_{place}_{state}"
        for lane in _LANE_WORDS
        for place in (*(f"front_{n + 1}" for n in range(AHEAD)), "rear_1", "rear_2")
        for state in STATES
    ),
    *(f"ego_{state}" for state in EGO_STATES),
)
"""Names of the numbers of the wide observation.

For each lane and vehicle:

- gap: ln(1 + net gap / 5 m), divided by the value at ``range_m``; 1 without a vehicle in range, 0
  in a lane that does not exist;
- v_x: the speed relative to the ego, divided by 10 m/s;
- d_y: the lateral offset from the lane's centre, left positive, divided by the lane width;
- speed: (speed - 20 m/s) / 10 m/s.

Where there is no vehicle, one drives at the ego's maximum speed; where there is no lane, one
stands. Then the ego: its speed as above; its offset from the centre of its lane and its lateral
speed, in lane widths and per lane width and second times 5; the lane change in progress, +1 left,
-1 right, 0 none, and the distance to its end, signed, in lane widths; whether the four lanes beside
it exist (1 or 0); and the three indicators of ``observation.way``.
"""
WIDE_SIZE = len(WIDE_NAMES)
EGO_AT = len(LANES_ASIDE) * SLOTS_OF_A_LANE * len(STATES)
"""Index of the first number about the ego."""
NEAR_M = 5.0
MOST = 6.0
"""Each number is limited to [-MOST, MOST]."""


@borrowing
def wide_observation(
    scene: Vehicles,
    road: RoadNumbers,
    range_m: float,
    max_speed_m_s: float,
    origin: int,
    target: int,
    observation: Float32Array,
    gaps_m: FloatArray,
    rows: IntArray,
) -> None:
    """Fill ``observation``, shape (WIDE_SIZE,), with the numbers that ``WIDE_NAMES`` describes.

    ``scene`` is ``Snapshot.arrays``. ``origin`` and ``target`` are the lanes of the lane change in
    progress, equal if there is none. ``gaps_m`` and ``rows`` are scratch, both of shape (5,
    SLOTS_OF_A_LANE).
    """
    s_m, y_m, speed_m_s, lateral_speed_m_s, length_m, width_m = scene
    width, lap_m, own = road.lane_width_m, road.lap_m, lane_of(y_m[EGO], road.lane_width_m)
    ego_s_m, ego_speed, front_m = s_m[EGO], speed_m_s[EGO], s_m[EGO] + length_m[EGO] / 2
    gaps_m[:], rows[:] = np.inf, 0
    for row in range(1, len(s_m)):
        away_m = ahead_m(ego_s_m, s_m[row], lap_m)
        gap_m = abs(away_m) - (length_m[row] + length_m[EGO]) / 2
        if gap_m > range_m:
            continue
        first, last = (0, AHEAD) if away_m >= 0.0 else (AHEAD, SLOTS_OF_A_LANE)
        reach_m = width_m[row] / 2 + width / 2
        for place in range(5):
            aside_m = y_m[row] - (own + LANES_ASIDE[place]) * width
            if not -reach_m < aside_m < reach_m or gap_m >= gaps_m[place, last - 1]:
                continue
            at = last - 1
            while at > first and gap_m < gaps_m[place, at - 1]:
                gaps_m[place, at], rows[place, at] = gaps_m[place, at - 1], rows[place, at - 1]
                at -= 1
            gaps_m[place, at], rows[place, at] = gap_m, row
    farthest = math.log(1.0 + range_m / NEAR_M)
    for place in range(5):
        lane = own + LANES_ASIDE[place]
        there = place == 0 or exists(own, LANES_ASIDE[place], ego_s_m, front_m, road)
        if place > 0:
            observation[EGO_AT + 4 + place] = 1.0 if there else 0.0
        for slot in range(SLOTS_OF_A_LANE):
            at, row = (place * SLOTS_OF_A_LANE + slot) * 4, rows[place, slot]
            gap, aside, speed = 1.0, 0.0, max_speed_m_s
            if not there:
                gap, speed = 0.0, 0.0
            elif row > 0:
                gap = math.log(1.0 + max(gaps_m[place, slot], 0.0) / NEAR_M) / farthest
                aside, speed = (y_m[row] - lane * width) / width, speed_m_s[row]
            observation[at] = gap
            observation[at + 1] = limited((speed - ego_speed) / 10.0)
            observation[at + 2] = aside
            observation[at + 3] = limited((speed - 20.0) / 10.0)
    changes, within_m, end_m = 0, np.inf, np.inf
    if len(road.partial_lanes) > 0:
        changes, within_m = mandatory_change(own, front_m, road)
        end_m = lane_end_m(own, ego_s_m, road) - front_m
    side = 0 if origin == target else 1 if target > origin else -1
    observation[EGO_AT] = limited((ego_speed - 20.0) / 10.0)
    observation[EGO_AT + 1] = y_m[EGO] / width - own
    observation[EGO_AT + 2] = limited(lateral_speed_m_s[EGO] / width * 5.0)
    observation[EGO_AT + 3] = side
    observation[EGO_AT + 4] = 0.0 if side == 0 else limited(target - y_m[EGO] / width)
    observation[EGO_AT + 9] = min(max(end_m, 0.0), range_m) / range_m
    observation[EGO_AT + 10] = changes / max(len(road.open_lanes) - 1, 1)
    observation[EGO_AT + 11] = min(within_m / ROUTE_SCALE_M, 1.0)


def exists(own: int, aside: int, s_m: float, front_m: float, road: RoadNumbers) -> bool:
    """Whether the lane ``aside`` lanes beside the ego exists here, and the ego may get there."""
    for step in range(1, abs(aside) + 1):
        nearer, lane = own + (step - 1) * (aside // abs(aside)), own + step * (aside // abs(aside))
        if not (is_beside(nearer, lane, s_m, road) and is_beside(nearer, lane, front_m, road)):
            return False
    return is_open_at(own + aside, s_m, road)


def limited(number: float) -> float:
    """Return the number, limited to [-MOST, MOST]."""
    return min(max(number, -MOST), MOST)


def scratch() -> tuple[FloatArray, IntArray]:
    """Return the scratch arrays of ``wide_observation``."""
    shape = 5, SLOTS_OF_A_LANE
    return np.empty(shape), np.empty(shape, np.int64)


def observe_wide(
    snapshot: Snapshot, road: Road, range_m: float, max_speed_m_s: float, change: tuple[int, int]
) -> Float32Array:
    """Return the wide observation of a snapshot, shape (WIDE_SIZE,), float32.

    ``change`` holds the lanes of the ego's lane change in progress, equal if there is none.
    """
    observation = np.zeros(WIDE_SIZE, np.float32)
    numbers = road_numbers(road), float(range_m), float(max_speed_m_s)
    wide_observation(snapshot.arrays, *numbers, *change, observation, *scratch())
    return observation
