"""One SUMO step of a world: the drivers plan their speeds, all move, and then change lanes."""

import math

import numpy as np

from drl_av.compiled import compiled
from drl_av.twin.active_lanes import (
    EDGES,
    HAS_ENTERED,
    HAS_STAYED,
    activate,
    forget_empty,
    mark_present,
    put_in_front,
    strip_of,
)
from drl_av.twin.flags import (
    BLOCKED,
    BLOCKED_BY_LEADER,
    COOPERATIVE,
    KEEP_RIGHT,
    LEFT,
    REQUESTED,
    RIGHT,
    SPEED_GAIN,
    STAY,
    STRATEGIC,
    SUBLANE,
    WANTS,
)
from drl_av.twin.following import (
    BRAKING_M_S2,
    EPS,
    MIN_GAP_M,
    MOST_BRAKING_M_S,
    STEP_S,
    brake_gap,
    free_speed,
)
from drl_av.twin.lane_changing import (
    FOLLOWER,
    FOLLOWER_GAP,
    LAST_LEFT,
    LAST_RIGHT,
    LEFT_SPACE,
    MANEUVER,
    MOVE,
    RELATED_COUNT,
    ROUTE_M,
    SAFE_LEFT,
    SAFE_RIGHT,
    center_m,
    influenced,
    its_follow_speed,
    request_of,
    signed,
)
from drl_av.twin.lane_choice import (
    is_open,
    keep_lateral_gap,
    limit_move,
    look_around,
    needs_thought,
    track,
    wish,
)
from drl_av.twin.neighbors import follower, insert_sorted, shadow_lane
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ACCELERATION_NOW_M_S2,
    ACTIVE,
    ACTIVE_COUNT,
    ADVICE_M_S,
    ASIDE_M,
    COMMANDED_M,
    COUNT,
    DESIRED_M_S,
    FRONT_M,
    GAIN_LEFT,
    GAIN_RIGHT,
    HEADWAY_S,
    IS_FULL,
    LANE,
    LATERAL_SPEED_M_S,
    LENGTH_M,
    MANEUVER_M,
    MARKS,
    MASK,
    NEXT_M_S,
    ON_REQUEST_ONLY,
    ORDER,
    PREVIOUS_STATE,
    RESERVED,
    SHADOW,
    SPEED_M_S,
    STATE,
    STEP,
    THRESHOLD_LEFT,
    TRACKED,
    TRACKED_LEFT,
    WIDTH_M,
    Loop,
    World,
)


@compiled
def sumo_step(world: World, loop: Loop, ego_speed_m_s: float, ego_y_m: float) -> None:
    """Advance the world ``w`` by one SUMO step, in which the ego reaches this speed and place."""
    for k in range(world.near[COUNT]):
        i = world.z[ORDER, k]
        world.x[NEXT_M_S, i] = ego_speed_m_s if i == 0 else next_speed(world, loop, k)
    move(world, loop)
    insert_sorted(world)
    change_lanes(world, loop, ego_y_m)
    world.near[STEP] += 1


@compiled
def change_lanes(world: World, loop: Loop, ego_y_m: float) -> None:
    """Let the vehicles change lanes one after the other: edge by edge, on each the foremost first.

    A driver knows the lane changes of those before it.
    """
    n, done = world.near[COUNT], 0
    for m in range(world.near[ACTIVE_COUNT]):
        edge = world.near[ACTIVE + m] // loop.lanes
        if done & (1 << edge):
            continue
        done |= 1 << edge
        first_m, last_m = edge * loop.edge_m, (edge + 1) * loop.edge_m
        for k in range(n):
            i = world.z[ORDER, k]
            if world.x[FRONT_M, i] >= last_m:
                continue
            if world.x[FRONT_M, i] < first_m:
                break
            if i == 0:
                place_ego(world, loop, ego_y_m)
            elif needs_thought(world, loop, k):
                change_lane(world, loop, k)
            elif world.z[STATE, i] or world.z[PREVIOUS_STATE, i] != SUBLANE | STAY:
                settle(world, i)
    mark_present(world, loop)
    for edge in range(EDGES):  # SUMO collects them edge by edge
        for lane in range(loop.lanes):
            if world.near[MARKS + edge * loop.lanes + lane]:
                put_in_front(world, loop, edge * loop.lanes + lane)


@compiled
def next_speed(world: World, loop: Loop, k: int) -> float:
    """Return the speed of the ``k``-th vehicle after the step, by IDM and the advice it got."""
    i = world.z[ORDER, k]
    at_m, speed, desired = world.x[FRONT_M, i], world.x[SPEED_M_S, i], world.x[DESIRED_M_S, i]
    least = max(speed - MOST_BRAKING_M_S, 0.0)
    fastest = min(desired, loop.limit_m_s)
    top = min(speed + world.x[ACCELERATION_M_S2, i] * STEP_S, desired)
    planned = min(top, max(fastest, least))
    rest_m = loop.edge_m - (at_m - math.floor(at_m / loop.edge_m) * loop.edge_m)
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
    advice = world.x[ADVICE_M_S, i]
    if advice <= planned:
        return advice
    state = world.z[STATE, i]
    if state & WANTS and state & BLOCKED and state & COOPERATIVE and state & BLOCKED_BY_LEADER:
        return (least + planned) / 2
    return planned


