"""How a driver of SUMO's SL2015 asks the vehicles around for room for a lane change."""

from drl_av.compiled import borrowing, inlined
from drl_av.twin.following import (
    EGO_HEADWAY_S,
    EPS,
    MIN_GAP_M,
    MOST_BRAKING_M_S,
    STEP_S,
    follow_speed,
    idm_speed,
    krauss_speed,
)
from drl_av.twin.lateral_room import LEFT_SPACE
from drl_av.twin.neighbors import needed_gap
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ADVICE_M_S,
    ASKED_BY_LEFTWARD,
    ASKED_BY_RIGHTWARD,
    BLOCKED_BY_FOLLOWER,
    BLOCKED_BY_LEADER,
    DESIRED_M_S,
    HEADWAY_S,
    IS_BLOCKING_FOLLOWER,
    IS_BLOCKING_LEADER,
    LENGTH_M,
    OVERTAKES_RIGHT,
    SPEED_M_S,
    STATE,
    World,
)

CONGESTED_M_S = 60.0 / 3.6
HELP_M_S = 10.0 / 3.6
LONGEST_RAMP_M, FAST_M_S = 200.0, 27.0
"""A slower vehicle with less room ahead, as on an on-ramp, does not ask faster ones to slow down
for a change to the left."""
FALL_BEHIND_M_S = 7.0 / 3.6


@inlined
def inform(world: World, j: int, advice: float, flags: int) -> None:
    """Tell the vehicle ``j`` that it is in the way; ``advice`` is a speed for it, or negative."""
    world.z[STATE, j] |= flags
    if advice >= 0:
        advise(world, j, advice)


@inlined
def advise(world: World, j: int, advice: float) -> None:
    """Advise a vehicle of a speed for the next step; it ignores one that it cannot reach."""
    speed = world.x[SPEED_M_S, j]
    reached = speed + ((advice - speed) / STEP_S) * STEP_S
    if max(speed - MOST_BRAKING_M_S, 0.0) <= reached < world.x[ADVICE_M_S, j]:
        world.x[ADVICE_M_S, j] = reached


@inlined
def its_follow_speed(world: World, i: int, gap_m: float, ahead_speed: float) -> float:
    """Return the next speed of the vehicle ``i`` behind another one, by its IDM."""
    return follow_speed(
        world.x[SPEED_M_S, i],
        gap_m,
        ahead_speed,
        world.x[DESIRED_M_S, i],
        world.x[HEADWAY_S, i],
        world.x[ACCELERATION_M_S2, i],
    )


@borrowing
def own_follow_speed(world: World, i: int, gap_m: float, ahead_speed: float) -> float:
    """Return the next speed of the vehicle ``i``, which may be the ego, behind another one."""
    if i == 0:
        return krauss_speed(world.x[SPEED_M_S, i], gap_m, ahead_speed, EGO_HEADWAY_S)
    return its_follow_speed(world, i, gap_m, ahead_speed)


@borrowing
def inform_leader(
    world: World, i: int, side: int, blocked: int, j: int, gap_m: float, seconds: float
) -> float:
    """Ask the vehicle ahead in the target lane for room; return the own planned speed."""
    speed, its = world.x[SPEED_M_S, i], world.x[SPEED_M_S, j]
    planned = min(speed, stop_speed(world, i), world.x[ADVICE_M_S, i])
    asked = ASKED_BY_LEFTWARD if side > 0 else ASKED_BY_RIGHTWARD
    if blocked & BLOCKED_BY_LEADER:
        faster = planned - its
        length_m = world.x[LENGTH_M, i]
        past_m = gap_m + world.x[LENGTH_M, j] + MIN_GAP_M + length_m
        past_m += needed_gap(world, j, its, speed)
        stays = side > 0 and speed >= CONGESTED_M_S and not world.near[OVERTAKES_RIGHT]
        if faster < EPS or stays or faster * seconds < past_m:
            inform(world, j, -1.0, asked | IS_BLOCKING_LEADER)
            target = own_follow_speed(world, i, gap_m, its)
            if target >= speed:
                advise(world, i, target)
                return planned
            slower = max(FALL_BEHIND_M_S, (speed - target) / seconds)
            slower = min(MOST_BRAKING_M_S / STEP_S, slower) * STEP_S
            target = min(planned, max(0.0, speed - slower))
            advise(world, i, target)
            return target
        inform(world, j, its, asked | IS_BLOCKING_LEADER)
        return -1.0
    later = its - HELP_M_S
    closer_m = (speed - later) * STEP_S
    target = own_follow_speed(world, i, gap_m - closer_m, later)
    advise(world, i, target)
    return min(target, planned)


