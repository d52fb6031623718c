"""Families of scenes on open roads, for the falsifier: a lane that ends, a merge, and an exit.

The roads are those of the scenario kinds ``merge`` and ``exit``. Lane 0 is the acceleration or the
deceleration lane; lanes 1 and 2 are the through lanes. If the ego collides with the end of a lane,
or with the point at which two lanes part, this counts as a hit by the ego.
"""

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.scenarios.highways import ExitDescription, MergeDescription
from verification.adversary import LENGTH_M, World
from verification.families import BRAKES, Family, ahead, needed_gap, placed, with_safe_gaps

MERGE = MergeDescription(lanes=2, flow_per_h=0.0, acceleration_lane_m=150.0, after_m=1000.0)
EXIT = ExitDescription(lanes=2, flow_per_h=0.0)
MERGE_ROAD, EXIT_ROAD = MERGE.plan().road, EXIT.plan().road
(RAMP,), (OFF_RAMP,) = MERGE_ROAD.partial_lanes, EXIT_ROAD.partial_lanes
HALF_M = LENGTH_M / 2


def lane_end(u: FloatArray, config: Config) -> World:
    """Create scenes with the ego in a lane that ends, and three vehicles in the through lanes."""
    scenes, ego, speed = len(u), 30.0 * u[:, 0], 40.0 * u[:, 2:5]
    to_end_m = needed_gap(ego, np.zeros(scenes), config) + 60.0 * u[:, 1] ** 3
    lane, x_m = np.broadcast_to([1.0, 1.0, 2.0], (scenes, 3)), 160.0 * u[:, 5:8] - 80.0
    at_m, zero = RAMP.end_m - HALF_M - to_end_m, np.zeros(scenes, np.int64)
    return placed(zero, ego, x_m, lane, speed, at_m, MERGE_ROAD)


def merging(u: FloatArray, config: Config) -> World:
    """Create scenes with two vehicles in a lane that ends, up to 200 m ahead of the ego.

    The ego is beside them in a through lane, behind a third vehicle.
    """
    scenes, ego, speed = len(u), 30.0 * u[:, 0], 40.0 * u[:, 2:5]
    at_m, one = RAMP.end_m - HALF_M - 200.0 * u[:, 1], np.ones(len(u), np.int64)
    to_end_m = RAMP.end_m - HALF_M - at_m
    beside_m = np.minimum(160.0 * u[:, 5:7] - 80.0, to_end_m[:, None])
    x_m = np.column_stack([beside_m, ahead(u[:, 7], ego, speed[:, 2], config)])
    lane = np.broadcast_to([0.0, 0.0, 1.0], (scenes, 3))
    return placed(one, ego, x_m, lane, speed, at_m, MERGE_ROAD)


def leaving(u: FloatArray, config: Config) -> World:
    """Create scenes with the ego in a through lane, up to 400 m before an exit.

    One vehicle is in the deceleration lane, and one in each through lane, near the ego.
    """
    scenes, ego, speed = len(u), 30.0 * u[:, 0], 40.0 * u[:, 3:6]
    ego_lane = 1 + np.floor(2 * u[:, 1]).astype(np.int64)
    at_m = OFF_RAMP.joined_to_m - HALF_M - 400.0 * u[:, 2]
    lane, x_m = np.broadcast_to([0.0, 1.0, 2.0], (scenes, 3)), 160.0 * u[:, 6:9] - 80.0
    length_m = OFF_RAMP.joined_to_m - OFF_RAMP.begin_m
    x_m[:, 0] = OFF_RAMP.begin_m + HALF_M + length_m * u[:, 6] - at_m
    far_m = ahead(u[:, 9:12], ego[:, None], speed, config)
    x_m = with_safe_gaps(x_m, far_m, lane == ego_lane[:, None], ego, speed, config)
    return placed(ego_lane, ego, x_m, lane, speed, at_m, EXIT_ROAD)


OPEN_FAMILIES: dict[str, Family] = {
    "lane-end": Family(3, lane_end, (0.0, -1, 9), "merge"),
    "merging": Family(3, merging, (-BRAKES, 1, 1), "merge"),
    "exit": Family(3, leaving, (-BRAKES, -1, 5), "exit"),
}
