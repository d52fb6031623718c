"""The speeds requested of the vehicles before each step, as ``SpeedRequests`` does in SUMO."""

import math

from drl_av.compiled import borrowing, inlined
from drl_av.simulation.speed_requests import (
    LOOK_AHEAD_M,
    limited_speed,
    most_speed,
    wished_speed,
)
from drl_av.twin.following import BRAKING_M_S2, MIN_GAP_M, STEP_S
from drl_av.twin.neighbors import EDGES
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ACCELERATION_NOW_M_S2,
    AHEAD,
    CHOSEN_M_S,
    COUNT,
    EDGE,
    FRONT_M,
    LANE,
    LENGTH_M,
    MASK,
    ORDER,
    REQUESTED_M_S,
    SPEED_M_S,
    WISH_M_S2,
    Loop,
    World,
)


@borrowing
def request_speeds(world: World, loop: Loop) -> None:
    """Request the wanted speed of each vehicle that a driver of ours drives, and limit all."""
    x = world.x
    for k in range(world.near[COUNT]):
        i = world.z[ORDER, k]
        if i == 0:
            continue
        j, gap_m = leader(world, loop, k)
        its = math.nan if j < 0 else x[SPEED_M_S, j]
        speed, wanted, acceleration = x[SPEED_M_S, i], x[WISH_M_S2, i], x[ACCELERATION_M_S2, i]
        is_ours = not math.isnan(wanted)
        fastest = speed + (max(wanted, 0.0) if is_ours else acceleration) * STEP_S
        most = most_speed(gap_m, its, fastest, BRAKING_M_S2, STEP_S)
        if not is_ours:
            x[REQUESTED_M_S, i] = limited_speed(most, speed, acceleration, STEP_S)
        else:
            now, chosen = x[ACCELERATION_NOW_M_S2, i], x[CHOSEN_M_S, i]
            x[REQUESTED_M_S, i] = wished_speed(
                most, speed, wanted, chosen, now, BRAKING_M_S2, STEP_S
            )


@inlined
def leader(world: World, loop: Loop, k: int) -> tuple[int, float]:
    """Return the vehicle ahead of the ``k``-th one and the net gap to it, as SUMO's getLeader.

    On each edge it is the last vehicle whose front is in the lane there, or else the last one that
    only overlaps the lane there, on the own edge if it is ahead. Without any it is -1.
    """
    x, z = world.x, world.z
    i = z[ORDER, k]
    lane, at_m, edge = z[LANE, i], x[FRONT_M, i], z[EDGE, i]
    rest_m = (edge + 1) * loop.edge_m - at_m
    found, found_gap_m, found_edge = -1, -1.0, 0
    hides, m, wrapped_m = False, k, 0.0
    while True:
        place, m = m, z[AHEAD + lane, m]
        if m == k:
            break
        if m > place:
            wrapped_m = loop.lap_m
        j = z[ORDER, m]
        if not z[MASK, j] & (1 << lane):
            continue
        edges = z[EDGE, j] - edge
        if wrapped_m > 0.0:
            edges += EDGES
        if found >= 0 and edges > found_edge:
            break
        is_within = z[LANE, j] == lane
        gap_m = x[FRONT_M, j] - at_m + wrapped_m - x[LENGTH_M, j] - MIN_GAP_M
        laps = edges > 0 and gap_m + MIN_GAP_M < rest_m + (edges - 1) * loop.edge_m
        if laps and not (edges == 1 and (hides or overlaps_behind(world, k))):
            edges -= 1
            is_within = False
        if edges > 0 and rest_m + (edges - 1) * loop.edge_m > LOOK_AHEAD_M:
            break
        if edges == 0 and not is_within:
            hides = hides or gap_m <= 0.0
            if hides or overlaps_behind(world, k):
                continue
        if found < 0 or is_within:
            found, found_gap_m, found_edge = j, gap_m, edges
        if is_within:
            break
    return found, found_gap_m


@borrowing
def overlaps_behind(world: World, k: int) -> bool:
    """Return whether a vehicle behind the ``k``-th one only overlaps its lane on the same edge."""
    z = world.z
    i = z[ORDER, k]
    for m in range(k + 1, world.near[COUNT]):
        j = z[ORDER, m]
        if z[EDGE, j] != z[EDGE, i]:
            break
        if z[LANE, j] != z[LANE, i] and z[MASK, j] & (1 << z[LANE, i]):
            return True
    return False
