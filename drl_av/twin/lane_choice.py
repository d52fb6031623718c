"""The lane that a driver of SUMO's SL2015 chooses in one step, and the lateral move that it makes."""

import math

from drl_av.twin.compiled import compiled
from drl_av.twin.flags import (
    ASKED,
    ASKED_BY_LEFTWARD,
    ASKED_BY_RIGHTWARD,
    BLOCKED,
    BLOCKED_LEFT,
    BLOCKED_RIGHT,
    COOPERATIVE,
    FULL_REASONS,
    IS_BLOCKING_FOLLOWER,
    KEEP_RIGHT,
    LEFT,
    OVERLAPPING,
    REASONS,
    REQUESTED,
    RIGHT,
    SPEED_GAIN,
    STAY,
    STRATEGIC,
    SUBLANE,
    URGENT,
    WANTS,
)
from drl_av.twin.following import EPS, MIN_GAP_M, MOST_BRAKING_M_S, STEP_S, follow_speed
from drl_av.twin.lane_changing import (
    BLOCKERS,
    CONGESTED_M_S,
    DECAY,
    FOLLOWER,
    FOLLOWER_GAP,
    HELP_M_S,
    LAST_LEFT,
    LAST_RIGHT,
    LATERAL_GAP_M,
    LEADER,
    LEADER_GAP,
    LEFT_SPACE,
    MANEUVER,
    MOVE,
    RELATED_COUNT,
    ROUTE_M,
    SAFE_LEFT,
    SAFE_RIGHT,
    STRIDE_M,
    TINY_M,
    advise,
    center_m,
    check_blocking,
    influenced,
    inform_follower,
    inform_leader,
    its_follow_speed,
    lane_side_distance,
    overlaps,
    request_of,
    signed,
    update_gaps,
)
from drl_av.twin.neighbors import follower, reach_m, shadow_lane
from drl_av.twin.worlds import Loop, Worlds

GAIN_SEEN = 0.05
SLOW_M_S = 10.0
LOSS = -0.1
LOOKAHEAD_S = 5.0


@compiled
def is_open(loop: Loop, lane: int) -> bool:
    """Return whether the lane exists and is open."""
    return loop.first_open <= lane <= loop.last_open


@compiled
def look_around(worlds: Worlds, loop: Loop, w: int, k: int) -> None:
    """Find the vehicles ahead of the ``k``-th one in all lanes, and what speed each lane promises.

    The leaders in the right, own and left lane go to ``near`` and their net gaps to ``notes``.
    """
    n, order, front = worlds.count[w], worlds.order, worlds.front_m
    i = order[w, k]
    at_m, speed, own = front[w, i], worlds.speed_m_s[w, i], worlds.lane[w, i]
    desired, headway_s = worlds.desired_m_s[w, i], worlds.headway_s[w, i]
    acceleration = worlds.acceleration_m_s2[w, i]
    pos_m = at_m - math.floor(at_m / loop.edge_m) * loop.edge_m
    seen_m = reach_m(loop.edge_m - pos_m, speed, headway_s, loop.edge_m)
    for d in range(3):
        worlds.near[w, LEADER + d] = -1
    todo = loop.last_open - loop.first_open + 1
    found = 0
    m, wrapped_m = k, 0.0
    for _ in range(n - 1):
        m -= 1
        if m < 0:
            m, wrapped_m = n - 1, loop.lap_m
        j = order[w, m]
        behind_m = front[w, j] - at_m + wrapped_m - worlds.length_m[w, j]
        if behind_m >= seen_m + 25.0:
            break
        if behind_m >= seen_m:
            continue
        for lane in (worlds.lane[w, j], worlds.shadow[w, j]):
            if lane < 0 or found & (1 << lane) or not is_open(loop, lane):
                continue
            found |= 1 << lane
            todo -= 1
            gap_m = behind_m - MIN_GAP_M
            if abs(lane - own) <= 1:
                worlds.near[w, LEADER + 1 + lane - own] = j
                worlds.notes[w, LEADER_GAP + 1 + lane - own] = gap_m
            its = worlds.speed_m_s[w, j]
            most = 2.0 if j == 0 else worlds.acceleration_m_s2[w, j]
            if worlds.acceleration_now_m_s2[w, j] > 0.5 * most:
                promised = worlds.desired_m_s[w, j]
            else:
                promised = follow_speed(desired, gap_m, its, desired, headway_s, acceleration)
                faster = desired - its
                if faster > 0 and gap_m / faster < LOOKAHEAD_S:
                    closing_s = max(0.0, gap_m / faster)
                    promised = closing_s * promised + (2 * LOOKAHEAD_S - closing_s) * its
                    promised /= 2 * LOOKAHEAD_S
            expect(worlds, w, i, lane, min(desired, promised))
        if todo == 0:
            break
    if todo:
        room_m = ROUTE_M - pos_m
        promised = follow_speed(desired, room_m, 0.0, desired, headway_s, acceleration)
        for lane in range(loop.first_open, loop.last_open + 1):
            if not found & (1 << lane):
                expect(worlds, w, i, lane, min(desired, promised))


