"""Decides the right of way of two vehicles that want to enter the same lane from opposite sides.

Neither vehicle is in that lane yet, so neither counts in the other's gaps. Without this rule both
would begin and could collide in the middle of the lane.
"""

import numpy as np

from drl_av.compiled import compiled
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.driving.affordances import IntArray
from drl_av.road.road import FloatArray
from drl_av.road.road_numbers import ahead_m, lane_of
from drl_av.safety.reachability import stopping_distance


@compiled
def give_way(
    rows: IntArray,
    sides: IntArray,
    s_m: FloatArray,
    y_m: FloatArray,
    speed_m_s: FloatArray,
    lateral_speed_m_s: FloatArray,
    length_m: FloatArray,
    road_m: tuple[float, float],
    braking_m_s2: float,
    times_s: tuple[float, float],
) -> None:
    """Set those of the wanted lane changes to 0 that conflict with another vehicle's.

    Two vehicles conflict if they enter the same lane from opposite sides, and the rear vehicle
    could not stop behind the front vehicle by braking with ``braking_m_s2`` from the next decision
    on. A vehicle that is already changing lanes has priority. Between two others, the vehicle that
    comes first in ``rows`` has priority.

    Args:
        rows: The row of each vehicle that decides, shape (R,).
        sides: The lane change that each row wants, shape (1 + N,): +1 left, -1 right, 0 none.
        s_m: The position of each vehicle, shape (1 + N,); the next four arrays likewise.
        y_m: Its lateral position.
        speed_m_s: Its speed.
        lateral_speed_m_s: Its lateral speed.
        length_m: Its length.
        road_m: The lengths of a lap and of a lane's width, metres.
        braking_m_s2: The hardest braking of the vehicles.
        times_s: The time of a decision and of a SUMO step, seconds.
    """
    lap_m, width_m = road_m
    most, count = len(s_m) + len(rows), 0
    entering, lanes = np.empty(most, np.int64), np.empty(most, np.int64)
    for row in range(len(s_m)):  # under way: the lane is the one whose centre it reaches next
        if lateral_speed_m_s[row] != 0.0:
            lane = lane_of(y_m[row], width_m)
            leaves = (y_m[row] - lane * width_m) * lateral_speed_m_s[row] >= 0.0
            toward = 1 if lateral_speed_m_s[row] > 0.0 else -1
            entering[count], lanes[count] = row, lane + toward * leaves
            count += 1
    for row in rows:
        if sides[row] == 0:
            continue
        lane = lane_of(y_m[row], width_m) + sides[row]
        center_m, gives_way = lane * width_m, False
        for place in range(count):
            other = entering[place]
            opposite = (y_m[row] < center_m) != (y_m[other] < center_m)
            if lanes[place] == lane and opposite:
                lead_m = ahead_m(s_m[row], s_m[other], lap_m)
                rear, front = (row, other) if lead_m >= 0.0 else (other, row)
                gap_m = abs(lead_m) - (length_m[row] + length_m[other]) / 2
                rolled_m = closing_distance(
                    speed_m_s[rear], speed_m_s[front], braking_m_s2, times_s
                )
                gives_way = gives_way or gap_m < STANDSTILL_GAP_M + rolled_m
        if gives_way:
            sides[row] = 0
        else:
            entering[count], lanes[count] = row, lane
            count += 1


def closing_distance(
    fast_m_s: float, slow_m_s: float, braking_m_s2: float, times_s: tuple[float, float]
) -> float:
    """Return by how much a gap shrinks, metres, until both vehicles stand.

    The vehicle behind, of speed ``fast_m_s``, brakes one decision later than the one ahead.
    """
    decision_s, step_s = times_s
    fast_m = stopping_distance(fast_m_s, braking_m_s2, step_s)
    slow_m = stopping_distance(slow_m_s, braking_m_s2, step_s)
    rolled_m: float = decision_s * fast_m_s + max(fast_m - slow_m, 0.0)
    return rolled_m
