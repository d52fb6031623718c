"""SUMO's car following and gaps: IDM for the traffic, Krauss's gap for the ego (SUMO 1.28).

Lengths are metres, times seconds. ``speed`` is the speed of the vehicle behind, ``ahead_speed``
that of the vehicle ahead.
"""

import math

from drl_av.compiled import borrowing, inlined

STEP_S = 0.5
"""Length of a SUMO step."""
INNER_S = 0.25
"""Length of an inner iteration of SUMO's IDM; a step has two."""
MIN_GAP_M = 2.5
BRAKING_M_S2 = 4.0
BRAKING_ROOT_M_S2 = 2.0 * math.sqrt(1.5 * BRAKING_M_S2)
"""2 sqrt(a b) of IDM; SUMO takes a from the vehicle type, not the drawn acceleration."""
MOST_BRAKING_M_S = BRAKING_M_S2 * STEP_S
"""Largest reduction of the speed in one step."""
EGO_HEADWAY_S, EGO_ACCELERATION_M_S2 = 1.5, 2.0
"""The ego's vehicle type, by whose Krauss model SUMO judges what the ego would do."""
EPS = 0.001
"""SUMO's NUMERICAL_EPS."""


@inlined
def idm_speed(
    speed: float,
    gap_m: float,
    ahead_speed: float,
    desired: float,
    headway_s: float,
    acceleration: float,
    min_gap_m: float,
) -> float:
    """Return the speed of SUMO's IDM after one step; ``gap_m`` is bumper to bumper."""
    for _ in range(2):
        faster = speed - ahead_speed
        wanted_m = min_gap_m + max(0.0, speed * headway_s + speed * faster / BRAKING_ROOT_M_S2)
        room_m = max(EPS, gap_m)
        ratio = speed / max(EPS, desired)
        ratio *= ratio
        close = wanted_m / room_m
        gain = acceleration * (1.0 - ratio * ratio - close * close)
        speed = max(0.0, speed + gain * INNER_S)
        gap_m = room_m - max(0.0, (speed - ahead_speed) * INNER_S)
    return speed


@inlined
def follow_speed(
    speed: float,
    net_gap_m: float,
    ahead_speed: float,
    desired: float,
    headway_s: float,
    acceleration: float,
) -> float:
    """Return IDM's next speed behind a vehicle; ``net_gap_m`` excludes SUMO's minimum gap."""
    return idm_speed(
        speed, net_gap_m + MIN_GAP_M, ahead_speed, desired, headway_s, acceleration, MIN_GAP_M
    )


@inlined
def free_speed(
    speed: float, seen_m: float, desired: float, headway_s: float, acceleration: float
) -> float:
    """Return IDM's next speed on a free road whose speed limit is the desired speed."""
    secure_m = max(0.0, desired * headway_s + desired * desired / BRAKING_ROOT_M_S2)
    if speed <= desired:
        free = idm_speed(speed, 1e6, desired, desired, headway_s, acceleration, 0.0)
    else:
        seen = max(seen_m, secure_m)
        free = idm_speed(speed, seen, 0.0, desired, headway_s, acceleration, 0.0)
    return min(free, desired) if seen_m < secure_m else free


@inlined
def brake_gap(speed: float, braking: float, headway_s: float) -> float:
    """Return the stopping distance in SUMO's steps, with ``headway_s`` at the present speed."""
    less = braking * STEP_S
    steps = int(speed / less)
    return STEP_S * (steps * speed - less * steps * (steps + 1) / 2) + speed * headway_s


@inlined
def secure_gap(speed: float, ahead_speed: float, headway_s: float) -> float:
    """Return the gap that SUMO requires of a vehicle with IDM for a lane change."""
    return max(0.0, speed * headway_s + speed * (speed - ahead_speed) / BRAKING_ROOT_M_S2)


@inlined
def ego_gap(speed: float, ahead_speed: float, acceleration: float) -> float:
    """Return the gap that SUMO requires of the ego; one that brakes needs no time to react."""
    stop_m = brake_gap(speed, BRAKING_M_S2, EGO_HEADWAY_S)
    if acceleration < -EPS:
        stop_m = min(stop_m, brake_gap(speed, -acceleration, 0.0))
    return max(0.0, stop_m - brake_gap(ahead_speed, BRAKING_M_S2, 0.0))


@borrowing
def krauss_speed(speed: float, gap_m: float, ahead_speed: float, headway_s: float) -> float:
    """Return the next speed of SUMO's Krauss model: the vehicle can stop where the one ahead can.

    ``headway_s`` is the time before it brakes; an obstacle has the speed 0.
    """
    room_m = gap_m - EPS + brake_gap(ahead_speed, BRAKING_M_S2, 0.0)
    if room_m <= 0.0:
        return 0.0
    steps = 0
    while brake_gap((steps + 1) * MOST_BRAKING_M_S, BRAKING_M_S2, headway_s) <= room_m:
        steps += 1
    least = steps * MOST_BRAKING_M_S
    rest_m = room_m - brake_gap(least, BRAKING_M_S2, headway_s)
    safe = least + rest_m / (steps * STEP_S + headway_s)
    return min(safe, speed + EGO_ACCELERATION_M_S2 * STEP_S)
