"""The lateral room of a vehicle that considers a lane change, and what blocks its move.

Part of SUMO's lane-change model SL2015 with one strip per lane, written after the behaviour of SUMO
1.28. A vehicle considers the lane to its right, the one to its left and its own, one after the
other. Directions are -1 right, +1 left, 0 own lane.
"""

from drl_av.compiled import borrowing, inlined
from drl_av.twin.following import EPS, MIN_GAP_M, STEP_S
from drl_av.twin.neighbors import needed_gap
from drl_av.twin.worlds import (
    ASIDE_M,
    BLOCKED_BY_FOLLOWER,
    BLOCKED_BY_LEADER,
    BLOCKED_BY_LEFT_FOLLOWER,
    BLOCKED_BY_LEFT_LEADER,
    BLOCKED_BY_RIGHT_FOLLOWER,
    BLOCKED_BY_RIGHT_LEADER,
    BLOCKED_LEFT,
    BLOCKED_RIGHT,
    EDGE,
    FIRST_LANE,
    FULL_REASONS,
    IS_FULL,
    LANE,
    LEFT,
    MANEUVER_M,
    OVERLAPPING,
    REASONS,
    REQUEST_END,
    REQUEST_LANE,
    REQUESTED,
    RIGHT,
    SPEED_M_S,
    STAY,
    STEP,
    SUBLANE,
    URGENT,
    WANTS,
    WIDTH_M,
    Net,
    World,
)

STRIDE_M = 0.76 * STEP_S
"""Largest lateral move in a step."""
LATERAL_GAP_M = 0.6
QUEUE_GAP_M = 0.9 * MIN_GAP_M
"""Net gap below which the next vehicle in the own lane hinders a lane change, too; found by
experiment."""
TINY_M = EPS * STEP_S
HOLD = 2
COUNTS = 1 << 40
"""Bit that tells of a neighbour that it matters for the move, and so is asked for room."""
SAFE_RIGHT, SAFE_LEFT, LAST_RIGHT, LAST_LEFT, MOVE, MANEUVER, LEFT_SPACE = range(7)
"""Columns of ``Worlds.notes``."""
LEADER, FOLLOWER = 8, 11
"""Columns of ``Worlds.near`` and of ``Worlds.notes``: the leaders and followers, and the gaps to
them, three each: in the right, own and left lane."""
RELATED, RELATED_COUNT, BLOCKERS = 0, 6, 7
"""Columns of ``Worlds.near``: the vehicles that car following regards, their number or -1, and a
bit for each leader or follower that is in the way."""
BLOCKED_BY = (
    (BLOCKED_BY_LEADER, BLOCKED_BY_LEFT_LEADER, BLOCKED_BY_RIGHT_LEADER),
    (BLOCKED_BY_FOLLOWER, BLOCKED_BY_LEFT_FOLLOWER, BLOCKED_BY_RIGHT_FOLLOWER),
)
"""The flags of a leader and of a follower in the own lane (0), to the left (1) and right (-1)."""


@inlined
def lane_side_distance(width_m: float, aside_m: float, side: int, lane_m: float) -> float:
    """Return the least lateral move, metres, that brings a body wholly into the next lane."""
    half_m = 0.5 * (width_m + EPS)
    if side < 0:
        return -0.5 * lane_m + half_m - aside_m - (width_m + EPS)
    return 0.5 * lane_m - half_m - aside_m + (width_m + EPS)


@inlined
def request_of(world: World, net: Net, i: int) -> int:
    """Return the side of the request that stands: -1, +1, ``HOLD``, or 0 without one."""
    wanted = world.z[REQUEST_LANE, i]
    first = net.edge_lanes[FIRST_LANE, world.z[EDGE, i]]
    if wanted < 0 or wanted >= net.lanes - first or world.near[STEP] > world.z[REQUEST_END, i]:
        return 0
    lane = world.z[LANE, i] - first
    return HOLD if wanted == lane else (-1 if wanted < lane else 1)


