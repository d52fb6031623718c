"""The lane that a driver of SUMO's SL2015 chooses in one step, and the lateral move that it makes."""

import math

from drl_av.compiled import compiled
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
    LEFT,
    OVERLAPPING,
    REASONS,
    REQUESTED,
    RIGHT,
    SPEED_GAIN,
    STAY,
    SUBLANE,
    URGENT,
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
    MANEUVER,
    MOVE,
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
from drl_av.twin.neighbors import reach_m
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ACCELERATION_NOW_M_S2,
    ASIDE_M,
    COMMANDED_M,
    COUNT,
    DESIRED_M_S,
    EXPECTED_M_S,
    FRONT_M,
    GAIN_LEFT,
    GAIN_RIGHT,
    HEADWAY_S,
    IS_FULL,
    LANE,
    LENGTH_M,
    MANEUVER_M,
    MASK,
    ON_REQUEST_ONLY,
    ORDER,
    PREVIOUS_STATE,
    REQUEST_END,
    SPEED_M_S,
    STATE,
    STEP,
    THRESHOLD_LEFT,
    THRESHOLD_RIGHT,
    TRACKED,
    TRACKED_LEFT,
    WIDTH_M,
    Loop,
    World,
)

GAIN_SEEN = 0.05
SLOW_M_S = 10.0
LOSS = -0.1
LOOKAHEAD_S = 5.0
LONGEST_M = 25.0
TRACK_STEPS = 4
"""Steps between two updates of expected speeds that do not matter now."""


@compiled
def is_open(loop: Loop, lane: int) -> bool:
    """Return whether the lane exists and is open."""
    return loop.first_open <= lane <= loop.last_open


@compiled
def look_around(world: World, loop: Loop, k: int) -> None:
    """Find the vehicles ahead of the ``k``-th one in all lanes, and what speed each lane promises.

    The leaders in the right, own and left lane go to ``near`` and their net gaps to ``notes``.
    """
    x, z, n = world.x, world.z, world.near[COUNT]
    i = z[ORDER, k]
    at_m, own = x[FRONT_M, i], z[LANE, i]
    pos_m = at_m - math.floor(at_m / loop.edge_m) * loop.edge_m
    seen_m = reach_m(loop.edge_m - pos_m, x[SPEED_M_S, i], x[HEADWAY_S, i], loop.edge_m)
    for d in range(3):
        world.near[LEADER + d] = -1
    todo = ((1 << (loop.last_open + 1)) - 1) & ~((1 << loop.first_open) - 1)
    m, wrapped_m = k, 0.0
    for _ in range(n - 1):
        m -= 1
        if m < 0:
            m, wrapped_m = n - 1, loop.lap_m
        j = z[ORDER, m]
        found = z[MASK, j] & todo
        if not found:
            continue
        behind_m = x[FRONT_M, j] - at_m + wrapped_m - x[LENGTH_M, j]
        if behind_m >= seen_m:
            if behind_m >= seen_m + LONGEST_M:
                break
            continue
        todo &= ~found
        gap_m = behind_m - MIN_GAP_M
        promised = promised_speed(world, i, j, gap_m)
        for lane in range(loop.first_open, loop.last_open + 1):
            if found & (1 << lane):
                if abs(lane - own) <= 1:
                    world.near[LEADER + 1 + lane - own] = j
                    world.notes[LEADER_GAP + 1 + lane - own] = gap_m
                expect(world, i, lane, promised)
        if not todo:
            break
    if todo:
        promised = promised_speed(world, i, -1, ROUTE_M - pos_m)
        for lane in range(loop.first_open, loop.last_open + 1):
            if todo & (1 << lane):
                expect(world, i, lane, promised)


