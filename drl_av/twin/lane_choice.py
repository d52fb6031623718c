"""What a driver of SUMO's SL2015 wishes to do sideways when it considers one of its lanes.

Each consideration ends with a state (of ``worlds``), a lateral move for this step and the lateral
distance of the whole maneuver; the two are in ``notes``.
"""

import math

from drl_av.compiled import borrowing, inlined
from drl_av.twin.asking import inform_follower, inform_leader
from drl_av.twin.following import EPS, STEP_S
from drl_av.twin.lane_speeds import keep_behind, speed_gain_of, weigh_gains
from drl_av.twin.lateral_room import (
    BLOCKERS,
    FOLLOWER,
    HOLD,
    LAST_LEFT,
    LAST_RIGHT,
    LATERAL_GAP_M,
    LEADER,
    MANEUVER,
    MOVE,
    SAFE_LEFT,
    SAFE_RIGHT,
    STRIDE_M,
    TINY_M,
    center_m,
    check_blocking,
    influenced,
    lane_side_distance,
    request_of,
    signed,
    update_gaps,
)
from drl_av.twin.worlds import (
    ASIDE_M,
    ASKED,
    ASKED_BY_LEFTWARD,
    ASKED_BY_RIGHTWARD,
    BLOCKED,
    BLOCKED_LEFT,
    BLOCKED_RIGHT,
    COMMANDED_M,
    COOPERATIVE,
    EDGE,
    EDGE_ROUTE,
    FIRST_LANE,
    FULL_REASONS,
    GAIN_LEFT,
    GAIN_RIGHT,
    IS_BLOCKING_FOLLOWER,
    IS_FULL,
    LANE,
    LENGTH_M,
    MANEUVER_M,
    ON_REQUEST_ONLY,
    OVERLAPPING,
    PREVIOUS_STATE,
    REASONS,
    REQUEST_END,
    REQUESTED,
    RIGHT,
    SPEED_GAIN,
    SPEED_M_S,
    STATE,
    STAY,
    STEP,
    STRATEGIC,
    SUBLANE,
    THRESHOLD_LEFT,
    THRESHOLD_RIGHT,
    URGENT,
    WIDTH_M,
    Net,
    World,
)

LOSS, LASTING_S = -0.1, 20.0
COOPERATION = 1.0
"""SUMO's lcCooperative: the loss, in thresholds, up to which a driver changes lanes for another."""


