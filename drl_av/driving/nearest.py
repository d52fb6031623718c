"""The nearest vehicles around any vehicle of a scene, found by the vehicles' order along the road.

It finds what the loop over all vehicles in ``indicators`` finds, to the bit, but looks no further
than it must. This pays where many vehicles of one scene look around.
"""

from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing, inlined
from drl_av.driving.affordances import NO_VEHICLE
from drl_av.road.road import around, lane_of
from drl_av.road.snapshot import Vehicles

TOLERANCE_M = 1e-6
"""By how much a lane counts as wider where only the lanes without any vehicle are sought."""


class Along(NamedTuple):
    """The vehicles of a scene in their order along the road."""

    rows: IntArray
    """The row of the vehicle at each place, shape (1 + N,), the rearmost first."""
    places: IntArray
    """The place of each row, shape (1 + N,)."""
    longest_m: float
    """The length of the longest vehicle."""
    lanes: tuple[int, int]
    """The rightmost and the leftmost lane in which a vehicle may be."""


@borrowing
def sort_along(
    scene: Vehicles, lane_m: float, rows: IntArray, places: IntArray
) -> tuple[float, int, int]:
    """Fill the first two fields of ``Along``, and return the numbers in the other two."""
    s_m, y_m, _, _, length_m, width_m = scene
    longest_m, right_m, left_m = 0.0, np.inf, -np.inf
    for row in range(len(s_m)):
        half_m = width_m[row] / 2 + TOLERANCE_M
        longest_m = max(longest_m, length_m[row])
        right_m, left_m = min(right_m, y_m[row] - half_m), max(left_m, y_m[row] + half_m)
        place = row
        while place > 0 and s_m[rows[place - 1]] > s_m[row]:
            rows[place] = rows[place - 1]
            place -= 1
        rows[place] = row
    for place in range(len(s_m)):
        places[rows[place]] = place
    return longest_m, lane_of(right_m, lane_m), lane_of(left_m, lane_m)


@inlined
def find_nearest(
    scene: Vehicles,
    road_m: tuple[float, float],
    along: Along,
    range_m: float,
    viewer: int,
    looks_aside: bool,
    values: FloatArray,
    codes: IntArray,
) -> None:
    """Set the gaps and rows of the six slots around the row ``viewer``, as ``indicators`` does.

    ``road_m`` holds the lengths of a lap and of a lane's width. Vehicles beyond ``range_m`` may be
    left out. Of a driver that does not look aside, only the first slot is right: the vehicle ahead
    in its own lane.
    """
    s_m, y_m, _, _, length_m, width_m = scene
    lap_m, width = road_m
    lane, vehicles, half_lap_m = lane_of(y_m[viewer], width), len(s_m), lap_m / 2
    own_m = lane * width
    right_m, left_m = own_m - width, own_m + width
    own_s_m, own_length_m, half_lane_m = s_m[viewer], length_m[viewer], width / 2
    most_m = (along.longest_m + own_length_m) / 2
    for slot in range(6):
        values[4 * slot] = np.inf
        codes[slot] = NO_VEHICLE
    has_right = looks_aside and lane - 1 >= along.lanes[0]
    has_left = looks_aside and lane + 1 <= along.lanes[1]
    for way in (1, -1):
        place, first = along.places[viewer], 0 if way > 0 else 1
        for _ in range(vehicles - 1):
            place += way
            place = 0 if place == vehicles else vehicles - 1 if place < 0 else place
            row = along.rows[place]
            ahead_m = around(s_m[row] - own_s_m + half_lap_m, lap_m) - half_lap_m
            if ahead_m * way < 0.0:  # beyond the other side of the loop
                break
            if ahead_m < 0.0 and not looks_aside:
                break
            farthest_m = values[4 * first]
            farthest_m = max(farthest_m, values[4 * first + 8]) if has_right else farthest_m
            farthest_m = max(farthest_m, values[4 * first + 16]) if has_left else farthest_m
            if abs(ahead_m) - most_m > min(farthest_m, range_m):
                break
            behind, gap_m = ahead_m < 0.0, abs(ahead_m) - (length_m[row] + own_length_m) / 2
            reach_m = width_m[row] / 2 + half_lane_m
            for pair, center_m in enumerate((own_m, right_m, left_m)):
                slot = 2 * pair + behind
                nearest_m, its_row = values[4 * slot], codes[slot]
                is_first = (gap_m < nearest_m) | ((gap_m == nearest_m) & (row < its_row))
                is_nearer = (abs(y_m[row] - center_m) < reach_m) & is_first
                values[4 * slot] = gap_m if is_nearer else nearest_m
                codes[slot] = row if is_nearer else its_row