@compiled
def expect(worlds: Worlds, w: int, i: int, lane: int, promised: float) -> None:
    """Adapt the expected speed of a lane to the promised one."""
    worlds.expected_m_s[w, i, lane] = (
        DECAY * worlds.expected_m_s[w, i, lane] + (1 - DECAY) * promised
    )


@compiled
def keep_behind(worlds: Worlds, loop: Loop, w: int, i: int) -> None:
    """Advise a driver not to pass the vehicle ahead in the left lane on its right."""
    j = worlds.near[w, LEADER + 2]
    speed = worlds.speed_m_s[w, i]
    if j < 0 or loop.overtake_right or speed < CONGESTED_M_S:
        return
    its = worlds.speed_m_s[w, j]
    if its < speed or worlds.desired_m_s[w, j] < worlds.desired_m_s[w, i]:
        safe = its_follow_speed(worlds, w, i, worlds.notes[w, LEADER_GAP + 2], its)
        if safe < speed - MOST_BRAKING_M_S:
            safe = max(speed - MOST_BRAKING_M_S, its - HELP_M_S)
        advise(worlds, w, i, safe)
        if safe < speed:
            worlds.gain_right[w, i] += STEP_S * worlds.threshold_left[w, i] / 3


@compiled
def weigh_gains(
    worlds: Worlds, loop: Loop, w: int, i: int, side: int, sides: int
) -> tuple[float, float]:
    """Update the gains of speed to each side; return the best lateral move, and the own speed.

    ``sides`` holds the flags of the sides that are open to the vehicle.
    """
    lane_m, own = loop.lane_m, worlds.lane[w, i]
    width_m = worlds.width_m[w, i] + EPS
    right = center_m(worlds, loop, w, i) - 0.5 * width_m
    left = right + width_m
    high = loop.lanes - 1
    while high > 0 and high * lane_m > left:
        high -= 1
    low = high
    stays = math.inf
    while low > 0 and low * lane_m > right + EPS:
        stays = min(stays, worlds.expected_m_s[w, i, low])
        low -= 1
    stays = min(stays, worlds.expected_m_s[w, i, low])
    end_left = (max(own, own + side) + 1) * lane_m - left
    end_right = min(own, own + side) * lane_m - right
    best, best_right, best_left, move_m = -math.inf, -math.inf, -math.inf, 0.0
    first, last = 0 if side < 0 else own, loop.lanes - 1 if side > 0 else own
    for lane in range(first, last + 1):
        at = lane * lane_m
        its = worlds.expected_m_s[w, i, lane]
        gain = (its - stays) / max(its, SLOW_M_S)
        shift = min(max(at - right, end_right), end_left)
        if gain > best:
            best = gain
            if best > GAIN_SEEN:
                move_m = shift
        elif (
            shift > 0
            and worlds.gain_left[w, i] > worlds.gain_right[w, i]
            and gain > GAIN_SEEN
            and best - gain < EPS
        ):
            move_m = shift
        if shift < -TINY_M:
            best_right = max(best_right, gain)
        elif shift > TINY_M:
            best_left = max(best_left, gain)
    if best_right != -math.inf:
        worlds.gain_right[w, i] += STEP_S * best_right
    if best_left != -math.inf:
        worlds.gain_left[w, i] += STEP_S * best_left
    if (abs(best_right) < EPS or best_right == -math.inf) and (side < 0 or not sides & RIGHT):
        worlds.gain_right[w, i] *= DECAY
    if (abs(best_left) < EPS or best_left == -math.inf) and (side > 0 or not sides & LEFT):
        worlds.gain_left[w, i] *= DECAY
    return move_m, stays


