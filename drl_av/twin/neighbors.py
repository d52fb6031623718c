"""Searches for the vehicles next to one in its lanes, as far as SUMO's drivers see them."""

import math

from drl_av.compiled import borrowing, inlined
from drl_av.twin.following import BRAKING_M_S2, MIN_GAP_M, brake_gap, ego_gap, secure_gap
from drl_av.twin.worlds import (
    ACCELERATION_NOW_M_S2,
    AHEAD,
    COUNT,
    EDGE,
    EDGE_BEGIN,
    EDGE_LENGTH,
    FRONT_M,
    HEADWAY_S,
    LANES,
    LENGTH_M,
    MASK,
    ORDER,
    RESERVED,
    SPEED_M_S,
    Net,
    World,
)

SEEN_BEHIND_M = 200.0
"""Distance in which SUMO looks for followers: stopping from the speed limit of 40 m/s."""
LONGEST_M = 25.0
"""Length of the longest vehicle."""


@inlined
def insert_sorted(world: World) -> bool:
    """Sort the vehicles by front position, the foremost first; return whether the order changes."""
    changed = False
    for k in range(1, world.near[COUNT]):
        i = world.z[ORDER, k]
        at_m = world.x[FRONT_M, i]
        m = k - 1
        while m >= 0 and world.x[FRONT_M, world.z[ORDER, m]] < at_m:
            world.z[ORDER, m + 1] = world.z[ORDER, m]
            m -= 1
            changed = True
        world.z[ORDER, m + 1] = i
    return changed


@inlined
def link(world: World, net: Net) -> None:
    """Note the next vehicles ahead of and behind each one in each lane, as places in ``ORDER``.

    A vehicle counts in the lanes that it overlaps and in the one that it has reserved.
    """
    z, n = world.z, world.near[COUNT]
    for k in range(n):
        i = z[ORDER, k]
        reserved = z[RESERVED, i]
        z[LANES, k] = z[MASK, i] | (1 << reserved if reserved >= 0 else 0)
    for lane in range(net.lanes):
        last = n - 1  # the rearmost one is ahead of the foremost
        while last >= 0 and not z[LANES, last] >> lane & 1:
            last -= 1
        first = last
        for k in range(n):
            z[AHEAD + lane, k] = last
            last = k if z[LANES, k] >> lane & 1 else last
        last = first
        if last >= 0:  # the foremost one is behind the rearmost
            last = 0
            while not z[LANES, last] >> lane & 1:
                last += 1
        for k in range(n - 1, -1, -1):
            z[AHEAD + net.lanes + lane, k] = last
            last = k if z[LANES, k] >> lane & 1 else last


@inlined
def leader(world: World, net: Net, k: int, lane: int, seen_m: float) -> tuple[int, float]:
    """Return the next vehicle ahead in a lane that is seen, and the distance to its rear, or -1."""
    x, z = world.x, world.z
    at_m, wrapped_m, m = x[FRONT_M, z[ORDER, k]], 0.0, k
    while True:
        place, m = m, z[AHEAD + lane, m]
        if m < 0:
            return -1, math.inf
        if m >= place:
            wrapped_m += net.lap_m
        j = z[ORDER, m]
        ahead_m = x[FRONT_M, j] - at_m + wrapped_m
        rear_m = ahead_m - x[LENGTH_M, j]
        if ahead_m >= net.lap_m or rear_m >= seen_m + LONGEST_M:
            return -1, math.inf
        if rear_m < seen_m and z[MASK, j] >> lane & 1:
            return j, rear_m


@inlined
def edge_of(at_m: float, net: Net, edge: int = 0) -> int:
    """Return the number of the SUMO edge at a position, which is not before the edge ``edge``."""
    while edge < net.edges - 1 and at_m >= net.edges_m[EDGE_BEGIN, edge + 1]:
        edge += 1
    return edge