@compiled
def promised_speed(world: World, i: int, j: int, gap_m: float) -> float:
    """Return the speed that a lane promises to the vehicle ``i``, with ``j`` ahead in it or -1."""
    x = world.x
    desired, headway_s, acceleration = x[DESIRED_M_S, i], x[HEADWAY_S, i], x[ACCELERATION_M_S2, i]
    if j < 0:
        return min(desired, follow_speed(desired, gap_m, 0.0, desired, headway_s, acceleration))
    most = 2.0 if j == 0 else x[ACCELERATION_M_S2, j]
    if x[ACCELERATION_NOW_M_S2, j] > 0.5 * most:
        return min(desired, x[DESIRED_M_S, j])
    its = x[SPEED_M_S, j]
    promised = follow_speed(desired, gap_m, its, desired, headway_s, acceleration)
    faster = desired - its
    if faster > 0 and gap_m < LOOKAHEAD_S * faster:
        closing_s = max(0.0, gap_m / faster)
        promised = closing_s * promised + (2 * LOOKAHEAD_S - closing_s) * its
        promised /= 2 * LOOKAHEAD_S
    return min(desired, promised)


@compiled
def expect(world: World, i: int, lane: int, promised: float) -> None:
    """Adapt the expected speed of a lane to the promised one, over the steps since the last time."""
    last = world.z[TRACKED if lane <= world.z[LANE, i] else TRACKED_LEFT, i]
    steps = world.near[STEP] - last
    old_part = DECAY if steps == 1 else DECAY**steps
    expected = world.x[EXPECTED_M_S + lane, i]
    world.x[EXPECTED_M_S + lane, i] = old_part * expected + (1 - old_part) * promised


@compiled
def track(world: World, loop: Loop, k: int) -> None:
    """Bring the expected speeds up to date, and the gain of a driver that changes for no speed.

    SL2015 moves a vehicle back to the centre of its lane only if that side is not the slower one.
    """
    look_around(world, loop, k)
    x, z = world.x, world.z
    i = z[ORDER, k]
    own, steps = z[LANE, i], world.near[STEP] - z[TRACKED_LEFT, i]
    z[TRACKED, i], z[TRACKED_LEFT, i] = world.near[STEP], world.near[STEP]
    if own == loop.last_open:
        checks = 2 if own > loop.first_open else 1
        x[GAIN_LEFT, i] *= DECAY ** (checks * steps)
        return
    gain = -math.inf
    for lane in range(own + 1, loop.lanes):
        its = x[EXPECTED_M_S + lane, i]
        gain = max(gain, (its - x[EXPECTED_M_S + own, i]) / max(its, SLOW_M_S))
    if abs(gain) < EPS:
        x[GAIN_LEFT, i] *= DECAY**steps
    else:
        x[GAIN_LEFT, i] += STEP_S * steps * gain


@compiled
def needs_thought(world: World, loop: Loop, k: int) -> bool:
    """Return whether the ``k``-th vehicle may move sideways now; if not, do what else it does.

    This holds for a vehicle at the centre of its lane that nobody asks for room and that changes
    lanes for no speed: it may still keep behind a vehicle on its left, and once it has braked for
    such a vehicle, SL2015 lets it change to the right as soon as that is faster.
    """
    x, z = world.x, world.z
    i = z[ORDER, k]
    if x[ASIDE_M, i] != 0.0 or x[COMMANDED_M, i] != 0.0 or z[STATE, i] & ASKED:
        return True
    if z[REQUEST_END, i] >= world.near[STEP] or x[THRESHOLD_LEFT, i] != math.inf:
        return True
    if (world.near[STEP] + i) % TRACK_STEPS == 0:
        track(world, loop, k)
    own, speed = z[LANE, i], x[SPEED_M_S, i]
    follows = own < loop.last_open and speed >= CONGESTED_M_S and not loop.overtake_right
    tracks = own > loop.first_open and x[GAIN_RIGHT, i] == math.inf
    is_new = tracks and z[TRACKED, i] < world.near[STEP]
    if not follows and not tracks:
        return False
    at_m, n = x[FRONT_M, i], world.near[COUNT]
    pos_m = at_m - math.floor(at_m / loop.edge_m) * loop.edge_m
    seen_m = reach_m(loop.edge_m - pos_m, speed, x[HEADWAY_S, i], loop.edge_m)
    todo = 2 << own if follows else 0
    if tracks:
        todo |= ((2 << own) - 1) & ~((1 << loop.first_open) - 1)
    m, wrapped_m = k, 0.0
    for _ in range(n - 1):
        m -= 1
        if m < 0:
            m, wrapped_m = n - 1, loop.lap_m
        j = z[ORDER, m]
        found = z[MASK, j] & todo
        if not found:
            continue
        behind_m = x[FRONT_M, j] - at_m + wrapped_m - x[LENGTH_M, j]
        if behind_m >= seen_m:
            if behind_m >= seen_m + LONGEST_M:
                break
            continue
        todo &= ~found
        gap_m = behind_m - MIN_GAP_M
        if found & (2 << own):
            keep_behind(world, loop, i, j, gap_m)
            found &= ~(2 << own)
        if found and is_new:
            promised = promised_speed(world, i, j, gap_m)
            for lane in range(loop.first_open, own + 1):
                if found & (1 << lane):
                    expect(world, i, lane, promised)
        if not todo:
            break
    if not tracks:
        return False
    todo &= (2 << own) - 1
    if todo and is_new:
        promised = promised_speed(world, i, -1, ROUTE_M - pos_m)
        for lane in range(loop.first_open, own + 1):
            if todo & (1 << lane):
                expect(world, i, lane, promised)
    z[TRACKED, i] = world.near[STEP]
    for lane in range(loop.first_open, own):
        its = x[EXPECTED_M_S + lane, i]
        if its - x[EXPECTED_M_S + own, i] > GAIN_SEEN * max(its, SLOW_M_S):
            return True
    return False


