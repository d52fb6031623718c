"""One SUMO step of a world: the drivers plan their speeds, all move, and then change lanes.

Speeds are requested of the vehicles before the step, as ``SpeedRequests`` does in SUMO.
"""

import math

import numpy as np

from drl_av.compiled import borrowing, inlined
from drl_av.road.road import RoadNumbers
from drl_av.simulation.speed_requests import (
    LEFT_TO_SUMO,
    LOOK_AHEAD_M,
    limited_speed,
    stoppable_speed,
    wished_speed,
)
from drl_av.twin.asking import its_follow_speed
from drl_av.twin.following import (
    BRAKING_M_S2,
    MIN_GAP_M,
    MOST_BRAKING_M_S,
    STEP_S,
    brake_gap,
    free_speed,
)
from drl_av.twin.lane_change import change_lanes
from drl_av.twin.lane_speeds import expect_anew
from drl_av.twin.neighbors import LONGEST_M, edge_of, insert_sorted, link, next_edge
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ACCELERATION_NOW_M_S2,
    ADVICE_M_S,
    AHEAD,
    BLOCKED,
    BLOCKED_BY_LEADER,
    CHOSEN_M_S,
    COOPERATIVE,
    COUNT,
    DESIRED_M_S,
    EDGE,
    EDGE_BEGIN,
    EDGE_LENGTH,
    FIRST_LANE,
    FRONT_M,
    GAIN_LEFT,
    GAIN_RIGHT,
    GAP_M,
    HEADWAY_S,
    ITS_M_S,
    KEEPS_DISTANCE,
    LANE,
    LENGTH_M,
    MASK,
    NEXT_M_S,
    ORDER,
    REQUESTED_M_S,
    RESERVED,
    SHADOW,
    SPEED_M_S,
    STATE,
    STEP,
    STRATEGIC,
    WANTS,
    WISH_M_S2,
    Net,
    World,
    activate,
    keep_active,
    strip_of,
)

LENGTHS_SEEN = 5.0
"""A driver of SUMO looks at more edges than the next until they have this many of its lengths."""


@borrowing
def sumo_step(
    world: World, net: Net, road: RoadNumbers, ego_speed_m_s: float, ego_y_m: float
) -> None:
    """Advance a world by one SUMO step, in which the ego reaches a speed and lateral position."""
    if world.near[KEEPS_DISTANCE]:
        request_speeds(world, net)
    for k in range(world.near[COUNT]):
        see_ahead(world, net, k)
    for i in range(world.near[COUNT]):  # apart from the searches, so that they overlap in time
        world.x[NEXT_M_S, i] = ego_speed_m_s if i == 0 else next_speed(world, net, i)
    move(world, net)
    if insert_sorted(world):
        link(world, net)
    change_lanes(world, net, road, ego_y_m)
    world.near[STEP] += 1


@inlined
def see_ahead(world: World, net: Net, k: int) -> None:
    """Find the vehicles ahead that the ``k``-th one regards, and the speed that they allow.

    The gap to the first of them, inf without any, and its speed go to ``x``, and the largest speed
    behind the others, or on a free road, to its row ``NEXT_M_S``.
    """
    i, x = world.z[ORDER, k], world.x
    speed, headway_s, acceleration = x[SPEED_M_S, i], x[HEADWAY_S, i], x[ACCELERATION_M_S2, i]
    top = min(speed + acceleration * STEP_S, x[DESIRED_M_S, i])
    edge = world.z[EDGE, i]
    rest_m = net.edges_m[EDGE_LENGTH, edge] - (x[FRONT_M, i] - net.edges_m[EDGE_BEGIN, edge])
    far_m = top * STEP_S + brake_gap(top, BRAKING_M_S2, headway_s)
    edge, seen_m, beyond_m = next_edge(edge, net), rest_m, 0.0
    while edge >= 0 and (seen_m <= far_m or beyond_m <= LENGTHS_SEEN * x[LENGTH_M, i]):
        seen_m += net.edges_m[EDGE_LENGTH, edge]
        beyond_m += net.edges_m[EDGE_LENGTH, edge]
        edge = next_edge(edge, net)
    x[GAP_M, i], x[NEXT_M_S, i] = math.inf, math.inf
    see_in_lane(world, net, k, world.z[LANE, i], rest_m, seen_m, True)
    if world.z[SHADOW, i] >= 0:
        see_in_lane(world, net, k, world.z[SHADOW, i], rest_m, seen_m, False)
    if x[GAP_M, i] == math.inf:
        fastest = min(x[DESIRED_M_S, i], net.limit_m_s)
        x[NEXT_M_S, i] = free_speed(speed, rest_m, fastest, headway_s, acceleration)


