"""Collision detection by the motion of bodies within a SUMO step; pure geometry (ours).

A body is a rectangle parallel to the road. In a SUMO step its centre moves on a straight line at a
constant speed, as in SUMO's semi-implicit Euler integration and in the paper's point mass (eq. 5
and 6). Two bodies can therefore touch within a step although they overlap neither before nor after
it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import numpy.typing as npt

from drl_av.compiled import borrowing, compiled
from drl_av.road.compiled_road import around
from drl_av.road.road import FloatArray, Road
from drl_av.road.snapshot import EGO, Collision, CollisionKind, Command, Snapshot

IntArray = npt.NDArray[np.int64]
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


@dataclass(frozen=True)
class VehicleRectangles:
    """The vehicles of an episode as rectangles; index 0 of each sequence is the ego."""

    ids: Sequence[str]
    length_m: Sequence[float]
    width_m: Sequence[float]
    road: Road
    lateral_speed_m_s: float = LATERAL_SPEED_M_S
    """Upper bound of the lateral speed of each vehicle."""

    @cached_property
    def _bounds(self) -> FloatArray:
        """The largest length, width and lateral speed of a vehicle, and the length of a lap."""
        largest_m = max(self.length_m), max(self.width_m)
        return np.array((*largest_m, self.lateral_speed_m_s, self.road.lap_m), np.float64)

    def within_reach(
        self, state: FloatArray, commands: Sequence[Command], step_s: float
    ) -> list[int]:
        """Return the rows of all vehicles that can touch the ego during its commands, ascending.

        A row is an index into each of the arrays of ``state``: s, y and the speed of each vehicle
        before the first command. The method assumes that a vehicle can stop at once, accelerate
        with ``ACCELERATION_M_S2``, and move sideways at ``lateral_speed_m_s``. Each command takes
        one SUMO step of ``step_s`` seconds.
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
        count = rows_within_reach.fast(near, *way_m, *times_s, self._bounds, rows)
        return rows[:count].tolist() if count else []

    def ego_collision(self, moves: Mapping[int, Displacement]) -> Collision | None:
        """Return the ego's first collision in a SUMO step with a vehicle in ``moves``, or None.

        ``moves`` holds the motions of the ego and of some vehicles, by row index.
        """
        first, collision, ego = 1.0, None, moves[EGO]
        for row, move in moves.items():
            if row != EGO:
                time, kind = self._contact(EGO, ego, row, move)
                if kind != NO_CONTACT and time < first:
                    first, collision = time, Collision(KINDS[kind], self.ids[row])
        return collision

    def collisions(self, moves: Mapping[int, Displacement]) -> list[tuple[str, str]]:
        """Return each pair of vehicles that touch each other in a SUMO step, as a pair of ids.

        ``moves`` holds the motion of each vehicle, the ego included, by its row index.
        """
        return [
            (self.ids[one], self.ids[other])
            for (one, its), (other, others) in combinations(moves.items(), 2)
            if self._contact(one, its, other, others)[1] != NO_CONTACT
        ]

    def _contact(
        self, one: int, its: Displacement, other: int, others: Displacement
    ) -> tuple[float, int]:
        """Return the first ``contact`` of the vehicles in rows ``one`` and ``other``."""
        length_m = (self.length_m[one] + self.length_m[other]) / 2
        width_m = (self.width_m[one] + self.width_m[other]) / 2
        return contact(its, others, length_m, width_m, self.road.lap_m)


def rectangles_of(snapshot: Snapshot, road: Road) -> VehicleRectangles:
    """Return the vehicles of a snapshot as rectangles."""
    return VehicleRectangles(
        snapshot.ids, snapshot.length_m.tolist(), snapshot.width_m.tolist(), road
    )


def displacements(before: Snapshot, after: Snapshot, road: Road) -> dict[int, Displacement]:
    """Return the motion of each vehicle between two snapshots of the same vehicles.

    The key is the vehicle's row index in the snapshot arrays.
    """
    columns = (before.s_m, before.y_m, after.s_m, after.y_m)
    ends = zip(*(column.tolist() for column in columns), strict=True)
    return {
        row: moved(from_s_m, from_y_m, to_s_m, to_y_m, road.lap_m)
        for row, (from_s_m, from_y_m, to_s_m, to_y_m) in enumerate(ends)
    }