@compiled
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
    n = world.near[COUNT]
    i = world.z[ORDER, k]
    at_m, result = world.x[FRONT_M, i], math.inf
    served_m, slowest = 0.0, math.inf
    m, wrapped_m = k, 0.0
    for _ in range(n - 1):
        m -= 1
        if m < 0:
            m, wrapped_m = n - 1, loop.lap_m
        j = world.z[ORDER, m]
        ahead_m = world.x[FRONT_M, j] - at_m + wrapped_m
        rear_m = ahead_m - world.x[LENGTH_M, j]
        if rear_m >= seen_m:
            if rear_m >= seen_m + 25.0:
                break
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


@compiled
def move(world: World, loop: Loop) -> None:
    """Move all vehicles along the road, and forget what was agreed for this step only."""
    mark_present(world, loop)
    forget_empty(world, loop, HAS_STAYED)
    for strip in range(EDGES * loop.lanes):
        world.near[MARKS + strip] = 0
    for i in range(world.near[COUNT]):
        speed, strip = world.x[NEXT_M_S, i], strip_of(world, loop, i)
        world.x[ACCELERATION_NOW_M_S2, i] = (speed - world.x[SPEED_M_S, i]) / STEP_S
        world.x[SPEED_M_S, i] = speed
        at_m = world.x[FRONT_M, i] + speed * STEP_S
        world.x[FRONT_M, i] = at_m if at_m < loop.lap_m else at_m - loop.lap_m
        now = strip_of(world, loop, i)
        world.near[MARKS + now] |= HAS_STAYED if now == strip else HAS_ENTERED
        state = world.z[STATE, i]
        world.z[STATE, i] = state & WANTS if state & (STRATEGIC | COOPERATIVE) else 0
        world.x[ADVICE_M_S, i] = math.inf
        if world.x[THRESHOLD_LEFT, i] != math.inf:
            world.x[GAIN_LEFT, i] = np.ceil(world.x[GAIN_LEFT, i] * 100000.0) * 0.00001
            world.x[GAIN_RIGHT, i] = np.ceil(world.x[GAIN_RIGHT, i] * 100000.0) * 0.00001
    forget_empty(world, loop, HAS_STAYED)
    activate(world, loop)


@compiled
def place_ego(world: World, loop: Loop, y_m: float) -> None:
    """Move the ego sideways to ``y_m``."""
    was_m = world.z[LANE, 0] * loop.lane_m + world.x[ASIDE_M, 0]
    shift(world, loop, 0, y_m - was_m)


@compiled
def shift(world: World, loop: Loop, i: int, move_m: float) -> bool:
    """Move a vehicle sideways; return whether its centre has entered another lane."""
    lane, aside_m = world.z[LANE, i], world.x[ASIDE_M, i] + move_m
    world.x[LATERAL_SPEED_M_S, i] = move_m / STEP_S
    entered = False
    if abs(aside_m) > 0.5 * loop.lane_m:
        side = -1 if aside_m < 0 else 1
        if i == 0 or is_open(loop, lane + side):
            aside_m -= side * loop.lane_m
            lane += side
            entered = True
    world.z[LANE, i], world.x[ASIDE_M, i] = lane, aside_m
    other = shadow_lane(aside_m, world.x[WIDTH_M, i], lane, loop)
    world.z[SHADOW, i] = other
    world.z[MASK, i] = 1 << lane | (1 << other if other >= 0 else 0)
    return entered


@compiled
def settle(world: World, i: int) -> None:
    """Note that a vehicle stays at the centre of its lane."""
    world.z[STATE, i] = SUBLANE | STAY
    world.z[PREVIOUS_STATE, i] = SUBLANE | STAY
    world.z[IS_FULL, i] = 1
    world.z[RESERVED, i] = -1
    world.x[MANEUVER_M, i] = 0.0
    world.x[LATERAL_SPEED_M_S, i] = 0.0


