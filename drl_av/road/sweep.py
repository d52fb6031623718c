"""Collision detection by the motion of bodies within a SUMO step; pure geometry (ours).

A body is a rectangle parallel to the road. In a SUMO step its centre moves on a straight line at a
constant speed, as in SUMO's semi-implicit Euler integration and in the paper's point mass (eq. 5
and 6). Two bodies can therefore touch within a step although they overlap neither before nor after
it.
"""

import math
from collections.abc import Sequence

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing, compiled
from drl_av.road.road import around
from drl_av.road.snapshot import EGO, CollisionKind, Command

BACKWARD_M = 1.0
"""Largest backward movement that counts as the rounding error of a standing vehicle, metres."""
ACCELERATION_M_S2, LATERAL_SPEED_M_S = 10.0, 1.5
"""Upper bounds of each vehicle's acceleration and lateral speed, for ``within_reach``."""

Displacement = tuple[float, float, float, float]
"""The motion of a body's centre in one SUMO step, (s, y, forward, left), metres.

(s, y) is the start along and across the road (left positive); (forward, left) is the displacement.
A plain tuple costs a quarter of the time of a named one.
"""


def moved(
    from_s_m: float, from_y_m: float, to_s_m: float, to_y_m: float, lap_m: float
) -> Displacement:
    """Return the motion of a body from one position (s, y) to another, both in metres.

    The function assumes that the body moves backward by at most ``BACKWARD_M``, or forward by less
    than ``lap_m - BACKWARD_M``.
    """
    forward_m = around(to_s_m - from_s_m + BACKWARD_M, lap_m) - BACKWARD_M
    return from_s_m, from_y_m, forward_m, to_y_m - from_y_m


KINDS = tuple(CollisionKind)
HIT_AHEAD, HIT_BESIDE, HIT_EDGE, HIT_FROM_BEHIND, HIT_FROM_BESIDE = range(len(KINDS))
NO_CONTACT = -1
"""The numbers of the kinds of collision, and of none, for compiled functions."""


def contact(
    ego: Displacement, other: Displacement, length_m: float, width_m: float, lap_m: float
) -> tuple[float, int]:
    """Return the first contact of two bodies in a SUMO step.

    ``length_m`` and ``width_m`` are the means of the two bodies' lengths and widths. If the bodies
    already overlap sideways when they begin to overlap along the road, the faster body hits the
    slower one from behind. Otherwise they touch side by side: the ego hits the other body if the
    ego moves sideways towards it, and is hit if it does not.

    Returns:
        The fraction of the step until the contact, 0 if the bodies overlap before the step; and the
        number of the kind of collision (an index of ``KINDS``); 1 and ``NO_CONTACT`` if they do not
        touch.
    """
    left_m, moved_m = other[1] - ego[1], other[3] - ego[3]
    if stays_apart(left_m, moved_m, width_m):
        return 1.0, NO_CONTACT
    ahead_m, faster_m = other[0] - ego[0], other[2] - ego[2]
    if faster_m < 0.0:  # on a loop the ego approaches the other body from behind
        ahead_m = around(ahead_m + length_m, lap_m) - length_m
    else:
        ahead_m = length_m - around(length_m - ahead_m, lap_m)
    if stays_apart(ahead_m, faster_m, length_m):
        return 1.0, NO_CONTACT
    across, cleared = overlap(left_m, moved_m, width_m)
    along, parted = overlap(ahead_m, faster_m, length_m)
    time = max(along, across, 0.0)
    if time >= min(parted, cleared, 1.0):
        return 1.0, NO_CONTACT
    if across > along:
        return time, HIT_BESIDE if ego[3] * left_m > 0.0 else HIT_FROM_BESIDE
    came_upon = faster_m < 0.0 or (faster_m == 0.0 and ahead_m >= 0.0)
    return time, HIT_AHEAD if came_upon else HIT_FROM_BEHIND


def stays_apart(distance_m: float, moved_m: float, size_m: float) -> bool:
    """Return whether a distance that changes by ``moved_m`` stays beyond ``size_m`` on one side."""
    if distance_m < 0.0:
        distance_m, moved_m = -distance_m, -moved_m
    return distance_m >= size_m and distance_m + moved_m >= size_m


def overlap(distance_m: float, moved_m: float, size_m: float) -> tuple[float, float]:
    """Return (start, end), in fractions of the step, in which the distance is below ``size_m``."""
    if moved_m == 0.0:
        return (-math.inf, math.inf) if abs(distance_m) < size_m else (math.inf, math.inf)
    edge_m = math.copysign(size_m, moved_m)
    return (-edge_m - distance_m) / moved_m, (edge_m - distance_m) / moved_m