@inlined
def wish(world: World, net: Net, i: int, side: int, sides: int) -> int:
    """Return the state after considering a side; the move and maneuver go to ``notes``."""
    notes = world.notes
    notes[MOVE] = 0.0
    notes[MANEUVER] = 0.0
    state = world.z[STATE, i] & ASKED
    width_m, aside_m, own = world.x[WIDTH_M, i], world.x[ASIDE_M, i], world.z[LANE, i]
    request, on_request_only = request_of(world, net, i), world.z[ON_REQUEST_ONLY, i]
    is_commanded = world.x[COMMANDED_M, i] != 0
    across_m = 0.0
    if side > 0:
        keep_behind(world, i)
    if side != 0:
        across_m = lane_side_distance(width_m, aside_m, side, net.lane_m)
        if own + side < net.first_open:
            state |= STAY | STRATEGIC
        if request != 0:
            asked = influenced(state, request, on_request_only, is_commanded)
            if asked & STAY:
                state = asked
            elif request == side:
                state = asked
                notes[MOVE] = across_m
    elif request == HOLD:
        state = influenced(state, request, on_request_only, is_commanded)
    if state & STAY:
        right, left = notes[SAFE_RIGHT], notes[SAFE_LEFT]
        kept_m = LATERAL_GAP_M
        for beside in (LEADER, FOLLOWER):
            right, left = update_gaps(world, net, i, side, beside, right, left, kept_m, False, 0.0)
        notes[SAFE_RIGHT], notes[SAFE_LEFT] = right, left
        return state
    if state & URGENT:
        seconds = max((world.z[REQUEST_END, i] - world.near[STEP]) * STEP_S, 1e-300)
        return state | ask_for_room(world, net, i, side, seconds)
    mine = ASKED_BY_RIGHTWARD if side < 0 else ASKED_BY_LEFTWARD
    if side != 0:
        helps = world.z[STATE, i] & IS_BLOCKING_FOLLOWER
        goes_on = (
            world.z[PREVIOUS_STATE, i] & COOPERATIVE
            and not world.z[IS_FULL, i]
            and side * world.x[MANEUVER_M, i] > 0
        )
        gain = world.x[GAIN_RIGHT if side < 0 else GAIN_LEFT, i]
        is_easy = -gain < COOPERATION * world.x[THRESHOLD_RIGHT if side < 0 else THRESHOLD_LEFT, i]
        if is_easy and ((helps and world.z[STATE, i] & mine) or goes_on):
            wanted = state | COOPERATIVE | URGENT
            asked = wanted | signed(wanted, across_m)
            if influenced(asked, request, on_request_only, is_commanded) == asked:
                notes[MOVE] = across_m if helps else world.x[MANEUVER_M, i]
                notes[MANEUVER] = notes[MOVE]
                return wanted | check_blocking(world, net, i, side, LATERAL_GAP_M, False)
    move_m, stays = weigh_gains(world, net, i, side, sides)
    if gains_enough(world, net, i, side, move_m):
        wanted = state | SPEED_GAIN
        asked = wanted | signed(wanted, move_m)
        if influenced(asked, request, on_request_only, is_commanded) == asked:
            return go_for_speed(world, net, i, side, state, move_m)
        move_m = 0.0
    return align(world, net, i, side, state, request, move_m, stays)


@inlined
def gains_enough(world: World, net: Net, i: int, side: int, move_m: float) -> bool:
    """Return whether the gain of speed by the lateral move of ``weigh_gains`` makes a driver go.

    It leaves its lane for speed only if SUMO regards ``LASTING_S`` of the route ahead.
    """
    x = world.x
    lasts = net.edges_m[EDGE_ROUTE, world.z[EDGE, i]] > LASTING_S * x[SPEED_M_S, i]
    if side <= 0 and move_m < 0:
        return bool(x[GAIN_RIGHT, i] >= x[THRESHOLD_RIGHT, i] and lasts)
    stays = x[ASIDE_M, i] + move_m < 0.5 * net.lane_m
    gains = side >= 0 and move_m > 0 and x[GAIN_LEFT, i] > x[THRESHOLD_LEFT, i]
    return bool(gains and (stays or lasts))


@inlined
def go_for_speed(world: World, net: Net, i: int, side: int, state: int, move_m: float) -> int:
    """Return the state of a driver that makes a move for speed, with what blocks it."""
    world.notes[MOVE] = move_m
    world.notes[MANEUVER] = move_m
    return state | SPEED_GAIN | check_blocking(world, net, i, side, 0.0, False)


@inlined
def is_at_ease(world: World, net: Net, i: int, sides: int) -> bool:
    """Return whether a vehicle at its lane's centre could leave it for a gain of speed only.

    Nothing is requested of it, no driver asks it for room, and those beside it leave it enough.
    """
    x, z, own = world.x, world.z, world.z[LANE, i]
    if x[ASIDE_M, i] >= TINY_M or x[ASIDE_M, i] <= -TINY_M or z[STATE, i] & ASKED:
        return False
    if x[COMMANDED_M, i] != 0 or x[MANEUVER_M, i] != 0 or z[REQUEST_END, i] >= world.near[STEP]:
        return False
    if own < net.edge_lanes[FIRST_LANE, z[EDGE, i]] or (sides & RIGHT and own <= net.first_open):
        return False
    half_m = 0.5 * (x[WIDTH_M, i] + EPS)
    return bool(0.5 * net.lane_m - TINY_M - half_m - 2 * EPS >= LATERAL_GAP_M)


