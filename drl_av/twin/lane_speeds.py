"""The speeds that a driver of SUMO's SL2015 expects in the lanes, and what it gains by them."""

import math

from drl_av.compiled import borrowing, inlined
from drl_av.twin.asking import CONGESTED_M_S, HELP_M_S, advise, its_follow_speed
from drl_av.twin.following import EPS, MIN_GAP_M, MOST_BRAKING_M_S, STEP_S, follow_speed
from drl_av.twin.lateral_room import LATERAL_GAP_M, LEADER, STRIDE_M, TINY_M, center_m, overlaps
from drl_av.twin.neighbors import leader, needed_gap, reach_m
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ACCELERATION_NOW_M_S2,
    ASIDE_M,
    ASKED,
    COMMANDED_M,
    DESIRED_M_S,
    EDGE,
    EDGE_BEGIN,
    EDGE_LENGTH,
    EDGE_ROUTE,
    EXPECTED_M_S,
    FIRST_LANE,
    FIRST_SEEN,
    FRONT_M,
    GAIN_LEFT,
    GAIN_RIGHT,
    HEADWAY_S,
    LANE,
    LEFT,
    ORDER,
    OVERTAKES_RIGHT,
    REQUEST_END,
    RIGHT,
    SPEED_M_S,
    STATE,
    STEP,
    THRESHOLD_LEFT,
    WIDTH_M,
    Net,
    World,
)

DECAY = 0.5**STEP_S
GAIN_SEEN = 0.05
RIGHT_RELUCTANCE = 10.0
"""SUMO's 1 / lcSpeedGainRight: a change to the right needs so much more gain."""
SLOW_M_S = 10.0
LOOKAHEAD_S = 5.0


@inlined
def is_open(net: Net, lane: int) -> bool:
    """Return whether the traffic's route follows this lane, which is open."""
    return net.first_open <= lane <= net.last_open


@inlined
def is_seen(net: Net, edge: int, lane: int) -> bool:
    """Return whether the lane exists on an edge and is open; it may lead elsewhere."""
    return net.edge_lanes[FIRST_SEEN, edge] <= lane <= net.last_open


@borrowing
def expect_anew(world: World, net: Net, i: int) -> None:
    """Forget the expected speeds that SL2015 does not keep on an edge with other lanes."""
    x, first = world.x, net.edge_lanes[FIRST_LANE, world.z[EDGE, i]]
    for lane in range(max(net.first_open, first + 1)):
        x[EXPECTED_M_S + lane, i] = min(x[DESIRED_M_S, i], net.limit_m_s) if lane >= first else -1.0


@inlined
def look_around(world: World, net: Net, k: int, old_part: float) -> None:
    """Find the vehicles ahead of the ``k``-th one in all lanes, and what speed each lane promises.

    The leaders in the right, own and left lane go to ``near`` and their net gaps to ``notes``. Of
    the speeds that it expected it keeps ``old_part``, ``DECAY`` from one step to the next.
    """
    x, near = world.x, world.near
    i = world.z[ORDER, k]
    own, edge = world.z[LANE, i], world.z[EDGE, i]
    pos_m = x[FRONT_M, i] - net.edges_m[EDGE_BEGIN, edge]
    seen_m = reach_m(net, edge, pos_m, x[SPEED_M_S, i], x[HEADWAY_S, i])
    for d in range(3):
        near[LEADER + d] = -1
    for lane in range(net.edge_lanes[FIRST_SEEN, edge], net.last_open + 1):
        j, rear_m = leader(world, net, k, lane, seen_m)
        end_m = (
            net.edges_m[EDGE_ROUTE, edge]
            if lane >= net.first_open
            else net.edges_m[EDGE_LENGTH, edge]
        )
        gap_m = rear_m - MIN_GAP_M if j >= 0 else end_m - pos_m
        if abs(lane - own) <= 1:
            near[LEADER + 1 + lane - own], world.notes[LEADER + 1 + lane - own] = j, gap_m
        expected = old_part * x[EXPECTED_M_S + lane, i]
        x[EXPECTED_M_S + lane, i] = expected + (1 - old_part) * promised_speed(world, i, j, gap_m)


@inlined
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


