"""Computes the six neighbours of the affordance indicators for many vehicles at once."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.driving.affordances import SIDES
from drl_av.road.road import CENTERED_M, FloatArray, Road
from drl_av.road.snapshot import Snapshot

OWN, RIGHT, LEFT = range(3)
"""Indices of the lane axis: a vehicle's own lane, the lane to its right, the lane to its left."""
FRONT, REAR = range(2)
"""Indices of the last axis: the neighbour ahead, the neighbour behind."""


class Surroundings(NamedTuple):
    """The nearest neighbours of R vehicles.

    The axes of the arrays are the vehicle, the lane (own, right, left), and front/rear.
    """

    has_lane: npt.NDArray[np.bool_]
    """Shape (R, 3): whether the lane exists and is open; always True for the own lane."""
    gap_m: FloatArray
    """Shape (R, 3, 2): gap from bumper to bumper, never negative; inf without a neighbour."""
    relative_speed_m_s: FloatArray
    """Shape (R, 3, 2): speed of the neighbour minus that of the vehicle; 0 without a neighbour."""
    lateral_offset_m: FloatArray
    """Shape (R, 3, 2): y of the neighbour minus y of the vehicle, left positive.

    Without a neighbour, the y of the lane's centre takes the place of the neighbour's.
    """
    relative_lateral_speed_m_s: FloatArray
    """Shape (R, 3, 2): lateral speed of the neighbour minus that of the vehicle, left positive; 0
    without a neighbour."""
    speed_m_s: FloatArray
    """Speed of each of the R vehicles; this field and the next three have shape (R,)."""
    y_m: FloatArray
    """Position of the vehicle's centre, left positive from the centre of the rightmost lane."""
    off_center_m: FloatArray
    """Offset from the centre of the own lane, left positive."""
    lateral_speed_m_s: FloatArray
    range_m: float
    """Largest gap at which another vehicle counts as a neighbour."""

    @property
    def under_way(self) -> npt.NDArray[np.bool_]:
        """Whether each vehicle is changing lanes, that is, is off its lane's centre; shape (R,)."""
        return np.abs(self.off_center_m) > CENTERED_M

    def vectors(self) -> FloatArray:
        """Return each vehicle's 27 indicators, shape (R, 27), ordered as ``Affordances.vector``."""
        absent_m = np.where(self.has_lane, self.range_m, 0.0)[:, :, None]
        neighbors = np.stack(
            (
                np.where(np.isfinite(self.gap_m), self.gap_m, absent_m),
                self.relative_speed_m_s,
                self.lateral_offset_m,
                self.relative_lateral_speed_m_s,
            ),
            axis=-1,
        )
        own = np.stack((self.speed_m_s, self.y_m, self.lateral_speed_m_s), axis=-1)
        return np.concatenate((neighbors.reshape(len(own), 24), own), axis=1)


def surroundings(
    snapshot: Snapshot, road: Road, range_m: float, rows: npt.NDArray[np.intp]
) -> Surroundings:
    """Find the neighbours of R vehicles by the rules of ``compute_affordances``.

    ``rows``, shape (R,), holds the row index of each vehicle in the snapshot arrays.
    """
    y, speed, lateral = snapshot.y_m, snapshot.speed_m_s, snapshot.lateral_speed_m_s
    lane = np.floor(y[rows] / road.lane_width_m + 0.5).astype(np.intp)
    centers_m = lane[:, None] * road.lane_width_m + road.lane_width_m * np.array(SIDES)
    gap_m, other = _nearest(snapshot, road, centers_m, rows)
    there = gap_m <= range_m

    def relative(values: FloatArray, absent: FloatArray | float) -> FloatArray:
        return np.where(there, values[other] - values[rows, None, None], absent)

    return Surroundings(
        has_lane=_has_lane(lane, road),
        gap_m=np.where(there, np.maximum(gap_m, 0.0), np.inf),
        relative_speed_m_s=relative(speed, 0.0),
        lateral_offset_m=relative(y, (centers_m - y[rows, None])[:, :, None]),
        relative_lateral_speed_m_s=relative(lateral, 0.0),
        speed_m_s=speed[rows],
        y_m=y[rows],
        off_center_m=y[rows] - centers_m[:, OWN],
        lateral_speed_m_s=lateral[rows],
        range_m=range_m,
    )


def _nearest(
    snapshot: Snapshot, road: Road, centers_m: FloatArray, rows: npt.NDArray[np.intp]
) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Return the gaps to the nearest neighbours of R vehicles, m, and the neighbours' row indices.

    Both have shape (R, 3, 2); the axes are the vehicle, the lane (own, right, left) and front/rear.
    ``rows``, shape (R,), holds the row index of each vehicle; ``centers_m``, shape (R, 3), holds
    the y of the lanes' centres. A gap is negative if the bodies are side by side. Without a
    neighbour the gap is inf, and the row index is arbitrary.
    """
    length, looking = snapshot.length_m, np.arange(len(rows))
    ahead_m = road.ahead_m(snapshot.s_m[rows, None], snapshot.s_m)
    clearance_m = np.abs(ahead_m) - (length + length[rows, None]) / 2
    clearance_m[looking, rows] = np.inf
    in_front = (ahead_m >= 0.0)[:, None]
    sides = np.where(np.concatenate((in_front, ~in_front), 1), clearance_m[:, None], np.inf)
    reach_m = snapshot.width_m / 2 + road.lane_width_m / 2
    occupies = np.abs(snapshot.y_m - centers_m[:, :, None]) < reach_m
    distances = np.where(occupies[:, :, None], sides[:, None], np.inf)
    other = distances.argmin(axis=3)
    return np.take_along_axis(distances, other[..., None], axis=3)[..., 0], other


def _has_lane(lane: npt.NDArray[np.intp], road: Road) -> npt.NDArray[np.bool_]:
    fenced = np.array((False, *road.open_lanes, False))
    exists: npt.NDArray[np.bool_] = fenced[
        np.clip(lane[:, None] + np.array(SIDES) + 1, 0, len(fenced) - 1)
    ]
    exists[:, OWN] = True
    return exists