@inlined
def next_edge(edge: int, net: Net) -> int:
    """Return the number of the edge that follows, -1 at the end of an open road."""
    if edge < net.edges - 1:
        return edge + 1
    return 0 if net.is_loop else -1


@inlined
def shadow_lane(aside_m: float, width_m: float, lane: int, net: Net) -> int:
    """Return the second lane that a body overlaps, or -1."""
    if abs(aside_m) + 0.5 * width_m - 0.5 * net.lane_m <= 0.001:
        return -1
    other = lane - 1 if aside_m < 0 else lane + 1
    return other if 0 <= other < net.lanes else -1


@inlined
def reach_m(net: Net, edge: int, pos_m: float, speed: float, headway_s: float) -> float:
    """Return how far a driver sees ahead for a lane change from a position on its edge."""
    distance_m = max(brake_gap(speed, BRAKING_M_S2, headway_s), 10.0) + MIN_GAP_M
    seen_m, other = net.edges_m[EDGE_LENGTH, edge] - pos_m, edge
    if seen_m > distance_m:
        return seen_m
    goes_on = True
    while goes_on:
        goes_on = seen_m < distance_m
        other = next_edge(other, net)
        if other < 0:
            break
        seen_m += net.edges_m[EDGE_LENGTH, other]
    return seen_m


@borrowing
def needed_gap(world: World, i: int, speed: float, ahead_speed: float) -> float:
    """Return the gap that SUMO requires of the vehicle ``i`` behind another for a lane change."""
    if i == 0:
        return ego_gap(speed, ahead_speed, world.x[ACCELERATION_NOW_M_S2, 0])
    return secure_gap(speed, ahead_speed, world.x[HEADWAY_S, i])


@inlined
def follower(world: World, net: Net, k: int, lane: int) -> tuple[int, float]:
    """Return the critical vehicle behind the ``k``-th one in ``lane`` and its net gap, or -1."""
    i = world.z[ORDER, k]
    at_m, speed = world.x[FRONT_M, i], world.x[SPEED_M_S, i]
    own = world.z[EDGE, i]
    pos_m = at_m - net.edges_m[EDGE_BEGIN, own]
    length_m = world.x[LENGTH_M, i]
    back_m = pos_m - length_m
    found, found_gap_m, found_missing_m = -1, math.inf, -math.inf
    edge, done_edge, wrapped_m = 0, -1, 0.0
    m = k
    while True:
        place, m = m, world.z[AHEAD + net.lanes + lane, m]
        if m <= place:
            if m < 0 or wrapped_m > 0.0 or not net.is_loop:
                break
            wrapped_m = net.lap_m
        if m >= k and wrapped_m > 0.0:
            break
        j = world.z[ORDER, m]
        if not world.z[MASK, j] & (1 << lane):
            continue
        behind_m = at_m - world.x[FRONT_M, j] + wrapped_m
        its = world.z[EDGE, j]
        edge = own - its + (net.edges if wrapped_m > 0.0 else 0)
        if edge > 0:
            if found >= 0 and done_edge <= 0:
                break
            if edge == done_edge:
                continue
            end_m = net.edges_m[EDGE_BEGIN, its] + net.edges_m[EDGE_LENGTH, its]
            if (
                edge > 1
                and net.edges_m[EDGE_BEGIN, own] + wrapped_m - end_m >= SEEN_BEHIND_M - back_m
            ):
                break
        done_edge = edge
        gap_m = behind_m - length_m - MIN_GAP_M
        missing_m = needed_gap(world, j, world.x[SPEED_M_S, j], speed) - gap_m
        is_worse = (
            missing_m > found_missing_m
            or (missing_m > 0 and gap_m < found_gap_m)
            or (gap_m < 0 and found_gap_m > 0)
        )
        if (
            is_worse
            and not (gap_m > 0 and found_gap_m < 0)
            and not (found_missing_m > 0 and found_gap_m < gap_m)
        ):
            found, found_gap_m, found_missing_m = j, gap_m, missing_m
    return found, found_gap_m