@compiled
def change_lane(world: World, loop: Loop, k: int) -> None:
    """Let the ``k``-th vehicle decide on its lane, and move it sideways."""
    i = world.z[ORDER, k]
    if world.z[TRACKED_LEFT, i] < world.near[STEP] - 1:
        track(world, loop, k)  # also of the steps in which it did not matter
    else:
        look_around(world, loop, k)
    notes, near, own = world.notes, world.near, world.z[LANE, i]
    sides = (RIGHT if is_open(loop, own - 1) else 0) | (LEFT if is_open(loop, own + 1) else 0)
    for d in (-1, 0, 1):
        near[FOLLOWER + 1 + d] = -1
        if is_open(loop, own + d):
            j, gap_m = follower(world, loop, k, own + d)
            near[FOLLOWER + 1 + d], notes[FOLLOWER_GAP + 1 + d] = j, gap_m
    half_m = (world.x[WIDTH_M, i] + EPS) * 0.5
    center = center_m(world, loop, i)
    notes[SAFE_RIGHT] = center - half_m
    notes[SAFE_LEFT] = loop.lanes * loop.lane_m - center - half_m
    notes[LAST_RIGHT] = math.inf
    notes[LAST_LEFT] = math.inf
    at_m = world.x[FRONT_M, i]
    notes[LEFT_SPACE] = ROUTE_M - (at_m - math.floor(at_m / loop.edge_m) * loop.edge_m)
    near[RELATED_COUNT] = -1
    world.z[TRACKED, i], world.z[TRACKED_LEFT, i] = near[STEP], near[STEP]
    right, right_m, right_all_m = 0, 0.0, 0.0
    if sides & RIGHT:
        right, right_m, right_all_m = considered(world, loop, i, -1, sides)
    left, left_m, left_all_m = 0, 0.0, 0.0
    if sides & LEFT:
        left, left_m, left_all_m = considered(world, loop, i, 1, sides)
    here, here_m, here_all_m = considered(world, loop, i, 0, sides)
    state, move_m, all_m, side = right, right_m, right_all_m, -1
    if is_second(right, right_m, left, left_m, -1, 1):
        state, move_m, all_m, side = left, left_m, left_all_m, 1
    if not is_second(here, here_m, state, move_m, 0, side):
        state, move_m, all_m, side = here, here_m, here_all_m, 0
    world.z[STATE, i] = state
    world.z[PREVIOUS_STATE, i] = state
    if state & STAY:
        world.z[IS_FULL, i] = 1
    world.x[COMMANDED_M, i] = 0.0
    if not state & WANTS or state & BLOCKED:
        world.x[MANEUVER_M, i] = 0.0
        world.x[LATERAL_SPEED_M_S, i] = 0.0
        world.z[RESERVED, i] = -1
        return
    left_m = all_m - move_m
    world.x[MANEUVER_M, i] = 0.0 if abs(left_m) < EPS else left_m
    if shift(world, loop, i, move_m) and world.z[IS_FULL, i]:
        world.z[STATE, i] = 0
        world.x[GAIN_LEFT, i] = 0.0
        world.x[GAIN_RIGHT, i] = 0.0
        world.x[ADVICE_M_S, i] = math.inf
    reserve(world, loop, i)
    if world.z[STATE, i] & REQUESTED:
        world.x[COMMANDED_M, i] = world.x[MANEUVER_M, i]


@compiled
def reserve(world: World, loop: Loop, i: int) -> None:
    """Note the lane that the rest of the maneuver leads into, if the body is not there yet."""
    world.z[RESERVED, i] = -1
    rest_m = world.x[MANEUVER_M, i]
    if rest_m == 0.0:
        return
    half_m, aside_m = 0.5 * world.x[WIDTH_M, i], world.x[ASIDE_M, i]
    side = 0
    if aside_m - half_m + rest_m < -0.5 * loop.lane_m:
        side = -1
    elif aside_m + half_m + rest_m > 0.5 * loop.lane_m:
        side = 1
    lane = world.z[LANE, i] + side
    if side and 0 <= lane < loop.lanes and lane != world.z[SHADOW, i]:
        world.z[RESERVED, i] = lane


@compiled
def considered(world: World, loop: Loop, i: int, side: int, sides: int) -> tuple[int, float, float]:
    """Return the state, the move and the maneuver to which considering a side leads."""
    state = wish(world, loop, i, side, sides)
    state = keep_lateral_gap(world, loop, i, side, state)
    state |= signed(state, world.notes[MOVE])
    limit_move(world, i)
    state = influenced(
        state,
        request_of(world, loop, i),
        world.z[ON_REQUEST_ONLY, i],
        world.x[COMMANDED_M, i] != 0,
    )
    return state, world.notes[MOVE], world.notes[MANEUVER]


@compiled
def reason(state: int) -> int:
    """Return the strongest reason in a state; a smaller number is stronger."""
    for flag in (STRATEGIC, COOPERATIVE, SPEED_GAIN, KEEP_RIGHT, REQUESTED):
        if state & flag:
            return flag
    return state & SUBLANE


@compiled
def is_second(one: int, one_m: float, two: int, two_m: float, one_side: int, two_side: int) -> bool:
    """Return whether SUMO prefers the second of two considerations."""
    if one == 0:
        return True
    if two == 0:
        return False
    stays = SUBLANE | STAY
    if not (one & WANTS or one & stays == stays):
        return True
    if not (two & WANTS or two & stays == stays):
        return False
    if one & REQUESTED and two & REQUESTED and (one_m == 0.0) != (two_m == 0.0):
        return one_m == 0.0
    first, second = reason(one), reason(two)
    one_can, two_can = not one & BLOCKED, not two & BLOCKED
    same = one_m * two_m > 0
    if first < second:
        return not one_can and two_can and same
    if first > second:
        return not (not two_can and one_can and same)
    if one & SUBLANE:
        if one_side == 0:
            return True
        if two_side == 0:
            return False
        if one_m <= 0:
            return False
        return two_m >= 0 or one_m > two_m
    return not one_can
