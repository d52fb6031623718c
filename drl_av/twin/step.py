"""One SUMO step of a world: the drivers plan their speeds, all move, and then change lanes."""

import math

import numpy as np

from drl_av.compiled import borrowing, inlined
from drl_av.simulation.speed_requests import LEFT_TO_SUMO
from drl_av.twin.active_lanes import (
    activate,
    keep_active,
    strip_of,
)
from drl_av.twin.asking import (
    its_follow_speed,
)
from drl_av.twin.flags import (
    BLOCKED,
    BLOCKED_BY_LEADER,
    COOPERATIVE,
    STRATEGIC,
    WANTS,
)
from drl_av.twin.following import (
    BRAKING_M_S2,
    MIN_GAP_M,
    MOST_BRAKING_M_S,
    STEP_S,
    brake_gap,
    free_speed,
)
from drl_av.twin.lane_change import (
    change_lanes,
)
from drl_av.twin.neighbors import (
    LONGEST_M,
    edge_of,
    insert_sorted,
    link,
)
from drl_av.twin.requests import request_speeds
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ACCELERATION_NOW_M_S2,
    ADVICE_M_S,
    AHEAD,
    CHOSEN_M_S,
    COUNT,
    DESIRED_M_S,
    EDGE,
    FRONT_M,
    GAIN_LEFT,
    GAIN_RIGHT,
    HEADWAY_S,
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
    THRESHOLD_LEFT,
    Loop,
    World,
)


@borrowing
def sumo_step(world: World, loop: Loop, ego_speed_m_s: float, ego_y_m: float) -> None:
    """Advance the world ``w`` by one SUMO step, in which the ego reaches this speed and place."""
    if world.near[KEEPS_DISTANCE]:
        request_speeds(world, loop)
    for k in range(world.near[COUNT]):
        i = world.z[ORDER, k]
        world.x[NEXT_M_S, i] = ego_speed_m_s if i == 0 else next_speed(world, loop, k)
    move(world, loop)
    insert_sorted(world)
    link(world, loop)
    change_lanes(world, loop, ego_y_m)
    world.near[STEP] += 1


@inlined
def next_speed(world: World, loop: Loop, k: int) -> float:
    """Return the speed of the ``k``-th vehicle after the step, by IDM, advice and request."""
    i = world.z[ORDER, k]
    at_m, speed, desired = world.x[FRONT_M, i], world.x[SPEED_M_S, i], world.x[DESIRED_M_S, i]
    least = max(speed - MOST_BRAKING_M_S, 0.0)
    fastest = min(desired, loop.limit_m_s)
    top = min(speed + world.x[ACCELERATION_M_S2, i] * STEP_S, desired)
    planned = min(top, max(fastest, least))
    rest_m = loop.edge_m - (at_m - world.z[EDGE, i] * loop.edge_m)
    far_m = top * STEP_S + brake_gap(top, BRAKING_M_S2, world.x[HEADWAY_S, i])
    seen_m = rest_m + loop.edge_m
    while seen_m <= far_m:
        seen_m += loop.edge_m
    behind = speed_behind(world, loop, k, world.z[LANE, i], rest_m, seen_m, True)
    if world.z[SHADOW, i] >= 0:
        other = speed_behind(world, loop, k, world.z[SHADOW, i], rest_m, seen_m, False)
        behind = min(behind, other)
    if behind == math.inf:  # else slower than on a free road in any case
        free = free_speed(
            speed, rest_m, fastest, world.x[HEADWAY_S, i], world.x[ACCELERATION_M_S2, i]
        )
        planned = min(planned, max(free, least))
    planned = max(least, min(planned, behind, top, fastest))
    request = world.x[REQUESTED_M_S, i]
    is_left = request == LEFT_TO_SUMO
    if not is_left:
        planned = max(least, min(request, planned))
    world.x[CHOSEN_M_S, i] = with_advice(world, i, planned, least)
    return world.x[CHOSEN_M_S, i] if is_left else planned


@inlined
def with_advice(world: World, i: int, planned: float, least: float) -> float:
    """Return the speed that a vehicle chooses for the lane changes around; ``least`` is possible.

    Where the speed is requested, the vehicle does not follow this choice.
    """
    advice = world.x[ADVICE_M_S, i]
    if advice <= planned:
        return advice
    state = world.z[STATE, i]
    if state & WANTS and state & BLOCKED and state & COOPERATIVE and state & BLOCKED_BY_LEADER:
        return (least + planned) / 2
    return planned


@inlined
def speed_behind(
    world: World,
    loop: Loop,
    k: int,
    lane: int,
    rest_m: float,
    seen_m: float,
    sees_reserved: bool,
) -> float:
    """Return the speed of the ``k``-th vehicle behind those that it sees ahead in ``lane``.

    ``rest_m`` is left of its edge, and it sees ``seen_m`` ahead. On each edge only the last vehicle
    counts. A vehicle that is about to enter the lane counts on the own edge only.
    """
    i = world.z[ORDER, k]
    at_m, result = world.x[FRONT_M, i], math.inf
    served_m, slowest = 0.0, math.inf
    m, place, wrapped_m = world.z[AHEAD + lane, k], k, 0.0
    while m >= 0:
        if m >= place:
            wrapped_m += loop.lap_m
        j = world.z[ORDER, m]
        place, m = m, world.z[AHEAD + lane, m]
        ahead_m = world.x[FRONT_M, j] - at_m + wrapped_m
        rear_m = ahead_m - world.x[LENGTH_M, j]
        if ahead_m >= loop.lap_m or rear_m >= seen_m + LONGEST_M:
            break
        if rear_m >= seen_m:
            continue
        if not world.z[MASK, j] & (1 << lane) and not (
            sees_reserved and world.z[RESERVED, j] == lane and rear_m < rest_m and served_m == 0.0
        ):
            continue
        if ahead_m <= served_m and served_m > 0.0:
            continue
        its = world.x[SPEED_M_S, j]
        if its < slowest:
            slowest = its
            result = min(result, its_follow_speed(world, i, rear_m - MIN_GAP_M, its))
        served_m = rest_m
        while served_m < ahead_m:
            served_m += loop.edge_m
        if served_m >= seen_m:
            break
    return result


@inlined
def move(world: World, loop: Loop) -> None:
    """Move all vehicles along the road, and forget what was agreed for this step only."""
    stayed, present = 0, 0
    for i in range(world.near[COUNT]):
        speed, strip = world.x[NEXT_M_S, i], strip_of(world, loop, i)
        world.x[ACCELERATION_NOW_M_S2, i] = (speed - world.x[SPEED_M_S, i]) / STEP_S
        world.x[SPEED_M_S, i] = speed
        at_m = world.x[FRONT_M, i] + speed * STEP_S
        at_m = at_m if at_m < loop.lap_m else at_m - loop.lap_m
        world.x[FRONT_M, i] = at_m
        world.z[EDGE, i] = edge_of(at_m, loop)
        now = strip_of(world, loop, i)
        present |= 1 << now
        if now == strip:
            stayed |= 1 << now
        state = world.z[STATE, i]
        world.z[STATE, i] = state & WANTS if state & (STRATEGIC | COOPERATIVE) else 0
        world.x[ADVICE_M_S, i] = math.inf
        if world.x[THRESHOLD_LEFT, i] != math.inf:
            world.x[GAIN_LEFT, i] = np.ceil(world.x[GAIN_LEFT, i] * 100000.0) * 0.00001
            world.x[GAIN_RIGHT, i] = np.ceil(world.x[GAIN_RIGHT, i] * 100000.0) * 0.00001
    keep_active(world, stayed)
    activate(world, present)
