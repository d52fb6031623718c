"""The lane changes of all vehicles of a world in one SUMO step, one vehicle after the other."""

import math

from drl_av.compiled import borrowing, inlined
from drl_av.road.road import RoadNumbers, is_beside, mandatory_change
from drl_av.twin.following import EPS, MIN_GAP_M, STEP_S
from drl_av.twin.lane_choice import (
    ask_for_room,
    go_for_speed,
    is_at_ease,
    keep_lateral_gap,
    limit_move,
    move_for_speed,
    wish,
)
from drl_av.twin.lane_speeds import DECAY, is_open, is_seen, look_around, needs_thought, weigh_gains
from drl_av.twin.lateral_room import (
    FOLLOWER,
    LAST_LEFT,
    LAST_RIGHT,
    LEFT_SPACE,
    MANEUVER,
    MOVE,
    RELATED_COUNT,
    SAFE_LEFT,
    SAFE_RIGHT,
    center_m,
    influenced,
    lane_side_distance,
    request_of,
    signed,
)
from drl_av.twin.neighbors import follower, link, shadow_lane
from drl_av.twin.worlds import (
    ACTIVE,
    ACTIVE_COUNT,
    ADVICE_M_S,
    ASIDE_M,
    BLOCKED,
    BY_RANK,
    COMMANDED_M,
    COOPERATIVE,
    COUNT,
    EDGE,
    EDGE_BEGIN,
    EDGE_ROUTE,
    FIRST_LANE,
    FIRST_ON,
    FRONT_M,
    GAIN_LEFT,
    GAIN_RIGHT,
    HAS_CHANGED,
    IS_FULL,
    KEEP_RIGHT,
    LANE,
    LATERAL_SPEED_M_S,
    LEFT,
    LENGTH_M,
    LOOK_AHEAD_M_S,
    MANEUVER_M,
    MASK,
    ON_REQUEST_ONLY,
    ORDER,
    PREVIOUS_STATE,
    REQUESTED,
    RESERVED,
    RIGHT,
    SHADOW,
    SPEED_GAIN,
    SPEED_M_S,
    STATE,
    STAY,
    STRATEGIC,
    SUBLANE,
    WANTS,
    WIDTH_M,
    Net,
    World,
    activate,
    strips_with_vehicles,
)

LOOK_AHEAD_S, URGENCY = 10.0, 2.0
"""SUMO's SL2015: how far ahead, in seconds, a mandatory lane change to the right is urgent, twice
as far to the left; and the factor by which it is to end earlier than it must."""