@inlined
def move_for_speed(world: World, net: Net, i: int, side: int, sides: int) -> float:
    """Return the lateral move to a side by which a vehicle at ease gains enough, 0 without one."""
    if side > 0:
        keep_behind(world, i)
    move_m, _ = weigh_gains(world, net, i, side, sides)
    goes = not world.z[ON_REQUEST_ONLY, i] and gains_enough(world, net, i, side, move_m)
    return move_m if goes else 0.0


@borrowing
def ask_for_room(world: World, net: Net, i: int, side: int, seconds: float) -> int:
    """Ask the vehicles in the way of the move in ``notes`` for room; return what blocks it.

    ``seconds`` are left for the lane change.
    """
    notes, near = world.notes, world.near
    notes[MANEUVER] = notes[MOVE]
    blocked = check_blocking(world, net, i, side, LATERAL_GAP_M, False)
    blockers = near[BLOCKERS]
    planned = world.x[SPEED_M_S, i]
    for bit, d in ((1, 0), (4, side)):
        if blockers & bit:
            j, gap_m = near[LEADER + 1 + d], notes[LEADER + 1 + d]
            planned = min(planned, inform_leader(world, i, side, blocked, j, gap_m, seconds))
    if planned >= 0:
        for bit, d in ((2, 0), (8, side)):
            if blockers & bit:
                j, gap_m = near[FOLLOWER + 1 + d], notes[FOLLOWER + 1 + d]
                inform_follower(world, i, side, blocked, j, gap_m, seconds, planned)
    return blocked


@inlined
def align(
    world: World, net: Net, i: int, side: int, state: int, request: int, move_m: float, stays: float
) -> int:
    """Return the state of a vehicle that wants no other lane and so moves to its lane's centre."""
    notes, aside_m = world.notes, world.x[ASIDE_M, i]
    back_m = -aside_m
    if not (abs(move_m) <= TINY_M or back_m * move_m > 0):
        return state
    if (
        (back_m < 0 and world.x[GAIN_RIGHT, i] < LOSS)
        or (back_m > 0 and world.x[GAIN_LEFT, i] < LOSS)
        or speed_gain_of(world, net, i, back_m, stays) < -1.0
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
        return wanted | check_blocking(world, net, i, side, LATERAL_GAP_M, False)
    return wanted & ~SUBLANE


@inlined
def keep_lateral_gap(world: World, net: Net, i: int, side: int, state: int) -> int:
    """Return the state after keeping a lateral gap to vehicles beside, and a begun request."""
    notes = world.notes
    blocked = state & (BLOCKED | OVERLAPPING)
    state &= ~(BLOCKED | OVERLAPPING)
    half_m = (world.x[WIDTH_M, i] + EPS) * 0.5
    center = center_m(world, net, i)
    right = center - half_m - net.edge_lanes[FIRST_LANE, world.z[EDGE, i]] * net.lane_m
    left = net.lanes * net.lane_m - center - half_m
    stays = side == 0 or state & (STAY | STRATEGIC) == STAY | STRATEGIC
    kept_m = 0.0 if right < 0 or left < 0 else LATERAL_GAP_M
    net_m = -world.x[LENGTH_M, i] * 0.5
    for d in (0, side):
        right, left = update_gaps(world, net, i, d, LEADER, right, left, kept_m, True, 0.0)
        right, left = update_gaps(world, net, i, d, FOLLOWER, right, left, kept_m, True, net_m)
        if side == 0:
            break
    body_right = right if notes[LAST_RIGHT] == math.inf else notes[LAST_RIGHT]
    body_left = left if notes[LAST_LEFT] == math.inf else notes[LAST_LEFT]
    aside_m, half_lane_m = world.x[ASIDE_M, i], 0.5 * net.lane_m
    if stays or side > 0:
        right = min(right, max(0.0, half_lane_m + aside_m - half_m))
        body_right = min(body_right, max(0.0, half_lane_m + aside_m - half_m))
    if stays or side < 0:
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
        blocked = check_blocking(world, net, i, side, LATERAL_GAP_M, full)
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


@inlined
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