@compiled
def keep_behind(world: World, loop: Loop, i: int, j: int, gap_m: float) -> None:
    """Advise a driver not to pass the vehicle ``j`` ahead in the left lane on its right."""
    x = world.x
    speed, its = x[SPEED_M_S, i], x[SPEED_M_S, j]
    if its < speed or x[DESIRED_M_S, j] < x[DESIRED_M_S, i]:
        safe = its_follow_speed(world, i, gap_m, its)
        if safe < speed - MOST_BRAKING_M_S:
            safe = max(speed - MOST_BRAKING_M_S, its - HELP_M_S)
        advise(world, i, safe)
        if safe < speed:
            x[GAIN_RIGHT, i] += STEP_S * x[THRESHOLD_LEFT, i] / 3


@compiled
def weigh_gains(world: World, loop: Loop, i: int, side: int, sides: int) -> tuple[float, float]:
    """Update the gains of speed to each side; return the best lateral move, and the own speed.

    ``sides`` holds the flags of the sides that are open to the vehicle.
    """
    lane_m, own = loop.lane_m, world.z[LANE, i]
    width_m = world.x[WIDTH_M, i] + EPS
    right = center_m(world, loop, i) - 0.5 * width_m
    left = right + width_m
    high = loop.lanes - 1
    while high > 0 and high * lane_m > left:
        high -= 1
    low = high
    stays = math.inf
    while low > 0 and low * lane_m > right + EPS:
        stays = min(stays, world.x[EXPECTED_M_S + low, i])
        low -= 1
    stays = min(stays, world.x[EXPECTED_M_S + low, i])
    end_left = (max(own, own + side) + 1) * lane_m - left
    end_right = min(own, own + side) * lane_m - right
    best, best_right, best_left, move_m = -math.inf, -math.inf, -math.inf, 0.0
    first, last = 0 if side < 0 else own, loop.lanes - 1 if side > 0 else own
    for lane in range(first, last + 1):
        at = lane * lane_m
        its = world.x[EXPECTED_M_S + lane, i]
        gain = (its - stays) / max(its, SLOW_M_S)
        shift = min(max(at - right, end_right), end_left)
        if gain > best:
            best = gain
            if best > GAIN_SEEN:
                move_m = shift
        elif (
            shift > 0
            and world.x[GAIN_LEFT, i] > world.x[GAIN_RIGHT, i]
            and gain > GAIN_SEEN
            and best - gain < EPS
        ):
            move_m = shift
        if shift < -TINY_M:
            best_right = max(best_right, gain)
        elif shift > TINY_M:
            best_left = max(best_left, gain)
    if best_right != -math.inf:
        world.x[GAIN_RIGHT, i] += STEP_S * best_right
    if best_left != -math.inf:
        world.x[GAIN_LEFT, i] += STEP_S * best_left
    if (abs(best_right) < EPS or best_right == -math.inf) and (side < 0 or not sides & RIGHT):
        world.x[GAIN_RIGHT, i] *= DECAY
    if (abs(best_left) < EPS or best_left == -math.inf) and (side > 0 or not sides & LEFT):
        world.x[GAIN_LEFT, i] *= DECAY
    return move_m, stays


