"""Families of scenes for the falsifier: they create starts of the ego and of other vehicles."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray, IntArray
from drl_av.config import Config
from drl_av.road.road import Road
from drl_av.safety.reachability import reach, stopping_distance
from verification.adversary import LENGTH_M, NONE, ROAD, World

PLACED = 6
"""Number of genes that define the start of each other vehicle."""
BRAKES = 99.0
"""A braking command, m/s^2, which the simulator limits to the hardest permitted braking."""


class Family(NamedTuple):
    """A family of scenes: the function that creates its starts, and a scripted adversary."""

    others: int
    """Number of other vehicles."""
    start: Callable[[FloatArray, Config], World]
    """Function that creates the starts from numbers in (0, 1), shape (scenes, PLACED * others)."""
    script: tuple[float, float, int]
    """The scripted adversary: acceleration of the other vehicles, m/s^2; the side to which they
    move, right -1, none 0, left 1; and the proposed action of the ego, 0 to 11."""
    road_kind: str = "loop"
    """The kind of the road in SUMO, a key of ``in_sumo.ROADS``."""


def needed_gap(speed: FloatArray, other: FloatArray, config: Config) -> FloatArray:
    """Return the smallest gap to a vehicle ahead, m, that is safe by the criterion of the check.

    ``speed`` is the speed of the ego, ``other`` that of the vehicle ahead, m/s. The criterion of
    ``strict`` is a free fallback maneuver, that of ``paper`` and ``permit_all`` the paper's gap
    condition (eq. 3). For a check of the user both must hold, so that no start is lost already.
    """
    strict, sim, check = config.strict, config.simulation, config.safety.check
    closing = np.maximum(speed - other, 0.0)
    paper_m: FloatArray = config.safety.minimum_gap_m + config.safety.minimum_ttc_s * closing + 1e-3
    if check in ("paper", "permit_all"):
        return paper_m
    rolled_m = reach(speed, -config.ego.hard_brake_m_s2, config.ego, sim)
    rest_m = stopping_distance(other, strict.braking_m_s2, sim.step_length_s)
    strict_m: FloatArray = np.maximum(rolled_m - rest_m, 0.0) + strict.clearance_m + 1e-3
    return strict_m if check == "strict" else np.maximum(paper_m, strict_m)


def placed(
    ego_lane: IntArray,
    ego_speed: FloatArray,
    x_m: FloatArray,
    lane: Any,
    speed: FloatArray,
    at_m: FloatArray | float = 5000.0,
    road: Road = ROAD,
) -> World:
    """Return a World of vehicles in the centres of their lanes.

    ``x_m``, ``lane`` and ``speed`` describe the other vehicles and have shape (scenes, others).
    ``x_m`` is the distance of their centres ahead of the ego's centre; ``at_m`` is the ego's
    position along the road.
    """
    scenes = len(ego_speed)
    return World(
        np.reshape(at_m, (-1, 1)) + np.column_stack([np.zeros(scenes), x_m]),
        np.column_stack([ego_lane, lane]) * ROAD.lane_width_m,
        np.column_stack([ego_speed, speed]),
        np.zeros((scenes, 1 + x_m.shape[1])),
        np.full(scenes, NONE),
        np.full(scenes, NONE),
        np.full((scenes, len(ROAD.open_lanes)), np.inf),
        road=road,
    )


def ahead(u: FloatArray, ego: FloatArray, speed: FloatArray, config: Config) -> FloatArray:
    """Return the distance of a vehicle ahead of the ego, m, from the numbers ``u`` in (0, 1).

    The gap exceeds the smallest safe gap by up to 60 m.
    """
    return LENGTH_M + needed_gap(ego, speed, config) + 60.0 * u**3


def lead_brakes(u: FloatArray, config: Config) -> World:
    """Create scenes with one vehicle ahead in the ego's lane."""
    ego, speed = 30.0 * u[:, 0], 40.0 * u[:, 1]
    x_m = ahead(u[:, 2], ego, speed, config)
    one = np.ones(len(u), dtype=np.int64)
    return placed(one, ego, x_m[:, None], one[:, None], speed[:, None])


def cut_in(u: FloatArray, config: Config) -> World:
    """Create scenes with one vehicle in the left lane, from beside the ego to 130 m ahead."""
    ego, speed = 30.0 * u[:, 0], 40.0 * u[:, 1]
    one = np.ones(len(u), dtype=np.int64)
    return placed(one, ego, 130.0 * u[:, 2:3], 2.0 * one[:, None], speed[:, None])


