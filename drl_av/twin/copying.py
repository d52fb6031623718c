"""Copies a running episode of SUMO into a world of the twin, as far as one can see it."""

import math
from collections.abc import Mapping

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.config import Config
from drl_av.road.snapshot import Snapshot
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.population import Population
from drl_av.twin.following import EPS, STEP_S
from drl_av.twin.lane_change import change_lane, shift
from drl_av.twin.lane_speeds import look_around, needs_thought
from drl_av.twin.neighbors import link, shadow_lane
from drl_av.twin.traffic import place_vehicles, sort_and_activate
from drl_av.twin.worlds import (
    ACCELERATION_NOW_M_S2,
    ADVICE_M_S,
    ASIDE_M,
    CHOSEN_M_S,
    COMMANDED_M,
    COUNT,
    EDGE,
    FIRST_LANE,
    FRONT_M,
    GAIN_LEFT,
    GAIN_RIGHT,
    LANE,
    LATERAL_SPEED_M_S,
    LENGTH_M,
    MANEUVER_M,
    MASK,
    ON_REQUEST_ONLY,
    ORDER,
    REQUEST_END,
    REQUEST_LANE,
    SHADOW,
    SPEED_M_S,
    STEP,
    WIDTH_M,
    Net,
    World,
)


def copy_scene(
    world: World,
    net: Net,
    population: Population,
    driver_models: IntArray,
    snapshot: Snapshot,
    requests: Mapping[int, tuple[int, int]],
    chosen: FloatArray,
    scenario: Scenario,
    config: Config,
) -> None:
    """Copy the vehicles of a snapshot into a world, with their parameters in ``population``.

    ``requests`` holds by row the lane changes that were requested: the lane, and for how many SUMO
    steps more, below 0 if no longer. ``chosen``, shape (2, vehicles), holds the speeds that SUMO's
    models chose in the last step, which requests override, and the accelerations. What SUMO's
    drivers remember cannot be seen. Each is taken to have had the present traffic around it for
    long, and one that rests beside the centre of its lane to have reason to stay there.
    """
    place_vehicles(world, net, population, driver_models, scenario, config)
    x, z, n = world.x, world.z, len(snapshot.ids)
    x[FRONT_M, :n] = (snapshot.s_m + x[LENGTH_M, :n] / 2) % net.lap_m
    x[SPEED_M_S, :n] = snapshot.speed_m_s
    x[CHOSEN_M_S, :n], x[ACCELERATION_NOW_M_S2, :n] = chosen
    x[LATERAL_SPEED_M_S, :n] = snapshot.lateral_speed_m_s
    lanes = np.floor(snapshot.y_m / net.lane_m + 0.5).astype(np.int64)
    z[LANE, :n], x[ASIDE_M, :n] = lanes, snapshot.y_m - lanes * net.lane_m
    x[ASIDE_M, :n][np.abs(x[ASIDE_M, :n]) < 1e-9] = 0.0
    for row in range(n):
        lane, aside_m, width_m = int(lanes[row]), float(x[ASIDE_M, row]), float(x[WIDTH_M, row])
        other = shadow_lane(aside_m, width_m, lane, net)
        z[SHADOW, row] = other
        z[MASK, row] = 1 << lane | (1 << other if other >= 0 else 0)
        if row in requests:
            target, steps = requests[row]
            z[REQUEST_LANE, row] = target - net.edge_lanes[FIRST_LANE, z[EDGE, row]]
            z[REQUEST_END, row] = steps
            is_bound = steps >= 0 or z[ON_REQUEST_ONLY, row]
            if snapshot.lateral_speed_m_s[row] and is_bound:
                least_m = 0.5 * net.lane_m - 0.5 * (width_m + EPS)  # until wholly in the target
                away_m = (target - lane) * net.lane_m - aside_m
                rest_m = math.copysign(max(abs(away_m) - least_m, 0.0), away_m)
                x[MANEUVER_M, row], x[COMMANDED_M, row] = rest_m, rest_m
    rests = (x[ASIDE_M] != 0.0) & (x[LATERAL_SPEED_M_S] == 0.0)
    x[GAIN_LEFT], x[GAIN_RIGHT] = (
        -1.0 * (rests & (x[ASIDE_M] < 0)),
        -1.0 * (rests & (x[ASIDE_M] > 0)),
    )
    sort_and_activate(world, net)
    advise_all(world, net)


def advise_all(world: World, net: Net) -> None:
    """Let the drivers look around and ask for room as at the end of the last step, without moving.

    Each does so from where it was before its last move sideways.
    """
    x, z = world.x, world.z
    world.near[STEP] -= 1
    for k in range(int(world.near[COUNT])):
        row = z[ORDER, k]
        if row == 0:
            continue
        look_around(world, net, k, 0.0)
        if needs_thought(world, net, k):
            reals, wholes = x[:, row].copy(), z[:, row].copy()
            shift(world, net, row, -x[LATERAL_SPEED_M_S, row] * STEP_S)
            change_lane(world, net, k)
            kept = x[ADVICE_M_S, row]
            x[:, row], z[:, row] = reals, wholes
            x[ADVICE_M_S, row] = kept
            link(world, net)
    world.near[STEP] += 1