@compiled
def speed_gain_of(world: World, loop: Loop, i: int, move_m: float, stays: float) -> float:
    """Return the expected change of the speed after a lateral move."""
    result = math.inf
    width_m = world.x[WIDTH_M, i] + EPS
    right = center_m(world, loop, i) - 0.5 * width_m + move_m
    for lane in range(loop.lanes):
        if overlaps(right, right + width_m, lane * loop.lane_m, (lane + 1) * loop.lane_m):
            result = min(result, world.x[EXPECTED_M_S + lane, i])
    return result - stays


@compiled
def wish(world: World, loop: Loop, i: int, side: int, sides: int) -> int:
    """Return the state after considering a side; the move and maneuver go to ``notes``."""
    notes, near = world.notes, world.near
    notes[MOVE] = 0.0
    notes[MANEUVER] = 0.0
    state = world.z[STATE, i] & ASKED
    width_m, aside_m, own = world.x[WIDTH_M, i], world.x[ASIDE_M, i], world.z[LANE, i]
    request, on_request_only = request_of(world, loop, i), world.z[ON_REQUEST_ONLY, i]
    is_commanded = world.x[COMMANDED_M, i] != 0
    across_m = 0.0
    if side != 0:
        across_m = lane_side_distance(width_m, aside_m, side, loop.lane_m)
        ahead = near[LEADER + 2]
        fast = world.x[SPEED_M_S, i] >= CONGESTED_M_S
        if side > 0 and ahead >= 0 and fast and not loop.overtake_right:
            keep_behind(world, loop, i, ahead, notes[LEADER_GAP + 2])
        if request != 0:
            asked = influenced(state, request, on_request_only, is_commanded)
            if asked & STAY:
                state = asked
            elif request == side:
                state = asked
                notes[MOVE] = across_m
    if state & STAY:
        right, left = notes[SAFE_RIGHT], notes[SAFE_LEFT]
        other = own + side
        j, gap_m = near[LEADER + 1 + side], notes[LEADER_GAP + 1 + side]
        right, left = update_gaps(
            world, loop, i, other, j, gap_m, right, left, LATERAL_GAP_M, False, 0.0
        )
        j, gap_m = near[FOLLOWER + 1 + side], notes[FOLLOWER_GAP + 1 + side]
        right, left = update_gaps(
            world, loop, i, other, j, gap_m, right, left, LATERAL_GAP_M, False, 0.0
        )
        notes[SAFE_RIGHT], notes[SAFE_LEFT] = right, left
        return state
    if state & URGENT:
        return state | ask_for_room(world, loop, i, side)
    mine = ASKED_BY_RIGHTWARD if side < 0 else ASKED_BY_LEFTWARD
    if side != 0:
        helps = world.z[STATE, i] & IS_BLOCKING_FOLLOWER
        goes_on = (
            world.z[PREVIOUS_STATE, i] & COOPERATIVE
            and not world.z[IS_FULL, i]
            and side * world.x[MANEUVER_M, i] > 0
        )
        if (helps and world.z[STATE, i] & mine) or goes_on:
            wanted = state | COOPERATIVE | URGENT
            asked = wanted | signed(wanted, across_m)
            if influenced(asked, request, on_request_only, is_commanded) == asked:
                notes[MOVE] = across_m if helps else world.x[MANEUVER_M, i]
                notes[MANEUVER] = notes[MOVE]
                return wanted | check_blocking(world, loop, i, side, LATERAL_GAP_M, False)
    move_m, stays = weigh_gains(world, loop, i, side, sides)
    goes_right = side <= 0 and move_m < 0
    goes_right = goes_right and world.x[GAIN_RIGHT, i] >= max(
        world.x[THRESHOLD_RIGHT, i], world.x[GAIN_LEFT, i]
    )
    goes_left = side >= 0 and move_m > 0
    goes_left = goes_left and world.x[GAIN_LEFT, i] > world.x[THRESHOLD_LEFT, i]
    if goes_right or goes_left:
        wanted = state | SPEED_GAIN
        asked = wanted | signed(wanted, move_m)
        if influenced(asked, request, on_request_only, is_commanded) == asked:
            notes[MOVE] = move_m
            notes[MANEUVER] = move_m
            return wanted | check_blocking(world, loop, i, side, 0.0, False)
        move_m = 0.0
    return align(world, loop, i, side, state, request, move_m, stays)