def both_sides(u: FloatArray, config: Config) -> World:
    """Create scenes with the ego in the right lane, and a vehicle near it in the left lane.

    Both can change to the middle lane. A third vehicle is ahead in the ego's lane.
    """
    ego, speed = 30.0 * u[:, 0], np.column_stack([40.0 * u[:, 1], 40.0 * u[:, 2]])
    zero = np.zeros(len(u), dtype=np.int64)
    x_m = np.column_stack([100.0 * u[:, 3] - 50.0, ahead(u[:, 4], ego, speed[:, 1], config)])
    return placed(zero, ego, x_m, np.column_stack([zero + 2.0, zero]), speed)


def standing(u: FloatArray, config: Config) -> World:
    """Create scenes with a standing vehicle ahead in the ego's lane, and one in the next lane."""
    ego, zero = 30.0 * u[:, 0], np.zeros(len(u), dtype=np.int64)
    speed = np.zeros((len(u), 2))
    x_m = np.column_stack([ahead(u[:, 1], ego, speed[:, 0], config), 200.0 * u[:, 2] - 20.0])
    return placed(zero, ego, x_m, np.column_stack([zero, zero + 1.0]), speed)


def overtaker(u: FloatArray, config: Config) -> World:
    """Create scenes with a fast vehicle behind in the next lane, and a vehicle ahead of the ego."""
    ego, zero = 30.0 * u[:, 0], np.zeros(len(u), dtype=np.int64)
    speed = np.column_stack([20.0 + 20.0 * u[:, 1], 40.0 * u[:, 2]])
    x_m = np.column_stack([-150.0 * u[:, 3], ahead(u[:, 4], ego, speed[:, 1], config)])
    return placed(zero, ego, x_m, np.column_stack([zero + 1.0, zero]), speed)


def anything(u: FloatArray, config: Config) -> World:
    """Create scenes with four vehicles anywhere; in the ego's lane their gaps to it are safe."""
    ego_lane = np.floor(3 * u[:, 20]).astype(np.int64)
    lane, speed = np.floor(3 * u[:, 4:8]), 40.0 * u[:, 8:12]
    ego = 30.0 * u[:, 21]
    x_m, far_m = 240.0 * u[:, :4] - 120.0, ahead(u[:, 12:16], ego[:, None], speed, config)
    x_m = with_safe_gaps(x_m, far_m, lane == ego_lane[:, None], ego, speed, config)
    return placed(ego_lane, ego, x_m, lane, speed)


def with_safe_gaps(
    x_m: FloatArray,
    far_m: FloatArray,
    own: BoolArray,
    ego: FloatArray,
    speed: FloatArray,
    config: Config,
) -> FloatArray:
    """Return ``x_m``, shape (scenes, others), with safe gaps in the ego's lane, m.

    ``own`` marks the vehicles in the ego's lane. A vehicle ahead is placed at ``far_m``. A vehicle
    behind is placed so far back that it can stop behind the ego. ``ego``, shape (scenes,), and
    ``speed``, shape (scenes, others), are speeds, m/s.
    """
    step_s = config.simulation.step_length_s
    stops_m = [
        stopping_distance(v, config.strict.follower_braking_m_s2, step_s) for v in (speed, ego)
    ]
    near_m = LENGTH_M + 2.0 + speed * step_s + np.maximum(stops_m[0] - stops_m[1][:, None], 0.0)
    return np.where(own, np.where(x_m > 0, far_m, np.minimum(x_m, -near_m)), x_m)


FAMILIES: dict[str, Family] = {
    "lead-brakes": Family(1, lead_brakes, (-BRAKES, 0, 1)),
    "cut-in": Family(1, cut_in, (-BRAKES, -1, 1)),
    "both-sides": Family(2, both_sides, (0.0, -1, 9)),
    "standing": Family(2, standing, (0.0, 0, 9)),
    "overtaker": Family(2, overtaker, (2.0, 0, 9)),
    "anything": Family(4, anything, (-BRAKES, 1, 9)),
}
CONSTANT_SPEED = Family(1, lead_brakes, (0.0, 0, 0))
"""The simplest family: the vehicle ahead keeps its speed, and the ego's action is to maintain."""