@borrowing
def swept_collision(
    from_s_m: FloatArray,
    from_y_m: FloatArray,
    to_s_m: FloatArray,
    to_y_m: FloatArray,
    length_m: FloatArray,
    width_m: FloatArray,
    lap_m: float,
) -> tuple[int, int, float]:
    """Return the first collision of the ego, row 0, in a SUMO step.

    The arrays have shape (1 + N,): the positions of all bodies before and after the step, and their
    sizes.

    Returns:
        The row of the other body, the number of the kind of collision (an index of ``KINDS``), and
        the fraction of the step until the contact; 0, ``NO_CONTACT`` and 1 without a collision.
    """
    first, row, kind = 1.0, 0, NO_CONTACT
    ego = moved(from_s_m[0], from_y_m[0], to_s_m[0], to_y_m[0], lap_m)
    for other in range(1, len(from_s_m)):
        its_length_m = (length_m[0] + length_m[other]) / 2
        its_width_m = (width_m[0] + width_m[other]) / 2
        left_m = from_y_m[other] - from_y_m[0]
        if stays_apart(left_m, to_y_m[other] - from_y_m[other] - ego[3], its_width_m):
            continue
        its = moved(from_s_m[other], from_y_m[other], to_s_m[other], to_y_m[other], lap_m)
        time, found = contact(ego, its, its_length_m, its_width_m, lap_m)
        if found != NO_CONTACT and time < first:
            first, row, kind = time, other, found
    return row, kind, first


@compiled
def rows_within_reach(
    state: FloatArray,
    rolled_m: float,
    lowest_m: float,
    highest_m: float,
    time_s: float,
    step_s: float,
    bounds: FloatArray,
    rows: IntArray,
) -> int:
    """Find the vehicles that can touch the ego during its commands, as ``within_reach``.

    Args:
        state: The rows s, y and speed of all vehicles before the first command; the ego first.
        rolled_m: The distance that the ego covers.
        lowest_m: Its rightmost lateral position.
        highest_m: Its leftmost lateral position.
        time_s: The time that the commands take.
        step_s: The length of a SUMO step.
        bounds: The largest length and width of a vehicle, metres, its largest lateral speed, m/s,
            and the length of a lap of the road, metres.
        rows: An array of shape (N,) or longer, whose first elements the function sets to row
            indices, in ascending order.

    Returns:
        The number of rows.
    """
    count, (length_m, width_m, lateral_m_s, lap_m) = 0, bounds
    aside_m = width_m + lateral_m_s * time_s
    right_m, left_m = lowest_m - aside_m, highest_m + aside_m
    gained_m = ACCELERATION_M_S2 * time_s * (time_s + step_s) / 2 - rolled_m
    for row in range(1, state.shape[1]):
        if right_m < state[1, row] < left_m:
            closer_m = state[2, row] * time_s + gained_m
            behind_m = length_m + closer_m if closer_m > 0.0 else length_m
            ahead_m = (state[0, row] - state[0, 0] + behind_m) % lap_m
            if ahead_m < behind_m + length_m + rolled_m:
                rows[count] = row
                count += 1
    return count


def within_reach(
    state: FloatArray, commands: Sequence[Command], step_s: float, bounds: FloatArray
) -> list[int]:
    """Return the rows of all vehicles that can touch the ego during its commands, ascending.

    A row is an index into each of the arrays of ``state``: s, y and the speed of each vehicle
    before the first command. The function assumes that a vehicle can stop at once, accelerate with
    ``ACCELERATION_M_S2``, and move sideways at the speed in ``bounds`` (``rows_within_reach``).
    Each command takes one SUMO step of ``step_s`` seconds.
    """
    rolled_m, lowest_m = 0.0, float(state[1, EGO])
    highest_m = lowest_m
    for speed, to_m, _ in commands:
        rolled_m += step_s * speed
        if to_m < lowest_m:
            lowest_m = to_m
        elif to_m > highest_m:
            highest_m = to_m
    rows, way_m = np.empty(state.shape[1], np.int64), (rolled_m, lowest_m, highest_m)
    times_s = float(step_s * len(commands)), float(step_s)
    near = np.ascontiguousarray(state, np.float64)
    count = rows_within_reach.fast(near, *way_m, *times_s, bounds, rows)
    return rows[:count].tolist() if count else []
