"""Collision detection: bodies that touch while they move in a SUMO step; pure geometry (ours).

A body is a rectangle parallel to the road. In a SUMO step its centre moves on a straight line at a
constant speed, as in SUMO's semi-implicit Euler integration and in the point mass of eq. 5. Two
bodies can therefore touch within a step although they overlap neither before nor after it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

from drl_av.traffic.road import Road
from drl_av.traffic.snapshot import EGO, Collision, CollisionKind, Command, Snapshot

BACKWARD_M = 1.0
"""A backward movement up to this is a rounding error of a vehicle that stands."""
ACCELERATION_M_S2, LATERAL_SPEED_M_S = 10.0, 1.5
"""Upper bounds for all vehicles, which ``Bodies.within_reach`` uses."""

Motion = tuple[float, float, float, float]
"""The motion of a body's centre in one SUMO step, metres: its start along and across the road, left
positive, and its displacement forward and to the left. A plain tuple costs a quarter of the time of
a named one, and each decision makes several."""


class Contact(NamedTuple):
    """The first contact of two bodies in a step: its time and its kind."""

    time: float
    """Fraction of the step until the contact; 0 if the bodies overlap before the step."""
    kind: CollisionKind
    """The kind of collision from the view of the body that counts as the ego."""


def motion(from_s_m: float, from_y_m: float, to_s_m: float, to_y_m: float, road: Road) -> Motion:
    """The motion of a body between two places: forward, and by less than a lap."""
    forward_m = (to_s_m - from_s_m + BACKWARD_M) % road.lap_m - BACKWARD_M
    return from_s_m, from_y_m, forward_m, to_y_m - from_y_m


def first_contact(
    ego: Motion, other: Motion, length_m: float, width_m: float, road: Road
) -> Contact | None:
    """The first contact of two bodies in a step, or None.

    ``length_m`` and ``width_m`` are the means of the sizes of both bodies.
    The axis on which the bodies begin to overlap last decides the kind. Along the road the faster
    body hit the other one. Across the road the ego hit the other body if it moved towards it.
    """
    left_m, moved_m = other[1] - ego[1], other[3] - ego[3]
    if _stays_apart(left_m, moved_m, width_m):
        return None
    ahead_m, faster_m = other[0] - ego[0], other[2] - ego[2]
    if faster_m < 0.0:  # on a loop the ego comes upon it from behind
        ahead_m = (ahead_m + length_m) % road.lap_m - length_m
    else:
        ahead_m = length_m - (length_m - ahead_m) % road.lap_m
    if _stays_apart(ahead_m, faster_m, length_m):
        return None
    across, cleared = _overlap(left_m, moved_m, width_m)
    along, parted = _overlap(ahead_m, faster_m, length_m)
    time = max(along, across, 0.0)
    if time >= min(parted, cleared, 1.0):
        return None
    if across > along:
        moved_in = ego[3] * left_m > 0.0
        kind = CollisionKind.HIT_BESIDE if moved_in else CollisionKind.HIT_FROM_BESIDE
    else:
        came_upon = faster_m < 0.0 or (faster_m == 0.0 and ahead_m >= 0.0)
        kind = CollisionKind.HIT_AHEAD if came_upon else CollisionKind.HIT_FROM_BEHIND
    return Contact(time, kind)


def _stays_apart(distance_m: float, moved_m: float, size_m: float) -> bool:
    """Whether a distance is at least a size before and after a move, on the same side."""
    if distance_m < 0.0:
        distance_m, moved_m = -distance_m, -moved_m
    return distance_m >= size_m and distance_m + moved_m >= size_m


def _overlap(distance_m: float, moved_m: float, size_m: float) -> tuple[float, float]:
    """Start and end of the time in which a distance is below a size, in fractions of the step."""
    if moved_m == 0.0:
        return (-math.inf, math.inf) if abs(distance_m) < size_m else (math.inf, math.inf)
    edge_m = math.copysign(size_m, moved_m)
    return (-edge_m - distance_m) / moved_m, (edge_m - distance_m) / moved_m


@dataclass(frozen=True)
class Bodies:
    """The vehicles of an episode as rectangles; one row for each, the ego's first."""

    ids: Sequence[str]
    length_m: Sequence[float]
    width_m: Sequence[float]
    road: Road
    lateral_speed_m_s: float = LATERAL_SPEED_M_S
    """Upper bound of their lateral speeds."""

    @cached_property
    def _largest_m(self) -> tuple[float, float]:
        return max(self.length_m), max(self.width_m)

    def within_reach(
        self,
        s_m: Sequence[float],
        y_m: Sequence[float],
        speed_m_s: Sequence[float],
        commands: Sequence[Command],
        step_s: float,
    ) -> list[int]:
        """The rows of all vehicles that can touch the ego while it executes commands, ascending.

        A vehicle is assumed to stop at once, to accelerate with ``ACCELERATION_M_S2``, or to move
        sideways at ``lateral_speed_m_s``.
        """
        time_s, (length_m, aside_m) = step_s * len(commands), self._largest_m
        aside_m += self.lateral_speed_m_s * time_s
        lowest_m = highest_m = y_m[EGO]
        rolled_m = 0.0
        for speed, to_m, _ in commands:
            rolled_m += step_s * speed
            if to_m < lowest_m:
                lowest_m = to_m
            elif to_m > highest_m:
                highest_m = to_m
        right_m, left_m = lowest_m - aside_m, highest_m + aside_m
        beside = [row for row, at_m in enumerate(y_m) if right_m < at_m < left_m]
        gained_m = ACCELERATION_M_S2 * time_s * (time_s + step_s) / 2 - rolled_m
        rows = []
        for row in beside[1:]:
            behind_m = length_m + max(speed_m_s[row] * time_s + gained_m, 0.0)
            ahead_m = (s_m[row] - s_m[EGO] + behind_m) % self.road.lap_m
            if ahead_m < behind_m + length_m + rolled_m:
                rows.append(row)
        return rows

    def ego_collision(self, moves: Mapping[int, Motion]) -> Collision | None:
        """The ego's first collision in a step with one of the moved rows, or None."""
        first, collision, ego = 1.0, None, moves[EGO]
        for row, move in moves.items():
            if row != EGO:
                contact = self._contact(EGO, ego, row, move)
                if contact is not None and contact.time < first:
                    first, collision = contact.time, Collision(contact.kind, self.ids[row])
        return collision

    def collisions(self, moves: Mapping[int, Motion]) -> list[tuple[str, str]]:
        """The pairs of vehicles, including the ego, that touch each other in a step."""
        return [
            (self.ids[one], self.ids[other])
            for (one, its), (other, others) in combinations(moves.items(), 2)
            if self._contact(one, its, other, others)
        ]

    def _contact(self, one: int, its: Motion, other: int, others: Motion) -> Contact | None:
        length_m = (self.length_m[one] + self.length_m[other]) / 2
        width_m = (self.width_m[one] + self.width_m[other]) / 2
        return first_contact(its, others, length_m, width_m, self.road)


def bodies(snapshot: Snapshot, road: Road) -> Bodies:
    """The vehicles of a snapshot as rectangles."""
    return Bodies(snapshot.ids, snapshot.length_m.tolist(), snapshot.width_m.tolist(), road)


def motions(before: Snapshot, after: Snapshot, road: Road) -> dict[int, Motion]:
    """The motions of the vehicles between two snapshots, by row."""
    columns = (before.s_m, before.y_m, after.s_m, after.y_m)
    ends = zip(*(column.tolist() for column in columns), strict=True)
    return {
        row: motion(from_s_m, from_y_m, to_s_m, to_y_m, road)
        for row, (from_s_m, from_y_m, to_s_m, to_y_m) in enumerate(ends)
    }