@compiled
def speed_gain_of(worlds: Worlds, loop: Loop, w: int, i: int, move_m: float, stays: float) -> float:
    """Return the expected change of the speed after a lateral move."""
    result = math.inf
    width_m = worlds.width_m[w, i] + EPS
    right = center_m(worlds, loop, w, i) - 0.5 * width_m + move_m
    for lane in range(loop.lanes):
        if overlaps(right, right + width_m, lane * loop.lane_m, (lane + 1) * loop.lane_m):
            result = min(result, worlds.expected_m_s[w, i, lane])
    return result - stays


@compiled
def wish(worlds: Worlds, loop: Loop, w: int, i: int, side: int, sides: int) -> int:
    """Return the state after considering a side; the move and maneuver go to ``notes``."""
    notes, near = worlds.notes, worlds.near
    notes[w, MOVE] = 0.0
    notes[w, MANEUVER] = 0.0
    state = worlds.state[w, i] & ASKED
    width_m, aside_m, own = worlds.width_m[w, i], worlds.aside_m[w, i], worlds.lane[w, i]
    request, on_request_only = request_of(worlds, loop, w, i), worlds.on_request_only[w, i]
    is_commanded = worlds.commanded_m[w, i] != 0
    across_m = 0.0
    if side != 0:
        across_m = lane_side_distance(width_m, aside_m, side, loop.lane_m)
        if side > 0:
            keep_behind(worlds, loop, w, i)
        if request != 0:
            asked = influenced(state, request, on_request_only, is_commanded)
            if asked & STAY:
                state = asked
            elif request == side:
                state = asked
                notes[w, MOVE] = across_m
    if state & STAY:
        right, left = notes[w, SAFE_RIGHT], notes[w, SAFE_LEFT]
        other = own + side
        j, gap_m = near[w, LEADER + 1 + side], notes[w, LEADER_GAP + 1 + side]
        right, left = update_gaps(
            worlds, loop, w, i, other, j, gap_m, right, left, LATERAL_GAP_M, False, 0.0
        )
        j, gap_m = near[w, FOLLOWER + 1 + side], notes[w, FOLLOWER_GAP + 1 + side]
        right, left = update_gaps(
            worlds, loop, w, i, other, j, gap_m, right, left, LATERAL_GAP_M, False, 0.0
        )
        notes[w, SAFE_RIGHT], notes[w, SAFE_LEFT] = right, left
        return state
    if state & URGENT:
        return state | ask_for_room(worlds, loop, w, i, side)
    mine = ASKED_BY_RIGHTWARD if side < 0 else ASKED_BY_LEFTWARD
    if side != 0:
        helps = worlds.state[w, i] & IS_BLOCKING_FOLLOWER
        goes_on = (
            worlds.previous_state[w, i] & COOPERATIVE
            and not worlds.is_full[w, i]
            and side * worlds.maneuver_m[w, i] > 0
        )
        if (helps and worlds.state[w, i] & mine) or goes_on:
            wanted = state | COOPERATIVE | URGENT
            asked = wanted | signed(wanted, across_m)
            if influenced(asked, request, on_request_only, is_commanded) == asked:
                notes[w, MOVE] = across_m if helps else worlds.maneuver_m[w, i]
                notes[w, MANEUVER] = notes[w, MOVE]
                return wanted | check_blocking(worlds, loop, w, i, side, LATERAL_GAP_M, False)
    move_m, stays = weigh_gains(worlds, loop, w, i, side, sides)
    goes_right = side <= 0 and move_m < 0
    goes_right = goes_right and worlds.gain_right[w, i] >= max(
        worlds.threshold_right[w, i], worlds.gain_left[w, i]
    )
    goes_left = side >= 0 and move_m > 0
    goes_left = goes_left and worlds.gain_left[w, i] > worlds.threshold_left[w, i]
    if goes_right or goes_left:
        wanted = state | SPEED_GAIN
        asked = wanted | signed(wanted, move_m)
        if influenced(asked, request, on_request_only, is_commanded) == asked:
            notes[w, MOVE] = move_m
            notes[w, MANEUVER] = move_m
            return wanted | check_blocking(worlds, loop, w, i, side, 0.0, False)
        move_m = 0.0
    return align(worlds, loop, w, i, side, state, request, move_m, stays)