@inlined
def influenced(state: int, request: int, on_request_only: int, is_commanded: bool) -> int:
    """Return the state after SUMO has applied the lane-change mode and the request to it."""
    if state & (WANTS | STAY):
        if state & REQUESTED and is_commanded:
            return state
        never = True
        if state & FULL_REASONS:
            never = on_request_only != 0
        elif state & SUBLANE:
            never = False
        conflicts = request != 0 and (
            (state & LEFT and request != 1)
            or (state & RIGHT and request != -1)
            or (state & STAY and request != HOLD)
        )
        if never or conflicts:
            state &= ~(WANTS | STAY | URGENT)
    if request == 0:
        return state
    state |= REQUESTED
    if request == HOLD:
        return state | STAY
    return state | URGENT | (LEFT if request == 1 else RIGHT)


@inlined
def signed(state: int, move_m: float) -> int:
    """Return the direction flag of a lateral move that has a reason."""
    if move_m == 0.0 or not state & REASONS:
        return 0
    return RIGHT if move_m < 0 else LEFT


@inlined
def overlaps(right: float, left: float, other_right: float, other_left: float) -> bool:
    """Return whether two lateral intervals overlap by more than SUMO's tolerance."""
    return other_left >= right + EPS and left >= other_right + EPS


@inlined
def is_related(world: World, j: int) -> bool:
    """Return whether car following already regards the vehicle ``j``."""
    found = False
    for m in range(max(0, world.near[RELATED_COUNT])):
        found = found or bool(world.near[RELATED + m] == j)
    return found


@inlined
def relate(world: World, net: Net, i: int, d: int, beside: int) -> None:
    """Remember the ``LEADER`` or ``FOLLOWER`` in lane ``d`` if the vehicle overlaps that lane.

    It does not if they are as close as in a queue, unless the other one is the ego.
    """
    j, gap_m, lane = world.near[beside + 1 + d], world.notes[beside + 1 + d], world.z[LANE, i] + d
    if j < 0 or gap_m < (QUEUE_GAP_M if j > 0 else 0.0) or is_related(world, j):
        return
    width_m = world.x[WIDTH_M, i] - EPS
    right = center_m(world, net, i) - 0.5 * width_m
    if overlaps(right, right + width_m, lane * net.lane_m, (lane + 1) * net.lane_m):
        count = world.near[RELATED_COUNT]
        world.near[RELATED + count] = j
        world.near[RELATED_COUNT] = count + 1


@inlined
def center_m(world: World, net: Net, i: int) -> float:
    """Return the lateral position of a body's centre from the right border of the road."""
    return (world.z[LANE, i] + 0.5) * net.lane_m + world.x[ASIDE_M, i]


@inlined
def update_gaps(
    world: World,
    net: Net,
    i: int,
    d: int,
    beside: int,
    room_right: float,
    room_left: float,
    kept_m: float,
    remembers: bool,
    net_m: float,
) -> tuple[float, float]:
    """Return the lateral room right and left beside the ``LEADER`` or ``FOLLOWER`` in lane ``d``.

    ``kept_m`` is the lateral gap to keep. With ``net_m`` only vehicles beside the front half count.
    """
    j, gap_m, lane = world.near[beside + 1 + d], world.notes[beside + 1 + d], world.z[LANE, i] + d
    if j < 0 or gap_m > 0 or is_related(world, j):
        return room_right, room_left
    if net_m != 0.0 and not gap_m + MIN_GAP_M < net_m:
        return room_right, room_left
    center = center_m(world, net, i)
    right, left = lane * net.lane_m, (lane + 1) * net.lane_m
    half_m = (world.x[WIDTH_M, i] + EPS) * 0.5 + EPS
    aside = min(abs(right - center), abs(left - center)) - half_m
    its_m = world.x[MANEUVER_M, j]
    if right + 0.5 * net.lane_m < center:
        its_m = max(0.0, its_m)
        room_right = min(room_right, aside - kept_m, max(kept_m, aside - its_m))
        if remembers:
            world.notes[LAST_RIGHT] = min(world.notes[LAST_RIGHT], aside)
    else:
        its_m = -min(0.0, its_m)
        room_left = min(room_left, aside - kept_m, max(kept_m, aside - its_m))
        if remembers:
            world.notes[LAST_LEFT] = min(world.notes[LAST_LEFT], aside)
    return room_right, room_left


