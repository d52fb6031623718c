"""The scene, the input of a decision: all vehicles, the indicators, the lane change in progress.

``infer_action`` finds the action that explains two scenes of an ego that SUMO drives.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, ObservationConfig
from drl_av.config.functions import is_users
from drl_av.driving.actions import Action, Lateral, nearest_action, toward
from drl_av.driving.affordances import Affordances, Indicators, affordances_of, compute_indicators
from drl_av.errors import ConfigError
from drl_av.road.road import ARRIVED_M, OPEN_LAP_M, Road, is_open
from drl_av.road.snapshot import EGO, Snapshot


class LaneChange(NamedTuple):
    """A lane change in progress; ``origin`` and ``target`` are lane indices, 0 is the rightmost.

    Its progress follows from the ego's lateral position alone. An abort exchanges ``origin`` and
    ``target``; the ego then needs as much time to return as it has needed so far.
    """

    origin: int
    target: int
    heading_rad: float = 0.0
    """Angle between the ego and its lane, atan(v_y / v_x), left positive; steering plant only."""

    @property
    def sign(self) -> int:
        """Direction of the lane change: +1 left, -1 right."""
        return 1 if self.target > self.origin else -1

    def reversed(self) -> "LaneChange":
        """Return the lane change back to the lane where this one started."""
        return LaneChange(self.target, self.origin, self.heading_rad)


@dataclass(eq=False)
class Scene:
    """All information that a driver or a safety check may use for a decision.

    ``indicators`` are the indicators as arrays, for compiled functions. ``lane_change`` is the
    ego's lane change in progress, or None.
    """

    snapshot: Snapshot
    indicators: Indicators
    lane_change: LaneChange | None
    road: Road

    @classmethod
    def from_arrays(
        cls,
        s_m: npt.ArrayLike,
        y_m: npt.ArrayLike,
        speed_m_s: npt.ArrayLike,
        lateral_speed_m_s: npt.ArrayLike = 0.0,
        length_m: npt.ArrayLike = 5.0,
        width_m: npt.ArrayLike = 1.8,
        *,
        lanes: int = 3,
        lane_width_m: float = 3.8,
        lane_change: LaneChange | None = None,
    ) -> "Scene":
        """Return the scene of vehicles on a straight road, for a safety check outside SUMO.

        Each of the first six arguments is an array of shape (1 + N,), the ego first, or one number
        for all vehicles.

        Args:
            s_m: Positions of the centres of the bodies along the road, from any origin.
            y_m: Positions across the road, left positive; the centre of lane k is at
                ``k * lane_width_m``, and lane 0 is the rightmost.
            speed_m_s: Speeds.
            lateral_speed_m_s: Lateral speeds, left positive.
            length_m: Lengths of the bodies.
            width_m: Widths of the bodies.
            lanes: Number of lanes.
            lane_width_m: Width of each lane.
            lane_change: The ego's lane change in progress; the ego is in one of its two lanes.

        Raises:
            ConfigError: the arrays do not fit together, a value is not finite, a body has no size,
                there are no such lanes, the ego is in none of them, or the lane change is none.
        """
        given = s_m, y_m, speed_m_s, lateral_speed_m_s, length_m, width_m
        try:
            arrays = np.array(np.broadcast_arrays(*(np.asarray(one, np.float64) for one in given)))
            shape, size_m = arrays.shape[1:], arrays[4:].min(initial=np.inf)
            if not (len(shape) == 1 and arrays.size and np.isfinite(arrays).all() and size_m > 0):
                raise ValueError(f"shape {shape}, smallest size {size_m:g} m, or nan or inf")
        except ValueError as error:
            raise ConfigError(
                f"The arrays of a scene do not fit together ({error}): give each shape (1 + N,), "
                "the ego first, or one number, all finite, and length_m and width_m above 0."
            ) from error
        there = int(lanes) if isinstance(lanes, Integral) else 0
        is_number = np.ndim(lane_width_m) == 0 and np.asarray(lane_width_m).dtype.kind in "fiu"
        width_m = float(lane_width_m) if is_number else 0.0
        road = Road(OPEN_LAP_M, width_m, (True,) * there, end_m=OPEN_LAP_M)
        fits = 0.0 < width_m < OPEN_LAP_M and is_open(road.lane_of(arrays[1, EGO]), road)
        if fits and lane_change is not None:
            is_change = isinstance(lane_change, LaneChange)
            is_change = is_change and all(isinstance(one, Integral) for one in lane_change[:2])
            origin, target = lane_change[:2] if is_change else (-1, -1)
            fits = abs(target - origin) == 1 and is_open(origin, road) and is_open(target, road)
            fits = fits and road.lane_of(arrays[1, EGO]) in (origin, target)
        if not fits:
            raise ConfigError(
                f"A road of {lanes!r} lanes of {lane_width_m!r} m cannot have the ego at y_m = "
                f"{arrays[1, EGO]:g} with lane_change {lane_change}: give lanes a whole number "
                "from 1 on, lane_width_m metres, an ego in a lane, where the centre of lane k is "
                "at k * lane_width_m, left positive, and a change between its lane and the next."
            )
        ids = "ego", *map(str, range(1, len(arrays[0])))
        shot = Snapshot(0.0, ids, *arrays)
        seen = compute_indicators(shot, road, ObservationConfig().range_m)
        return cls(shot, seen, lane_change, road)

    @cached_property
    def affordances(self) -> Affordances:
        """The indicators by name."""
        return affordances_of(self.indicators, self.road)

    @property
    def lanes(self) -> tuple[int, int]:
        """The two lanes of the lane change in progress, equal if there is none."""
        change = self.lane_change
        return (0, 0) if change is None else (change.origin, change.target)


STILL_M = 1e-6
"""A lateral movement of at most this distance, metres, within a decision counts as none."""


@contextmanager
def unwritable(user: object, *scenes: Scene) -> Iterator[None]:
    """Let an object or function of the user's not write the arrays of scenes in the block.

    The world goes on with these arrays. Nothing changes for an object of this package.
    """
    arrays: list[npt.NDArray[Any]] = []
    for scene in scenes if is_users(user) else ():
        values, codes, *_ = scene.indicators
        arrays += [each for each in (*scene.snapshot[2:8], values, codes) if each.flags.writeable]
    try:
        for array in arrays:
            array.flags.writeable = False
        yield
    finally:
        for array in arrays:
            array.flags.writeable = True


def infer_action(
    before: Scene, after: Snapshot, road: Road, config: Config
) -> tuple[Action, LaneChange | None]:
    """Return the action nearest to the ego's motion from ``before`` to ``after`` (ours).

    The second result is the lane change in progress after the decision, or None. A lane change
    begins when the ego leaves the centre of its lane. It is aborted when the ego reverses its
    lateral direction, and it ends at the centre of a lane.
    """
    gained_m_s = float(after.speed_m_s[EGO]) - before.affordances.ego_speed_m_s
    acceleration = gained_m_s / config.simulation.decision_interval_s
    longitudinal = nearest_action(acceleration, config.ego)
    y_m = float(after.y_m[EGO])
    moved_m = y_m - before.affordances.ego_y_m
    sign = (moved_m > STILL_M) - (moved_m < -STILL_M)
    change = before.lane_change
    lateral = Lateral.KEEP
    if sign and (change is None or sign != change.sign):
        lateral = toward(sign)
        lane = before.affordances.lane
        change = LaneChange(lane, lane + sign) if change is None else change.reversed()
    lane = road.lane_of(y_m)
    if change is None or abs(y_m - road.center_m(lane)) <= ARRIVED_M:
        return Action(lateral, longitudinal), None
    if (y_m - road.center_m(change.target)) * change.sign > 0:  # it continues to the next lane
        change = LaneChange(change.target, change.target + change.sign)
    return Action(lateral, longitudinal), change