@compiled
def ask_for_room(world: World, loop: Loop, i: int, side: int) -> int:
    """Ask the vehicles in the way of a requested lane change for room; return what blocks it."""
    notes, near = world.notes, world.near
    notes[MANEUVER] = notes[MOVE]
    blocked = check_blocking(world, loop, i, side, LATERAL_GAP_M, False)
    blockers = near[BLOCKERS]
    seconds = max((world.z[REQUEST_END, i] - world.near[STEP]) * STEP_S, 1e-300)
    planned = world.x[SPEED_M_S, i]
    for bit, d in ((1, 0), (4, side)):
        if blockers & bit:
            j, gap_m = near[LEADER + 1 + d], notes[LEADER_GAP + 1 + d]
            planned = min(planned, inform_leader(world, loop, i, side, blocked, j, gap_m, seconds))
    if planned >= 0:
        for bit, d in ((2, 0), (8, side)):
            if blockers & bit:
                j, gap_m = near[FOLLOWER + 1 + d], notes[FOLLOWER_GAP + 1 + d]
                inform_follower(world, loop, i, side, blocked, j, gap_m, seconds, planned)
    return blocked


@compiled
def align(
    world: World,
    loop: Loop,
    i: int,
    side: int,
    state: int,
    request: int,
    move_m: float,
    stays: float,
) -> int:
    """Return the state of a vehicle that wants no other lane and so moves to its lane's centre."""
    notes, aside_m = world.notes, world.x[ASIDE_M, i]
    back_m = -aside_m
    if not (abs(move_m) <= TINY_M or back_m * move_m > 0):
        return state
    if (
        (back_m < 0 and world.x[GAIN_RIGHT, i] < LOSS)
        or (back_m > 0 and world.x[GAIN_LEFT, i] < LOSS)
        or speed_gain_of(world, loop, i, back_m, stays) < -1.0
    ):
        back_m = 0.0
    maneuver_m = world.x[MANEUVER_M, i]
    unfinished = world.z[PREVIOUS_STATE, i] & FULL_REASONS and not world.z[IS_FULL, i]
    if unfinished and maneuver_m * back_m < 0:
        back_m = 0.0
    if abs(back_m) < TINY_M:
        return state | SUBLANE | STAY
    wanted = state | SUBLANE
    if maneuver_m * back_m > 0:
        wanted |= world.z[PREVIOUS_STATE, i] & REASONS & ~SUBLANE
    asked = wanted | signed(wanted, back_m)
    is_commanded = world.x[COMMANDED_M, i] != 0
    if influenced(asked, request, world.z[ON_REQUEST_ONLY, i], is_commanded) == asked:
        notes[MOVE] = back_m
        notes[MANEUVER] = back_m
        return wanted | check_blocking(world, loop, i, side, LATERAL_GAP_M, False)
    return wanted & ~SUBLANE