@inlined
def change_lanes(world: World, net: Net, road: RoadNumbers, ego_y_m: float) -> None:
    """Let the vehicles change lanes one after the other: edge by edge, on each the foremost first.

    A driver knows the lane changes of those before it.
    """
    n, done, near, z = world.near[COUNT], 0, world.near, world.z
    near[HAS_CHANGED] = 0
    for k in range(n - 1, -1, -1):
        near[FIRST_ON + z[EDGE, z[ORDER, k]]] = k
    for m in range(near[ACTIVE_COUNT]):
        edge = net.edge_lanes[BY_RANK, near[ACTIVE + m] // net.lanes]
        if done & (1 << edge):
            continue
        done |= 1 << edge
        for k in range(near[FIRST_ON + edge], n):
            i = z[ORDER, k]
            if z[EDGE, i] < edge:
                break
            if i == 0:
                if not net.is_loop:
                    ask_for_ego(world, net, road, k, ego_y_m)
                was_m = z[LANE, 0] * net.lane_m + world.x[ASIDE_M, 0]
                shift(world, net, 0, ego_y_m - was_m)
                continue
            look_around(world, net, k, DECAY)
            if needs_thought(world, net, k):
                change_lane(world, net, k)
            elif z[PREVIOUS_STATE, i] != SUBLANE | STAY:
                settle(world, i)
    if near[HAS_CHANGED]:
        activate(world, strips_with_vehicles(world, net))


@borrowing
def shift(world: World, net: Net, i: int, move_m: float) -> bool:
    """Move a vehicle sideways; return whether its centre has entered another lane."""
    lane, aside_m = world.z[LANE, i], world.x[ASIDE_M, i] + move_m
    world.x[LATERAL_SPEED_M_S, i] = move_m / STEP_S
    entered = False
    if abs(aside_m) > 0.5 * net.lane_m:
        side = -1 if aside_m < 0 else 1
        if i == 0 or is_open(net, lane + side):
            aside_m -= side * net.lane_m
            lane += side
            entered = True
            world.near[HAS_CHANGED] = 1
    world.z[LANE, i], world.x[ASIDE_M, i] = lane, aside_m
    other = shadow_lane(aside_m, world.x[WIDTH_M, i], lane, net)
    world.z[SHADOW, i] = other
    mask = 1 << lane | (1 << other if other >= 0 else 0)
    if mask != world.z[MASK, i]:
        world.z[MASK, i] = mask
        link(world, net)
    return entered


@inlined
def settle(world: World, i: int) -> None:
    """Note that a vehicle stays at the centre of its lane."""
    world.z[STATE, i] = SUBLANE | STAY
    world.z[PREVIOUS_STATE, i] = SUBLANE | STAY
    world.z[IS_FULL, i] = 1
    world.z[RESERVED, i] = -1
    world.x[MANEUVER_M, i] = 0.0
    world.x[LATERAL_SPEED_M_S, i] = 0.0


@inlined
def change_lane(world: World, net: Net, k: int) -> None:
    """Let the ``k``-th vehicle, which has looked around, decide on its lane; move it sideways."""
    i = world.z[ORDER, k]
    notes, own, edge = world.notes, world.z[LANE, i], world.z[EDGE, i]
    sides = RIGHT if is_seen(net, edge, own - 1) else 0
    sides |= LEFT if is_seen(net, edge, own + 1) else 0
    eases = is_at_ease(world, net, i, sides)
    to_right_m, to_left_m = 0.0, 0.0
    if eases:
        to_right_m = move_for_speed(world, net, i, -1, sides) if sides & RIGHT else 0.0
        to_left_m = move_for_speed(world, net, i, 1, sides) if sides & LEFT else 0.0
        weigh_gains(world, net, i, 0, sides)
        if to_right_m == 0.0 and to_left_m == 0.0:
            settle(world, i)
            return
    look_behind(world, net, k)
    pos_m = world.x[FRONT_M, i] - net.edges_m[EDGE_BEGIN, edge]
    notes[LEFT_SPACE] = net.edges_m[EDGE_ROUTE, edge] - pos_m
    right, right_m, right_all_m = 0, 0.0, 0.0
    if sides & RIGHT:
        right, right_m, right_all_m = considered(world, net, i, -1, sides, eases, to_right_m)
    left, left_m, left_all_m = 0, 0.0, 0.0
    if sides & LEFT:
        left, left_m, left_all_m = considered(world, net, i, 1, sides, eases, to_left_m)
    here, here_m, here_all_m = considered(world, net, i, 0, sides, eases, 0.0)
    state, move_m, all_m, side = right, right_m, right_all_m, -1
    if is_second((right, right_m, right_all_m), (left, left_m, left_all_m), -1, 1):
        state, move_m, all_m, side = left, left_m, left_all_m, 1
    if not is_second((here, here_m, here_all_m), (state, move_m, all_m), 0, side):
        state, move_m, all_m, side = here, here_m, here_all_m, 0
    world.z[STATE, i] = state
    world.z[PREVIOUS_STATE, i] = state
    if state & STAY:
        world.z[IS_FULL, i] = 1
    if not state & WANTS or state & BLOCKED:
        world.x[MANEUVER_M, i] = 0.0
        world.x[LATERAL_SPEED_M_S, i] = 0.0
        world.z[RESERVED, i] = -1
        return
    left_m = all_m - move_m
    world.x[MANEUVER_M, i] = 0.0 if abs(left_m) < EPS else left_m
    if shift(world, net, i, move_m) and world.z[IS_FULL, i]:
        world.z[STATE, i] = 0
        world.x[GAIN_LEFT, i] = 0.0
        world.x[GAIN_RIGHT, i] = 0.0
        world.x[ADVICE_M_S, i] = math.inf
    reserve(world, net, i)
    world.x[COMMANDED_M, i] = world.x[MANEUVER_M, i] if world.z[STATE, i] & REQUESTED else 0.0


@inlined
def look_behind(world: World, net: Net, k: int) -> None:
    """Note the vehicles behind the ``k``-th one, and the room beside it, before it decides."""
    notes, near, i = world.notes, world.near, world.z[ORDER, k]
    own, edge = world.z[LANE, i], world.z[EDGE, i]
    for d in (-1, 0, 1):
        near[FOLLOWER + 1 + d] = -1
        if is_seen(net, edge, own + d):
            j, gap_m = follower(world, net, k, own + d)
            near[FOLLOWER + 1 + d], notes[FOLLOWER + 1 + d] = j, gap_m
    half_m = (world.x[WIDTH_M, i] + EPS) * 0.5
    center = center_m(world, net, i)
    notes[SAFE_RIGHT] = center - half_m - net.edge_lanes[FIRST_LANE, edge] * net.lane_m
    notes[SAFE_LEFT] = net.lanes * net.lane_m - center - half_m
    notes[LAST_RIGHT] = math.inf
    notes[LAST_LEFT] = math.inf
    near[RELATED_COUNT] = -1


@borrowing
def ask_for_ego(world: World, net: Net, road: RoadNumbers, k: int, y_m: float) -> None:
    """Ask others for room for the ego's next mandatory lane change, as SUMO does in its name.

    SUMO cancels the lane change itself, because we drive the ego.
    """
    x, lane, edge, at_m = world.x, world.z[LANE, 0], world.z[EDGE, 0], world.x[FRONT_M, 0]
    sides = int(is_seen(net, edge, lane - 1)) + int(is_seen(net, edge, lane + 1))
    if sides == 0:
        return
    speed = x[SPEED_M_S, 0]
    look_ahead = smoothed(x[LOOK_AHEAD_M_S, 0], speed)
    x[LOOK_AHEAD_M_S, 0] = look_ahead
    for _ in range(sides):
        x[LOOK_AHEAD_M_S, 0] = smoothed(x[LOOK_AHEAD_M_S, 0], speed)
    changes, within_m = mandatory_change(lane, at_m, road)
    changes = max(changes, net.edge_lanes[FIRST_LANE, edge] - lane)
    side = 1 if changes > 0 else -1
    moves_aside = y_m != lane * net.lane_m + x[ASIDE_M, 0]
    if changes == 0 or moves_aside or not is_beside(lane, lane + side, at_m, road):
        return
    count, ahead_s = abs(changes), LOOK_AHEAD_S * (2.0 if side > 0 else 1.0)
    if within_m / count >= look_ahead * ahead_s + 2.0 * (x[LENGTH_M, 0] + MIN_GAP_M):
        return
    look_around(world, net, k, DECAY)
    look_behind(world, net, k)
    world.notes[LEFT_SPACE] = within_m
    world.notes[MOVE] = lane_side_distance(x[WIDTH_M, 0], x[ASIDE_M, 0], side, net.lane_m)
    seconds = max(STEP_S, within_m / max(look_ahead, EPS) / count / URGENCY)
    ask_for_room(world, net, 0, side, seconds)


@inlined
def smoothed(before: float, speed: float) -> float:
    """Return SL2015's look-ahead speed after considering a lane; it follows a fall of the speed."""
    return speed if speed > before else 0.9 * before + 0.1 * speed


@inlined
def reserve(world: World, net: Net, i: int) -> None:
    """Note the lane that the rest of the maneuver leads into, if the body is not there yet."""
    world.z[RESERVED, i] = -1
    rest_m = world.x[MANEUVER_M, i]
    if rest_m == 0.0:
        return
    half_m, aside_m = 0.5 * world.x[WIDTH_M, i], world.x[ASIDE_M, i]
    side = 0
    if aside_m - half_m + rest_m < -0.5 * net.lane_m:
        side = -1
    elif aside_m + half_m + rest_m > 0.5 * net.lane_m:
        side = 1
    lane = world.z[LANE, i] + side
    if side and 0 <= lane < net.lanes and lane != world.z[SHADOW, i]:
        world.z[RESERVED, i] = lane
        link(world, net)


@borrowing
def considered(
    world: World, net: Net, i: int, side: int, sides: int, eases: bool, gain_m: float
) -> tuple[int, float, float]:
    """Return the state, the move and the maneuver to which considering a side leads.

    A vehicle at ease (``is_at_ease``) makes the move ``gain_m`` of ``move_for_speed`` or none.
    """
    if not eases:
        state = wish(world, net, i, side, sides)
    elif gain_m != 0.0:
        state = go_for_speed(world, net, i, side, 0, gain_m)
    else:
        return SUBLANE | STAY, 0.0, 0.0
    state = keep_lateral_gap(world, net, i, side, state)
    state |= signed(state, world.notes[MOVE])
    limit_move(world, i)
    state = influenced(
        state, request_of(world, net, i), world.z[ON_REQUEST_ONLY, i], world.x[COMMANDED_M, i] != 0
    )
    return state, world.notes[MOVE], world.notes[MANEUVER]


@inlined
def reason(state: int) -> int:
    """Return the strongest reason in a state; a smaller number is stronger."""
    for flag in (STRATEGIC, COOPERATIVE, SPEED_GAIN, KEEP_RIGHT, REQUESTED):
        if state & flag:
            return flag
    return state & SUBLANE


@inlined
def is_second(
    first: tuple[int, float, float], second: tuple[int, float, float], one_side: int, two_side: int
) -> bool:
    """Return whether SUMO prefers the second of two considerations (``considered``)."""
    (one, one_m, one_all_m), (two, two_m, two_all_m) = first, second
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
    one_reason, two_reason = reason(one), reason(two)
    one_can, two_can = not one & BLOCKED, not two & BLOCKED
    same = one_m * two_m > 0
    if one_reason < two_reason:
        return not one_can and two_can and same
    if one_reason > two_reason:
        return not (not two_can and one_can and same)
    if one & SUBLANE:
        if one_side == 0:
            return True
        if two_side == 0:
            return False
        if one_m <= 0:
            return False
        return two_m >= 0 or one_m > two_m
    longer_m = abs(one_all_m) - abs(two_all_m)  # it prefers the shorter maneuver
    return not one_can or (two_can and (longer_m > 0 or (longer_m == 0 and one_side == 0)))