@inlined
def next_speed(world: World, net: Net, i: int) -> float:
    """Return the speed of the vehicle ``i`` after the step, by IDM, advice and request."""
    x = world.x
    speed, desired = x[SPEED_M_S, i], x[DESIRED_M_S, i]
    least = max(speed - MOST_BRAKING_M_S, 0.0)
    behind = its_follow_speed(world, i, x[GAP_M, i], x[ITS_M_S, i])
    behind = min(x[NEXT_M_S, i], behind if x[GAP_M, i] < math.inf else math.inf)
    top = min(speed + x[ACCELERATION_M_S2, i] * STEP_S, desired)
    planned = max(least, min(behind, top, desired, net.limit_m_s))
    request = x[REQUESTED_M_S, i]
    is_left = request == LEFT_TO_SUMO
    if not is_left:
        planned = max(least, min(request, planned))
    chosen, state = planned, world.z[STATE, i]
    if x[ADVICE_M_S, i] <= planned:
        chosen = x[ADVICE_M_S, i]
    elif state & WANTS and state & BLOCKED and state & COOPERATIVE and state & BLOCKED_BY_LEADER:
        chosen = (least + planned) / 2
    x[CHOSEN_M_S, i] = chosen  # for the lane changes around, also where the speed is requested
    return x[CHOSEN_M_S, i] if is_left else planned


@inlined
def see_in_lane(
    world: World, net: Net, k: int, lane: int, rest_m: float, seen_m: float, sees_reserved: bool
) -> None:
    """Regard the vehicles ahead of the ``k``-th one in ``lane``, for ``see_ahead``.

    ``rest_m`` is left of its edge, and it sees ``seen_m`` ahead. On each edge only the last vehicle
    counts. A vehicle that is about to enter the lane counts on the own edge only.
    """
    i = world.z[ORDER, k]
    at_m, served_m, slowest = world.x[FRONT_M, i], 0.0, math.inf
    nearest_m, first_served_m = math.inf, math.inf
    edge = world.z[EDGE, i]
    m, place, wrapped_m = world.z[AHEAD + lane, k], k, 0.0
    while m >= 0:
        if m >= place:
            wrapped_m += net.lap_m
        j = world.z[ORDER, m]
        place, m = m, world.z[AHEAD + lane, m]
        ahead_m = world.x[FRONT_M, j] - at_m + wrapped_m
        rear_m = ahead_m - world.x[LENGTH_M, j]
        if ahead_m >= net.lap_m or rear_m >= seen_m + LONGEST_M:
            break
        if rear_m >= seen_m:
            continue
        if not world.z[MASK, j] & (1 << lane) and not (
            sees_reserved and world.z[RESERVED, j] == lane and rear_m < rest_m and served_m == 0.0
        ):
            continue
        if rear_m >= first_served_m and (ahead_m <= served_m or served_m >= seen_m):
            continue
        its = world.x[SPEED_M_S, j]
        if its < slowest or rear_m < nearest_m:
            slowest, gap_m = min(its, slowest), rear_m - MIN_GAP_M
            nearest_m = min(nearest_m, rear_m)
            if world.x[GAP_M, i] == math.inf:
                world.x[GAP_M, i], world.x[ITS_M_S, i] = gap_m, its
            else:
                behind = its_follow_speed(world, i, gap_m, its)
                world.x[NEXT_M_S, i] = min(world.x[NEXT_M_S, i], behind)
        begin_m = ahead_m - (world.x[FRONT_M, j] - net.edges_m[EDGE_BEGIN, world.z[EDGE, j]])
        if rear_m < begin_m:  # it counts on the edge before, too
            begin_m -= net.edges_m[EDGE_LENGTH, world.z[EDGE, j] - 1]
        first_served_m = min(first_served_m, begin_m)
        if served_m == 0.0:
            served_m = rest_m
        if not world.z[MASK, j] & (1 << lane):
            continue
        while served_m < ahead_m:
            edge = next_edge(edge, net)
            served_m = served_m + net.edges_m[EDGE_LENGTH, edge] if edge >= 0 else math.inf
        if served_m >= seen_m and ahead_m >= first_served_m + LONGEST_M:
            break