@compiled
def ask_for_room(worlds: Worlds, loop: Loop, w: int, i: int, side: int) -> int:
    """Ask the vehicles in the way of a requested lane change for room; return what blocks it."""
    notes, near = worlds.notes, worlds.near
    notes[w, MANEUVER] = notes[w, MOVE]
    blocked = check_blocking(worlds, loop, w, i, side, LATERAL_GAP_M, False)
    blockers = near[w, BLOCKERS]
    seconds = (worlds.request_end[w, i] - worlds.step[w]) * STEP_S
    planned = worlds.speed_m_s[w, i]
    for bit, d in ((1, 0), (4, side)):
        if blockers & bit:
            j, gap_m = near[w, LEADER + 1 + d], notes[w, LEADER_GAP + 1 + d]
            planned = min(
                planned, inform_leader(worlds, loop, w, i, side, blocked, j, gap_m, seconds)
            )
    if planned >= 0:
        for bit, d in ((2, 0), (8, side)):
            if blockers & bit:
                j, gap_m = near[w, FOLLOWER + 1 + d], notes[w, FOLLOWER_GAP + 1 + d]
                inform_follower(worlds, loop, w, i, side, blocked, j, gap_m, seconds, planned)
    return blocked


@compiled
def align(
    worlds: Worlds,
    loop: Loop,
    w: int,
    i: int,
    side: int,
    state: int,
    request: int,
    move_m: float,
    stays: float,
) -> int:
    """Return the state of a vehicle that wants no other lane and so moves to its lane's centre."""
    notes, aside_m = worlds.notes, worlds.aside_m[w, i]
    back_m = -aside_m
    if not (abs(move_m) <= TINY_M or back_m * move_m > 0):
        return state
    if (
        (back_m < 0 and worlds.gain_right[w, i] < LOSS)
        or (back_m > 0 and worlds.gain_left[w, i] < LOSS)
        or speed_gain_of(worlds, loop, w, i, back_m, stays) < -1.0
    ):
        back_m = 0.0
    maneuver_m = worlds.maneuver_m[w, i]
    unfinished = worlds.previous_state[w, i] & FULL_REASONS and not worlds.is_full[w, i]
    if unfinished and maneuver_m * back_m < 0:
        back_m = 0.0
    if abs(back_m) < TINY_M:
        return state | SUBLANE | STAY
    wanted = state | SUBLANE
    if maneuver_m * back_m > 0:
        wanted |= worlds.previous_state[w, i] & REASONS & ~SUBLANE
    asked = wanted | signed(wanted, back_m)
    is_commanded = worlds.commanded_m[w, i] != 0
    if influenced(asked, request, worlds.on_request_only[w, i], is_commanded) == asked:
        notes[w, MOVE] = back_m
        notes[w, MANEUVER] = back_m
        return wanted | check_blocking(worlds, loop, w, i, side, LATERAL_GAP_M, False)
    return wanted & ~SUBLANE


