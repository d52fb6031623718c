"""The state of all vehicles at one moment, the ego's collisions, and commands to the simulation."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray

FLOAT64, STRIDES = np.dtype(np.float64), (8,)
"""The type and the strides of the arrays that compiled functions take."""
EGO = 0
"""Index of the ego in every array of a snapshot."""
EGO_ID = "ego"
"""Id of the ego in SUMO."""


class CollisionKind(Enum):
    """The kinds of the ego's collisions: the other object, and which of the two hit the other."""

    HIT_AHEAD = "ego hit the vehicle ahead"
    HIT_BESIDE = "ego moved into a vehicle beside it"
    HIT_EDGE = "ego left the open lanes"
    HIT_FROM_BEHIND = "ego was hit from behind"
    HIT_FROM_BESIDE = "a vehicle beside moved into the ego"

    @property
    def ego_hit(self) -> bool:
        """True if the ego hit something, False if another vehicle hit the ego."""
        return self in (CollisionKind.HIT_AHEAD, CollisionKind.HIT_BESIDE, CollisionKind.HIT_EDGE)


@dataclass(frozen=True)
class Collision:
    """A collision of the ego; ``other`` is the other vehicle's id, or None for the road's edge."""

    kind: CollisionKind
    other: str | None


Vehicles = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""The arrays of a snapshot, from ``s_m`` to ``width_m``, shape (1 + N,), the ego first."""


class Snapshot(NamedTuple):
    """All vehicles at one moment; each array has shape (1 + N,), with the ego at index 0."""

    time_s: float
    """Time since the reset."""
    ids: tuple[str, ...]
    s_m: FloatArray
    """Position of the body's centre along the road, in [0, ``Road.lap_m``)."""
    y_m: FloatArray
    """Lateral position of the body's centre, left positive; 0 is the rightmost lane's centre."""
    speed_m_s: FloatArray
    lateral_speed_m_s: FloatArray
    """Lateral velocity, left positive."""
    length_m: FloatArray
    width_m: FloatArray
    sumo_lane_change: int | None = None
    """The lane change that SUMO's model would make with the ego: +1 left, -1 right, 0 none; None
    where no SUMO is asked, as in the twin."""

    def of_rows(self, rows: Sequence[int]) -> "Snapshot":
        """Return the snapshot of the vehicles in some rows, in the order of these."""
        ids = tuple(self.ids[row] for row in rows)
        s, y, v, v_y, length, width = (array[rows] for array in self[2:8])
        return Snapshot(self.time_s, ids, s, y, v, v_y, length, width, self.sumo_lane_change)

    @property
    def arrays(self) -> Vehicles:
        """The six arrays, from ``s_m`` to ``width_m``, as the compiled functions take them."""
        arrays = self[2:8]
        for array in arrays:
            if array.strides != STRIDES or array.dtype is not FLOAT64:
                s, y, v, v_y, length, width = (np.ascontiguousarray(e, np.float64) for e in arrays)
                return s, y, v, v_y, length, width
        return arrays


class TrafficCommands(NamedTuple):
    """The decisions of our background drivers, one a vehicle, valid until the next decision."""

    rows: IntArray
    """Index of each vehicle in the snapshot, shape (R,)."""
    acceleration_m_s2: FloatArray
    side: IntArray
    """A lane change to the left (+1) or right (-1), or none (0)."""

    def lane_changes(self) -> list[tuple[int, int]]:
        """Return the wanted lane changes, as pairs (row, side)."""
        (wanted,) = self.side.nonzero()
        if not len(wanted):
            return []
        return [*zip(self.rows[wanted].tolist(), self.side[wanted].tolist(), strict=True)]


NO_COMMANDS = TrafficCommands(np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64))


class Command(NamedTuple):
    """The ego's state at the end of one SUMO step, which the simulation must produce."""

    speed_m_s: float
    y_m: float
    lateral_speed_m_s: float
    """The ego's lateral velocity after that step; 0 if a lane change has just ended."""