@inlined
def move(world: World, net: Net) -> None:
    """Move all vehicles along the road, and forget what was agreed for this step only."""
    stayed, present = 0, 0
    for i in range(world.near[COUNT]):
        speed, strip = world.x[NEXT_M_S, i], strip_of(world, net, i)
        world.x[ACCELERATION_NOW_M_S2, i] = (speed - world.x[SPEED_M_S, i]) / STEP_S
        world.x[SPEED_M_S, i] = speed
        at_m = world.x[FRONT_M, i] + speed * STEP_S
        before = world.z[EDGE, i]
        edge = before
        if at_m >= net.lap_m:
            at_m, edge = at_m - net.lap_m, 0
        world.x[FRONT_M, i] = at_m
        edge = edge_of(at_m, net, edge)
        if edge != before:
            world.z[EDGE, i] = edge
            if net.edge_lanes[FIRST_LANE, edge] != net.edge_lanes[FIRST_LANE, before]:
                expect_anew(world, net, i)
        now = strip_of(world, net, i)
        present |= 1 << now
        if now == strip:
            stayed |= 1 << now
        state = world.z[STATE, i]
        world.z[STATE, i] = state & WANTS if state & (STRATEGIC | COOPERATIVE) else 0
        world.x[ADVICE_M_S, i] = math.inf
        world.x[GAIN_LEFT, i] = np.ceil(world.x[GAIN_LEFT, i] * 100000.0) * 0.00001
        world.x[GAIN_RIGHT, i] = np.ceil(world.x[GAIN_RIGHT, i] * 100000.0) * 0.00001
    keep_active(world, stayed)
    activate(world, present)


@borrowing
def request_speeds(world: World, net: Net) -> None:
    """Request the wanted speed of each vehicle that a driver of ours drives, and limit all."""
    x = world.x
    for k in range(world.near[COUNT]):
        i = world.z[ORDER, k]
        if i == 0:
            continue
        j, gap_m = leader(world, net, k)
        speed, wanted, acceleration = x[SPEED_M_S, i], x[WISH_M_S2, i], x[ACCELERATION_M_S2, i]
        most = math.inf
        if j >= 0:
            most = stoppable_speed(gap_m, x[SPEED_M_S, j], BRAKING_M_S2, STEP_S)
        if math.isnan(wanted):
            x[REQUESTED_M_S, i] = limited_speed(most, speed, acceleration, STEP_S)
        else:
            now, chosen = x[ACCELERATION_NOW_M_S2, i], x[CHOSEN_M_S, i]
            x[REQUESTED_M_S, i] = wished_speed(
                most, speed, wanted, chosen, now, BRAKING_M_S2, STEP_S
            )


@inlined
def leader(world: World, net: Net, k: int) -> tuple[int, float]:
    """Return the vehicle ahead of the ``k``-th one and the net gap to it, as SUMO's getLeader.

    On each edge it is the last vehicle whose front is in the lane there, or else the last one that
    only overlaps the lane there, on the own edge if it is ahead. Without any it is -1.
    """
    x, z = world.x, world.z
    i = z[ORDER, k]
    lane, at_m, edge = z[LANE, i], x[FRONT_M, i], z[EDGE, i]
    found, found_gap_m, found_edge = -1, -1.0, 0
    hides, m, wrapped_m = False, k, 0.0
    while True:
        place, m = m, z[AHEAD + lane, m]
        if m == k:
            break
        if m > place:
            wrapped_m = net.lap_m
        j = z[ORDER, m]
        if not z[MASK, j] & (1 << lane):
            continue
        edges = z[EDGE, j] - edge
        if wrapped_m > 0.0:
            edges += net.edges
        if found >= 0 and edges > found_edge:
            break
        is_within = z[LANE, j] == lane
        gap_m = x[FRONT_M, j] - at_m + wrapped_m - x[LENGTH_M, j] - MIN_GAP_M
        begin_m = net.edges_m[EDGE_BEGIN, z[EDGE, j]] - at_m + wrapped_m
        laps = edges > 0 and gap_m + MIN_GAP_M < begin_m
        if laps and not (edges == 1 and (hides or overlaps_behind(world, k))):
            edges -= 1
            begin_m -= net.edges_m[EDGE_LENGTH, z[EDGE, j] - 1]
            is_within = False
        if edges > 0 and begin_m > LOOK_AHEAD_M:
            break
        if edges == 0 and not is_within:
            hides = hides or gap_m <= 0.0
            if hides or overlaps_behind(world, k):
                continue
        if found < 0 or is_within or edges < found_edge:
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