@borrowing
def is_blocking(
    world: World, net: Net, i: int, d: int, beside: int, move_m: float, flag: int
) -> int:
    """Return ``flag`` if the ``LEADER`` or ``FOLLOWER`` in lane ``d`` blocks a move, else 0.

    The result contains ``COUNTS`` if that vehicle matters at all.
    """
    j, gap_m, lane = world.near[beside + 1 + d], world.notes[beside + 1 + d], world.z[LANE, i] + d
    if j < 0 or is_related(world, j):
        return 0
    width_m = world.x[WIDTH_M, i] + EPS
    right = center_m(world, net, i) - 0.5 * world.x[WIDTH_M, i]
    left = right + width_m
    its_right, its_left = lane * net.lane_m, (lane + 1) * net.lane_m
    before = overlaps(right, left, its_right, its_left)
    after = overlaps(right + move_m, left + move_m, its_right, its_left)
    if not overlaps(min(right, right + move_m), max(left, left + move_m), its_right, its_left):
        return 0
    if gap_m < 0:
        return 0 if before and not after else flag | OVERLAPPING | COUNTS
    if not after and world.z[IS_FULL, i]:
        return 0
    behind, ahead = (i, j) if beside == LEADER else (j, i)
    if gap_m >= needed_gap(world, behind, world.x[SPEED_M_S, behind], world.x[SPEED_M_S, ahead]):
        return COUNTS
    return flag | COUNTS


@borrowing
def check_blocking(
    world: World, net: Net, i: int, side: int, kept_m: float, keeps_gap: bool
) -> int:
    """Return the flags of what blocks the move in ``notes``; shorten the move as far as needed."""
    notes, near = world.notes, world.near
    move_m = max(min(notes[MOVE], STRIDE_M), -STRIDE_M)
    if near[RELATED_COUNT] < 0:
        near[RELATED_COUNT] = 0
        for d in (0, side):
            relate(world, net, i, d, LEADER)
            relate(world, net, i, d, FOLLOWER)
            if side == 0:
                break
    right, left = notes[SAFE_RIGHT], notes[SAFE_LEFT]
    for d in (0, side):
        for beside in (LEADER, FOLLOWER):
            right, left = update_gaps(world, net, i, d, beside, right, left, kept_m, False, 0.0)
        if side == 0:
            break
    notes[SAFE_RIGHT], notes[SAFE_LEFT] = right, left
    near[BLOCKERS] = 0
    notes[MOVE] = move_m
    if move_m < 0:
        if right <= EPS:
            return BLOCKED_RIGHT | OVERLAPPING
        move_m = max(move_m, -right)
    else:
        if left <= EPS:
            return BLOCKED_LEFT | OVERLAPPING
        move_m = min(move_m, left)
    notes[MOVE] = move_m
    maneuver_m = notes[MANEUVER]
    world.z[IS_FULL, i] = maneuver_m == 0 or move_m == maneuver_m
    blocked, fully, counted = 0, 0, 0
    for d in (0, side):
        for behind, beside in ((0, LEADER), (1, FOLLOWER)):
            flag, bit = BLOCKED_BY[behind][d], (1 if d == 0 else 4) << behind
            now = is_blocking(world, net, i, d, beside, move_m, flag)
            later = is_blocking(world, net, i, d, beside, maneuver_m, flag)
            counted |= bit if (now | later) & COUNTS else 0
            blocked |= now
            fully |= later
        if side == 0:
            break
    near[BLOCKERS] = counted
    if not blocked & ~COUNTS and not world.z[IS_FULL, i] and not keeps_gap:
        blocked |= fully
    return blocked & ~COUNTS
