"""Copies a running episode of SUMO into a world of the twin, as far as one can see it."""

import math
from collections.abc import Mapping

import numpy as np

from drl_av.config import Config
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.population import Population
from drl_av.twin.following import EPS
from drl_av.twin.lane_change import change_lane
from drl_av.twin.lane_speeds import needs_thought
from drl_av.twin.neighbors import link, shadow_lane
from drl_av.twin.traffic import place_vehicles, sort_and_activate
from drl_av.twin.worlds import (
    ADVICE_M_S,
    ASIDE_M,
    COMMANDED_M,
    COUNT,
    FRONT_M,
    LANE,
    LATERAL_SPEED_M_S,
    LENGTH_M,
    MANEUVER_M,
    MASK,
    ORDER,
    REQUEST_END,
    REQUEST_LANE,
    SHADOW,
    SPEED_M_S,
    TRACKED,
    TRACKED_LEFT,
    WIDTH_M,
    Loop,
    World,
)

LONG_STEPS = 40
"""Steps for which the drivers are taken to have had the present traffic around them (ours)."""


def copy_scene(
    world: World,
    loop: Loop,
    population: Population,
    snapshot: Snapshot,
    requests: Mapping[int, tuple[int, int]],
    scenario: Scenario,
    config: Config,
) -> None:
    """Copy the vehicles of a snapshot into a world, with their parameters in ``population``.

    ``requests`` holds by row the lane changes that were requested and still stand: the lane, and
    for how many SUMO steps more. What SUMO's drivers remember cannot be seen. Each is taken to have
    had the present traffic around it for long.
    """
    place_vehicles(world, loop, population, scenario, config)
    x, z, n = world.x, world.z, len(snapshot.ids)
    x[FRONT_M, :n] = (snapshot.s_m + x[LENGTH_M, :n] / 2) % loop.lap_m
    x[SPEED_M_S, :n] = snapshot.speed_m_s
    x[LATERAL_SPEED_M_S, :n] = snapshot.lateral_speed_m_s
    lanes = np.floor(snapshot.y_m / loop.lane_m + 0.5).astype(np.int64)
    z[LANE, :n], x[ASIDE_M, :n] = lanes, snapshot.y_m - lanes * loop.lane_m
    x[ASIDE_M, :n][np.abs(x[ASIDE_M, :n]) < 1e-9] = 0.0
    z[TRACKED], z[TRACKED_LEFT] = -LONG_STEPS, -LONG_STEPS
    for row in range(n):
        lane, aside_m, width_m = int(lanes[row]), float(x[ASIDE_M, row]), float(x[WIDTH_M, row])
        other = shadow_lane(aside_m, width_m, lane, loop)
        z[SHADOW, row] = other
        z[MASK, row] = 1 << lane | (1 << other if other >= 0 else 0)
        if row in requests:
            z[REQUEST_LANE, row], steps = requests[row]
            z[REQUEST_END, row] = steps
            if snapshot.lateral_speed_m_s[row]:
                rest_m = rest_of_change(lane, aside_m, width_m, int(z[REQUEST_LANE, row]), loop)
                x[MANEUVER_M, row], x[COMMANDED_M, row] = rest_m, rest_m
    sort_and_activate(world, loop)
    advise_all(world, loop)


def rest_of_change(lane: int, aside_m: float, width_m: float, target: int, loop: Loop) -> float:
    """Return the lateral distance left until a body is wholly in its target lane, left positive."""
    least_m = 0.5 * loop.lane_m - 0.5 * (width_m + EPS)  # from the centre of the target lane
    away_m = (target - lane) * loop.lane_m - aside_m
    return math.copysign(max(abs(away_m) - least_m, 0.0), away_m)


def advise_all(world: World, loop: Loop) -> None:
    """Let the drivers look around and ask for room as at the end of a step, without moving."""
    x, z = world.x, world.z
    for k in range(int(world.near[COUNT])):
        row = z[ORDER, k]
        if row != 0 and needs_thought(world, loop, k):
            reals, wholes = x[:, row].copy(), z[:, row].copy()
            change_lane(world, loop, k)
            kept = x[ADVICE_M_S, row]
            x[:, row], z[:, row] = reals, wholes
            x[ADVICE_M_S, row] = kept
            link(world, loop)
