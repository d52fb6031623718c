"""One SUMO step of a world: the drivers plan their speeds, all move, and then change lanes."""

import math

import numpy as np

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
from drl_av.twin.compiled import compiled
from drl_av.twin.flags import (
    ASKED,
    BLOCKED,
    BLOCKED_BY_LEADER,
    COOPERATIVE,
    IS_BLOCKING_FOLLOWER,
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
from drl_av.twin.lane_choice import is_open, keep_lateral_gap, limit_move, look_around, wish
from drl_av.twin.neighbors import follower, insert_sorted, shadow_lane
from drl_av.twin.worlds import Loop, Worlds


@compiled
def sumo_step(worlds: Worlds, loop: Loop, w: int, ego_speed_m_s: float, ego_y_m: float) -> None:
    """Advance the world ``w`` by one SUMO step, in which the ego reaches this speed and place."""
    for k in range(worlds.count[w]):
        i = worlds.order[w, k]
        worlds.next_m_s[w, i] = ego_speed_m_s if i == 0 else next_speed(worlds, loop, w, k)
    move(worlds, loop, w)
    insert_sorted(worlds, w)
    change_lanes(worlds, loop, w, ego_y_m)
    worlds.step[w] += 1


@compiled
def change_lanes(worlds: Worlds, loop: Loop, w: int, ego_y_m: float) -> None:
    """Let the vehicles change lanes one after the other: edge by edge, on each the foremost first.

    A driver knows the lane changes of those before it.
    """
    n, done = worlds.count[w], 0
    for m in range(worlds.active_count[w]):
        edge = worlds.active[w, m] // loop.lanes
        if done & (1 << edge):
            continue
        done |= 1 << edge
        first_m, last_m = edge * loop.edge_m, (edge + 1) * loop.edge_m
        for k in range(n):
            i = worlds.order[w, k]
            if worlds.front_m[w, i] >= last_m:
                continue
            if worlds.front_m[w, i] < first_m:
                break
            if i == 0:
                place_ego(worlds, loop, w, ego_y_m)
            else:
                change_lane(worlds, loop, w, k)
    mark_present(worlds, loop, w)
    for edge in range(EDGES):  # SUMO collects them edge by edge
        for lane in range(loop.lanes):
            if worlds.marks[w, edge * loop.lanes + lane]:
                put_in_front(worlds, loop, w, edge * loop.lanes + lane)


@compiled
def next_speed(worlds: Worlds, loop: Loop, w: int, k: int) -> float:
    """Return the speed of the ``k``-th vehicle after the step, by IDM and the advice it got."""
    i = worlds.order[w, k]
    at_m, speed, desired = worlds.front_m[w, i], worlds.speed_m_s[w, i], worlds.desired_m_s[w, i]
    least = max(speed - MOST_BRAKING_M_S, 0.0)
    fastest = min(desired, loop.limit_m_s)
    top = min(speed + worlds.acceleration_m_s2[w, i] * STEP_S, desired)
    planned = min(top, max(fastest, least))
    rest_m = loop.edge_m - (at_m - math.floor(at_m / loop.edge_m) * loop.edge_m)
    free = free_speed(
        speed, rest_m, fastest, worlds.headway_s[w, i], worlds.acceleration_m_s2[w, i]
    )
    planned = min(planned, max(free, least))
    far_m = top * STEP_S + brake_gap(top, BRAKING_M_S2, worlds.headway_s[w, i])
    seen_m = rest_m + loop.edge_m
    while seen_m <= far_m:
        seen_m += loop.edge_m
    planned = min(
        planned, speed_behind(worlds, loop, w, k, worlds.lane[w, i], rest_m, seen_m, True)
    )
    if worlds.shadow[w, i] >= 0:
        planned = min(
            planned, speed_behind(worlds, loop, w, k, worlds.shadow[w, i], rest_m, seen_m, False)
        )
    planned = max(least, min(planned, top, fastest))
    advice = worlds.advice_m_s[w, i]
    if advice <= planned:
        return advice
    state = worlds.state[w, i]
    if state & WANTS and state & BLOCKED and state & COOPERATIVE and state & BLOCKED_BY_LEADER:
        return (least + planned) / 2
    return planned


@compiled
def speed_behind(
    worlds: Worlds,
    loop: Loop,
    w: int,
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
    n, order, front = worlds.count[w], worlds.order, worlds.front_m
    i = order[w, k]
    at_m, result = front[w, i], math.inf
    served_m, slowest = 0.0, math.inf
    m, wrapped_m = k, 0.0
    for _ in range(n - 1):
        m -= 1
        if m < 0:
            m, wrapped_m = n - 1, loop.lap_m
        j = order[w, m]
        ahead_m = front[w, j] - at_m + wrapped_m
        rear_m = ahead_m - worlds.length_m[w, j]
        if rear_m >= seen_m:
            if rear_m >= seen_m + 25.0:
                break
            continue
        is_in = worlds.lane[w, j] == lane or worlds.shadow[w, j] == lane
        if not is_in and not (
            sees_reserved and worlds.reserved[w, j] == lane and rear_m < rest_m and served_m == 0.0
        ):
            continue
        if ahead_m <= served_m and served_m > 0.0:
            continue
        its = worlds.speed_m_s[w, j]
        if its < slowest:
            slowest = its
            result = min(result, its_follow_speed(worlds, w, i, rear_m - MIN_GAP_M, its))
        served_m = rest_m
        while served_m < ahead_m:
            served_m += loop.edge_m
        if served_m >= seen_m:
            break
    return result


@compiled
def move(worlds: Worlds, loop: Loop, w: int) -> None:
    """Move all vehicles along the road, and forget what was agreed for this step only."""
    mark_present(worlds, loop, w)
    forget_empty(worlds, loop, w, HAS_STAYED)
    for strip in range(EDGES * loop.lanes):
        worlds.marks[w, strip] = 0
    for i in range(worlds.count[w]):
        speed, strip = worlds.next_m_s[w, i], strip_of(worlds, loop, w, i)
        worlds.acceleration_now_m_s2[w, i] = (speed - worlds.speed_m_s[w, i]) / STEP_S
        worlds.speed_m_s[w, i] = speed
        at_m = worlds.front_m[w, i] + speed * STEP_S
        worlds.front_m[w, i] = at_m if at_m < loop.lap_m else at_m - loop.lap_m
        now = strip_of(worlds, loop, w, i)
        worlds.marks[w, now] |= HAS_STAYED if now == strip else HAS_ENTERED
        state = worlds.state[w, i]
        worlds.state[w, i] = state & WANTS if state & (STRATEGIC | COOPERATIVE) else 0
        worlds.advice_m_s[w, i] = math.inf
        worlds.gain_left[w, i] = np.ceil(worlds.gain_left[w, i] * 100000.0) * 0.00001
        worlds.gain_right[w, i] = np.ceil(worlds.gain_right[w, i] * 100000.0) * 0.00001
    forget_empty(worlds, loop, w, HAS_STAYED)
    activate(worlds, loop, w)


@compiled
def place_ego(worlds: Worlds, loop: Loop, w: int, y_m: float) -> None:
    """Move the ego sideways to ``y_m``."""
    was_m = worlds.lane[w, 0] * loop.lane_m + worlds.aside_m[w, 0]
    shift(worlds, loop, w, 0, y_m - was_m)


@compiled
def shift(worlds: Worlds, loop: Loop, w: int, i: int, move_m: float) -> bool:
    """Move a vehicle sideways; return whether its centre has entered another lane."""
    lane, aside_m = worlds.lane[w, i], worlds.aside_m[w, i] + move_m
    worlds.lateral_speed_m_s[w, i] = move_m / STEP_S
    entered = False
    if abs(aside_m) > 0.5 * loop.lane_m:
        side = -1 if aside_m < 0 else 1
        if i == 0 or is_open(loop, lane + side):
            aside_m -= side * loop.lane_m
            lane += side
            entered = True
    worlds.lane[w, i], worlds.aside_m[w, i] = lane, aside_m
    worlds.shadow[w, i] = shadow_lane(aside_m, worlds.width_m[w, i], lane, loop)
    return entered


@compiled
def change_lane(worlds: Worlds, loop: Loop, w: int, k: int) -> None:
    """Let the ``k``-th vehicle decide on its lane, and move it sideways."""
    i = worlds.order[w, k]
    look_around(worlds, loop, w, k)
    notes, near, own = worlds.notes, worlds.near, worlds.lane[w, i]
    sides = (RIGHT if is_open(loop, own - 1) else 0) | (LEFT if is_open(loop, own + 1) else 0)
    for d in (-1, 0, 1):
        near[w, FOLLOWER + 1 + d] = -1
        if is_open(loop, own + d):
            j, gap_m = follower(worlds, loop, w, k, own + d)
            near[w, FOLLOWER + 1 + d], notes[w, FOLLOWER_GAP + 1 + d] = j, gap_m
    half_m = (worlds.width_m[w, i] + EPS) * 0.5
    center = center_m(worlds, loop, w, i)
    notes[w, SAFE_RIGHT] = center - half_m
    notes[w, SAFE_LEFT] = loop.lanes * loop.lane_m - center - half_m
    notes[w, LAST_RIGHT] = math.inf
    notes[w, LAST_LEFT] = math.inf
    at_m = worlds.front_m[w, i]
    notes[w, LEFT_SPACE] = ROUTE_M - (at_m - math.floor(at_m / loop.edge_m) * loop.edge_m)
    near[w, RELATED_COUNT] = -1
    right, right_m, right_all_m = 0, 0.0, 0.0
    if sides & RIGHT:
        right, right_m, right_all_m = considered(worlds, loop, w, i, -1, sides)
    left, left_m, left_all_m = 0, 0.0, 0.0
    if sides & LEFT:
        left, left_m, left_all_m = considered(worlds, loop, w, i, 1, sides)
    here, here_m, here_all_m = considered(worlds, loop, w, i, 0, sides)
    state, move_m, all_m, side = right, right_m, right_all_m, -1
    if is_second(right, right_m, left, left_m, -1, 1):
        state, move_m, all_m, side = left, left_m, left_all_m, 1
    if not is_second(here, here_m, state, move_m, 0, side):
        state, move_m, all_m, side = here, here_m, here_all_m, 0
    worlds.state[w, i] = state
    worlds.previous_state[w, i] = state
    if state & STAY:
        worlds.is_full[w, i] = 1
    worlds.commanded_m[w, i] = 0.0
    if not state & WANTS or state & BLOCKED:
        worlds.maneuver_m[w, i] = 0.0
        worlds.lateral_speed_m_s[w, i] = 0.0
        worlds.reserved[w, i] = -1
        return
    left_m = all_m - move_m
    worlds.maneuver_m[w, i] = 0.0 if abs(left_m) < EPS else left_m
    if shift(worlds, loop, w, i, move_m) and worlds.is_full[w, i]:
        worlds.state[w, i] = 0
        worlds.gain_left[w, i] = 0.0
        worlds.gain_right[w, i] = 0.0
        worlds.advice_m_s[w, i] = math.inf
    reserve(worlds, loop, w, i)
    if worlds.state[w, i] & REQUESTED:
        worlds.commanded_m[w, i] = worlds.maneuver_m[w, i]


@compiled
def reserve(worlds: Worlds, loop: Loop, w: int, i: int) -> None:
    """Note the lane that the rest of the maneuver leads into, if the body is not there yet."""
    worlds.reserved[w, i] = -1
    rest_m = worlds.maneuver_m[w, i]
    if rest_m == 0.0:
        return
    half_m, aside_m = 0.5 * worlds.width_m[w, i], worlds.aside_m[w, i]
    side = 0
    if aside_m - half_m + rest_m < -0.5 * loop.lane_m:
        side = -1
    elif aside_m + half_m + rest_m > 0.5 * loop.lane_m:
        side = 1
    lane = worlds.lane[w, i] + side
    if side and 0 <= lane < loop.lanes and lane != worlds.shadow[w, i]:
        worlds.reserved[w, i] = lane


@compiled
def considered(
    worlds: Worlds, loop: Loop, w: int, i: int, side: int, sides: int
) -> tuple[int, float, float]:
    """Return the state, the move and the maneuver to which considering a side leads."""
    state = wish(worlds, loop, w, i, side, sides)
    state = keep_lateral_gap(worlds, loop, w, i, side, state)
    state |= signed(state, worlds.notes[w, MOVE])
    limit_move(worlds, w, i)
    state = influenced(
        state,
        request_of(worlds, loop, w, i),
        worlds.on_request_only[w, i],
        worlds.commanded_m[w, i] != 0,
    )
    return state, worlds.notes[w, MOVE], worlds.notes[w, MANEUVER]


@compiled
def reason(state: int) -> int:
    """Return the strongest reason in a state; a smaller number is stronger."""
    for flag in (STRATEGIC, COOPERATIVE, SPEED_GAIN, KEEP_RIGHT, REQUESTED):
        if state & flag:
            return flag
    return state & SUBLANE


@compiled
def is_second(
    one: int, one_m: float, two: int, two_m: float, one_side: int, two_side: int
) -> bool:
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