@compiled
def keep_lateral_gap(world: World, loop: Loop, i: int, side: int, state: int) -> int:
    """Return the state after keeping a lateral gap to vehicles beside, and a begun request."""
    notes, near, own = world.notes, world.near, world.z[LANE, i]
    blocked = state & (BLOCKED | OVERLAPPING)
    state &= ~(BLOCKED | OVERLAPPING)
    half_m = (world.x[WIDTH_M, i] + EPS) * 0.5
    center = center_m(world, loop, i)
    right, left = center - half_m, loop.lanes * loop.lane_m - center - half_m
    kept_m = 0.0 if right < 0 or left < 0 else LATERAL_GAP_M
    net_m = -world.x[LENGTH_M, i] * 0.5
    for d in (0, side):
        j, gap_m = near[LEADER + 1 + d], notes[LEADER_GAP + 1 + d]
        right, left = update_gaps(world, loop, i, own + d, j, gap_m, right, left, kept_m, True, 0.0)
        j, gap_m = near[FOLLOWER + 1 + d], notes[FOLLOWER_GAP + 1 + d]
        right, left = update_gaps(
            world, loop, i, own + d, j, gap_m, right, left, kept_m, True, net_m
        )
        if side == 0:
            break
    body_right = right if notes[LAST_RIGHT] == math.inf else notes[LAST_RIGHT]
    body_left = left if notes[LAST_LEFT] == math.inf else notes[LAST_LEFT]
    aside_m, half_lane_m = world.x[ASIDE_M, i], 0.5 * loop.lane_m
    if side >= 0:
        right = min(right, max(0.0, half_lane_m + aside_m - half_m))
        body_right = min(body_right, max(0.0, half_lane_m + aside_m - half_m))
    if side <= 0:
        left = min(left, max(0.0, half_lane_m - aside_m - half_m))
        body_left = min(body_left, max(0.0, half_lane_m - aside_m - half_m))
    before_m = notes[MOVE]
    if right + left < 0:
        if not state & REASONS:
            state |= SUBLANE
        short = 0.5 * (left + right)
        if right < left:
            notes[MOVE] = min(short - right, body_left)
        else:
            notes[MOVE] = -min(short - left, body_right)
        notes[MANEUVER] = notes[MOVE]
    else:
        notes[MOVE] = max(min(before_m, left), -right)
        notes[MANEUVER] = max(min(notes[MANEUVER], left), -right)
    if world.x[COMMANDED_M, i] != 0:
        notes[MOVE] = world.x[COMMANDED_M, i]
        notes[MANEUVER] = world.x[COMMANDED_M, i]
        state |= REQUESTED
    move_m = notes[MOVE]
    full = state & FULL_REASONS != 0
    if full and not state & REQUESTED:
        if move_m < TINY_M and before_m > 0:
            notes[MOVE] = before_m
            blocked = OVERLAPPING | BLOCKED_LEFT
        elif move_m > -TINY_M and before_m < 0:
            notes[MOVE] = before_m
            blocked = OVERLAPPING | BLOCKED_RIGHT
    move_m = notes[MOVE]
    if abs(move_m) > TINY_M and before_m == 0:
        state &= ~(REASONS | STAY) | REQUESTED
    if abs(move_m - before_m) > TINY_M:
        blocked = check_blocking(world, loop, i, side, LATERAL_GAP_M, full)
        move_m = notes[MOVE]
    if abs(move_m) > TINY_M:
        state &= ~STAY
        if not state & REASONS:
            state |= SUBLANE
    else:
        if state & SUBLANE:
            state |= STAY
        notes[MOVE] = 0.0
    return state | blocked


@compiled
def limit_move(world: World, i: int) -> None:
    """Limit the move in ``notes`` to one step, and its maneuver to the lateral room."""
    notes = world.notes
    move_m, maneuver_m = notes[MOVE], notes[MANEUVER]
    if move_m > 0:
        full_m = min(notes[SAFE_LEFT], max(maneuver_m, move_m))
    else:
        full_m = max(-notes[SAFE_RIGHT], min(maneuver_m, move_m))
    if maneuver_m * move_m > 0 and world.x[COMMANDED_M, i] == 0:
        notes[MANEUVER] = full_m
    notes[MOVE] = max(min(move_m, STRIDE_M), -STRIDE_M)