@compiled
def keep_lateral_gap(worlds: Worlds, loop: Loop, w: int, i: int, side: int, state: int) -> int:
    """Return the state after keeping a lateral gap to vehicles beside, and a begun request."""
    notes, near, own = worlds.notes, worlds.near, worlds.lane[w, i]
    blocked = state & (BLOCKED | OVERLAPPING)
    state &= ~(BLOCKED | OVERLAPPING)
    half_m = (worlds.width_m[w, i] + EPS) * 0.5
    center = center_m(worlds, loop, w, i)
    right, left = center - half_m, loop.lanes * loop.lane_m - center - half_m
    kept_m = 0.0 if right < 0 or left < 0 else LATERAL_GAP_M
    net_m = -worlds.length_m[w, i] * 0.5
    for d in (0, side):
        j, gap_m = near[w, LEADER + 1 + d], notes[w, LEADER_GAP + 1 + d]
        right, left = update_gaps(
            worlds, loop, w, i, own + d, j, gap_m, right, left, kept_m, True, 0.0
        )
        j, gap_m = near[w, FOLLOWER + 1 + d], notes[w, FOLLOWER_GAP + 1 + d]
        right, left = update_gaps(
            worlds, loop, w, i, own + d, j, gap_m, right, left, kept_m, True, net_m
        )
        if side == 0:
            break
    body_right = right if notes[w, LAST_RIGHT] == math.inf else notes[w, LAST_RIGHT]
    body_left = left if notes[w, LAST_LEFT] == math.inf else notes[w, LAST_LEFT]
    aside_m, half_lane_m = worlds.aside_m[w, i], 0.5 * loop.lane_m
    if side >= 0:
        right = min(right, max(0.0, half_lane_m + aside_m - half_m))
        body_right = min(body_right, max(0.0, half_lane_m + aside_m - half_m))
    if side <= 0:
        left = min(left, max(0.0, half_lane_m - aside_m - half_m))
        body_left = min(body_left, max(0.0, half_lane_m - aside_m - half_m))
    before_m = notes[w, MOVE]
    if right + left < 0:
        if not state & REASONS:
            state |= SUBLANE
        short = 0.5 * (left + right)
        if right < left:
            notes[w, MOVE] = min(short - right, body_left)
        else:
            notes[w, MOVE] = -min(short - left, body_right)
        notes[w, MANEUVER] = notes[w, MOVE]
    else:
        notes[w, MOVE] = max(min(before_m, left), -right)
        notes[w, MANEUVER] = max(min(notes[w, MANEUVER], left), -right)
    if worlds.commanded_m[w, i] != 0:
        notes[w, MOVE] = worlds.commanded_m[w, i]
        notes[w, MANEUVER] = worlds.commanded_m[w, i]
        state |= REQUESTED
    move_m = notes[w, MOVE]
    full = state & FULL_REASONS != 0
    if full and not state & REQUESTED:
        if move_m < TINY_M and before_m > 0:
            notes[w, MOVE] = before_m
            blocked = OVERLAPPING | BLOCKED_LEFT
        elif move_m > -TINY_M and before_m < 0:
            notes[w, MOVE] = before_m
            blocked = OVERLAPPING | BLOCKED_RIGHT
    move_m = notes[w, MOVE]
    if abs(move_m) > TINY_M and before_m == 0:
        state &= ~(REASONS | STAY) | REQUESTED
    if abs(move_m - before_m) > TINY_M:
        blocked = check_blocking(worlds, loop, w, i, side, LATERAL_GAP_M, full)
        move_m = notes[w, MOVE]
    if abs(move_m) > TINY_M:
        state &= ~STAY
        if not state & REASONS:
            state |= SUBLANE
    else:
        if state & SUBLANE:
            state |= STAY
        notes[w, MOVE] = 0.0
    return state | blocked


@compiled
def limit_move(worlds: Worlds, w: int, i: int) -> None:
    """Limit the move in ``notes`` to one step, and its maneuver to the lateral room."""
    notes = worlds.notes
    move_m, maneuver_m = notes[w, MOVE], notes[w, MANEUVER]
    if move_m > 0:
        full_m = min(notes[w, SAFE_LEFT], max(maneuver_m, move_m))
    else:
        full_m = max(-notes[w, SAFE_RIGHT], min(maneuver_m, move_m))
    if maneuver_m * move_m > 0 and worlds.commanded_m[w, i] == 0:
        notes[w, MANEUVER] = full_m
    notes[w, MOVE] = max(min(move_m, STRIDE_M), -STRIDE_M)