@inlined
def stop_speed(world: World, i: int) -> float:
    """Return the next speed if the vehicle is to stop at the end of the road that SUMO regards."""
    if i == 0:
        return krauss_speed(world.x[SPEED_M_S, i], world.notes[LEFT_SPACE], 0.0, STEP_S)
    return idm_speed(
        world.x[SPEED_M_S, i],
        world.notes[LEFT_SPACE],
        0.0,
        world.x[DESIRED_M_S, i],
        world.x[HEADWAY_S, i],
        world.x[ACCELERATION_M_S2, i],
        0.0,
    )


@borrowing
def inform_follower(
    world: World,
    i: int,
    side: int,
    blocked: int,
    j: int,
    gap_m: float,
    seconds: float,
    planned: float,
) -> None:
    """Ask the vehicle behind in the target lane for room, or let it pass."""
    speed, its = world.x[SPEED_M_S, i], world.x[SPEED_M_S, j]
    asked = IS_BLOCKING_FOLLOWER | (ASKED_BY_LEFTWARD if side > 0 else ASKED_BY_RIGHTWARD)
    if not blocked & BLOCKED_BY_FOLLOWER:
        fastest = min(its + world.x[ACCELERATION_M_S2, j] * STEP_S, world.x[DESIRED_M_S, j])
        safe = its_follow_speed(world, j, gap_m + (planned - fastest) * STEP_S, planned)
        if safe < its:
            later_m = gap_m + (planned - its) * STEP_S
            safe = its
            if later_m < needed_gap(world, j, its, planned):
                safe = its_follow_speed(world, j, later_m, planned)
        inform(world, j, safe, asked)
        return
    if planned - its >= HELP_M_S:
        needed_m = needed_gap(world, j, its, planned)
        if (needed_m - gap_m) / seconds < planned - its:
            inform(world, j, planned - HELP_M_S, asked)
            return
    braking = MOST_BRAKING_M_S / STEP_S
    slowed, slowed_1s = max(0.0, its - MOST_BRAKING_M_S), max(0.0, its - braking)
    faster = planned - slowed_1s
    later_m = gap_m + faster
    needed_m = needed_gap(world, j, slowed_1s, planned)
    if later_m > 0 and later_m >= needed_m:
        safe = max(slowed, its_follow_speed(world, j, gap_m + planned * STEP_S, planned))
        room_m = gap_m + (planned - safe) * STEP_S
        safe = max(slowed, its_follow_speed(world, j, room_m, planned))
        inform(world, j, safe, asked)
    elif faster > 0 and faster * seconds > needed_m - later_m + 0.1:
        inform(world, j, slowed, asked)
    elif side < 0 and not world.near[OVERTAKES_RIGHT] and its >= CONGESTED_M_S:
        inform(world, j, max(slowed, HELP_M_S), asked)
    else:
        helped = max(its, speed + HELP_M_S)
        is_ramp = world.notes[LEFT_SPACE] <= LONGEST_RAMP_M and planned <= FAST_M_S
        if its > speed and not (side > 0 and is_ramp):
            helped = max(slowed, speed + HELP_M_S)
            if (its - speed) / braking < seconds:
                inform(world, j, helped, asked)
                return
        inform(world, j, helped, asked)
        past_m = gap_m + world.x[LENGTH_M, i] + MIN_GAP_M + world.x[LENGTH_M, j]
        past_m += needed_gap(world, i, planned, helped)
        advise(world, i, max(helped - past_m / seconds, speed - MOST_BRAKING_M_S))