@inlined
def needs_thought(world: World, net: Net, k: int) -> bool:
    """Return whether the ``k``-th vehicle may move sideways now; if not, do what else it does.

    It has looked around. A vehicle at the centre of its lane that no driver asks for room and that
    changes lanes for no speed may still keep behind a vehicle on its left, and once it has braked
    for such a vehicle, SL2015 lets it change to the right as soon as that is faster.
    """
    x, z = world.x, world.z
    i = z[ORDER, k]
    if x[COMMANDED_M, i] != 0.0 or x[ASIDE_M, i] != 0.0 or z[STATE, i] & ASKED:
        return True
    if z[REQUEST_END, i] >= world.near[STEP] or x[THRESHOLD_LEFT, i] != math.inf:
        return True
    own, speed = z[LANE, i], x[SPEED_M_S, i]
    may_go_right = own > net.first_open and x[GAIN_RIGHT, i] == math.inf
    keep_behind(world, i)
    if may_go_right and best_gain(world, i, 0, own) > GAIN_SEEN:
        j = world.near[LEADER]
        if j < 0:
            return True
        # else it is blocked and asks no driver, but a wide vehicle moves aside as far as it may
        is_wide = 0.5 * (net.lane_m - x[WIDTH_M, i]) < LATERAL_GAP_M + STRIDE_M
        if world.notes[LEADER] >= needed_gap(world, i, speed, x[SPEED_M_S, j]) or is_wide:
            return True
    edge = z[EDGE, i]
    is_right, is_left = is_seen(net, edge, own - 1), is_seen(net, edge, own + 1)
    # SUMO counts a move to the right within the lane, too
    remember_gain(world, i, GAIN_RIGHT, best_gain(world, i, 0, own + 1), is_right, is_left)
    remember_gain(world, i, GAIN_LEFT, best_gain(world, i, own + 1, net.lanes), is_left, is_right)
    return False


@inlined
def best_gain(world: World, i: int, first: int, end: int) -> float:
    """Return the largest gain of speed in the lanes from ``first`` to before ``end``, or -inf."""
    best = -math.inf
    stays = world.x[EXPECTED_M_S + world.z[LANE, i], i]
    for lane in range(first, end):
        its = world.x[EXPECTED_M_S + lane, i]
        best = max(best, (its - stays) / max(its, SLOW_M_S))
    return best


@inlined
def remember_gain(
    world: World, i: int, row: int, gain: float, is_open_side: bool, is_other: bool
) -> None:
    """Update the gain to one side as ``weigh_gains`` does for a vehicle at its lane's centre."""
    x = world.x
    if is_open_side:
        x[row, i] += STEP_S * gain
    if not is_open_side or abs(gain) < EPS:
        x[row, i] *= DECAY
    if not is_open_side and is_other:
        x[row, i] *= DECAY


@inlined
def keep_behind(world: World, i: int) -> None:
    """Advise a driver above 60 km/h not to pass the one ahead in the left lane on its right."""
    x, j, speed = world.x, world.near[LEADER + 2], world.x[SPEED_M_S, i]
    if j < 0 or speed < CONGESTED_M_S or world.near[OVERTAKES_RIGHT]:
        return
    its = x[SPEED_M_S, j]
    if its < speed or x[DESIRED_M_S, j] < x[DESIRED_M_S, i]:
        safe = its_follow_speed(world, i, world.notes[LEADER + 2], its)
        if safe < speed - MOST_BRAKING_M_S:
            safe = max(speed - MOST_BRAKING_M_S, its - HELP_M_S)
        advise(world, i, safe)
        if safe < speed:
            x[GAIN_RIGHT, i] += STEP_S * x[THRESHOLD_LEFT, i] / 3


@inlined
def weigh_gains(world: World, net: Net, i: int, side: int, sides: int) -> tuple[float, float]:
    """Update the gains of speed to each side; return the best lateral move, and the own speed.

    ``sides`` holds the flags of the sides that are open to the vehicle.
    """
    lane_m, own = net.lane_m, world.z[LANE, i]
    width_m = world.x[WIDTH_M, i] + EPS
    right = center_m(world, net, i) - 0.5 * width_m
    left = right + width_m
    high = net.lanes - 1
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
    first, last = 0 if side < 0 else own, net.lanes - 1 if side > 0 else own
    to_left, to_right = RIGHT_RELUCTANCE * world.x[GAIN_LEFT, i], world.x[GAIN_RIGHT, i]
    for lane in range(first, last + 1):
        at = lane * lane_m
        its = world.x[EXPECTED_M_S + lane, i]
        gain = (its - stays) / max(its, SLOW_M_S)
        shift = min(max(at - right, end_right), end_left)
        turns = move_m < 0 < shift
        if gain > best and not (turns and to_right > to_left):
            best = gain
            if best > GAIN_SEEN:
                move_m = shift
        elif shift > 0 and gain > GAIN_SEEN and to_left > to_right and (turns or best - gain < EPS):
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


@inlined
def speed_gain_of(world: World, net: Net, i: int, move_m: float, stays: float) -> float:
    """Return the expected change of the speed after a lateral move."""
    result = math.inf
    width_m = world.x[WIDTH_M, i] + EPS
    right = center_m(world, net, i) - 0.5 * width_m + move_m
    for lane in range(net.lanes):
        if overlaps(right, right + width_m, lane * net.lane_m, (lane + 1) * net.lane_m):
            result = min(result, world.x[EXPECTED_M_S + lane, i])
    return result - stays
