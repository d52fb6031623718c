"""Requests the speeds of background vehicles, so that each can stop behind the vehicle ahead."""

import math
from collections.abc import Sequence
from struct import pack_into
from types import ModuleType

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import compiled, squared
from drl_av.road.road import Road, lane_of
from drl_av.road.snapshot import EGO, TrafficCommands
from drl_av.road.vehicle_types import LENGTHS_M
from drl_av.simulation.vehicle_calls import getters, packed

LEFT_TO_SUMO = -1.0
"""The argument of ``setSpeed`` that returns the control of the speed to SUMO."""
LOOK_AHEAD_M = 200.0
"""Range in which SUMO looks for a vehicle ahead; longer than any stopping distance."""
MARGIN_M = 0.1
"""What positions that we compute may differ from SUMO's, along the road and across it."""
S, Y, SPEED, BEFORE = range(4)
"""Rows of the array ``motion``: the position of the centre, the speed, and the speed a SUMO step
before."""
LENGTH, WIDTH, BRAKING, ACCELERATION, ASIDE, GAP = range(6)
"""Rows of the array ``limits``: the size, and what ``LIMITS`` reads."""
LIMITS = "getDecel", "getAccel", "getMaxSpeedLat", "getMinGap"


class SpeedRequests:
    """Requests speeds of the background vehicles for the end of each SUMO step.

    Each speed is at most ``stoppable_speed``, because SUMO's IDM brakes too late behind a vehicle
    that brakes fully, as level-0 drivers do. This limit also applies to the vehicles that SUMO
    drives. SUMO may still brake harder than requested.

    SUMO is asked only for the leader of a vehicle that may be near its limit (``near_limit``).
    ``watched_m`` is the position along the road up to which the vehicles are watched.
    """

    def __init__(self, sumo: ModuleType, step_s: float, road: Road, watched_m: float) -> None:
        names = "getSpeed", "getLeader", "getSpeedWithoutTraCI", "setSpeed"
        self._speed, self._leader, self._chosen, self._set_speed = getters(sumo, names)
        self._read_limits = getters(sumo, LIMITS)
        self._step_s = float(step_s)
        self._road_m = float(road.lap_m), float(road.lane_width_m), watched_m - LENGTHS_M[1]
        self._limits, self._motion = np.empty((6, 0)), np.empty((4, 0))
        self._requested = np.empty(0)
        self._limited: Sequence[int] = ()

    def watch(
        self,
        ids: Sequence[str],
        length_m: FloatArray,
        width_m: FloatArray,
        kept: Sequence[int] = (),
    ) -> None:
        """Set the vehicles on the road; the first of them had the rows ``kept`` before."""
        new, rows = ids[len(kept) :], list(kept)
        sizes_m = length_m[len(rows) :], width_m[len(rows) :]
        limits = np.array([*sizes_m, *([*map(read, new)] for read in self._read_limits)])
        self._ids = ids
        self._limits = np.ascontiguousarray(np.hstack((self._limits[:, rows], limits)))
        motion = np.hstack((self._motion[:, rows], np.full((4, len(new)), np.nan)))
        self._motion = np.ascontiguousarray(motion)
        self._requested = np.append(self._requested[rows], np.full(len(new), LEFT_TO_SUMO))
        self._rows = np.empty(len(ids), np.int64)

    def begin(self, state: FloatArray, commands: TrafficCommands) -> None:
        """Set the commands of a decision; the rows of ``state`` are s, y and speed at its start."""
        self._motion[:BEFORE] = state[:BEFORE]
        self._elapsed_s, self._commands = 0.0, commands
        self._commanded = [self._ids[row] for row in commands.rows.tolist()]

    def __call__(self) -> None:
        """Request the speeds for the next SUMO step."""
        ids, rows, motion, limits = self._ids, self._rows, self._motion, self._limits
        commands, step_s = self._commands, self._step_s
        if self._elapsed_s > 0.0:
            pack_into(f"{len(ids)}d", motion[SPEED].data, 0, *map(self._speed, ids))
        wishes = commands.rows, commands.acceleration_m_s2
        times_s = self._elapsed_s, step_s
        near = rows[: near_limit.fast(motion, limits, *wishes, *times_s, *self._road_m, rows)]
        self._elapsed_s += step_s
        were_limited, self._limited = self._limited, near.tolist()
        if not (self._limited or were_limited or self._commanded):
            return
        ahead: list[float] = []
        for row in self._limited:
            name, gap_m = self._leader(ids[row], LOOK_AHEAD_M) or NO_LEADER
            if name:
                ahead += row, gap_m, self._speed(name)
        leaders = packed(ahead, len(ahead) // 3) if ahead else NO_LEADERS
        chosen = packed([*map(self._chosen, self._commanded)], 1)[0] if self._commanded else NONE
        requested = self._requested
        count = requested_speeds.fast(
            motion, limits, *wishes, chosen, leaders, step_s, requested, rows
        )
        changed = rows[:count]
        for row, speed in zip(changed.tolist(), requested[changed].tolist(), strict=True):
            self._set_speed(ids[row], speed)


NO_LEADER = ("", -1.0)
"""What SUMO says where no vehicle is ahead; traci says None."""
NO_LEADERS, NONE = np.empty((0, 3)), np.empty(0)


@compiled
def near_limit(
    motion: FloatArray,
    limits: FloatArray,
    commanded: IntArray,
    wanted_m_s2: FloatArray,
    elapsed_s: float,
    step_s: float,
    lap_m: float,
    lane_width_m: float,
    known_m: float,
    rows: IntArray,
) -> int:
    """Find the vehicles whose ``stoppable_speed`` may limit their speed after the next step.

    For all others it is greater than every speed that they can reach by then, because the vehicle
    ahead is far enough or fast enough. The vehicle ahead is any vehicle whose body may overlap the
    lane of the vehicle behind: since the decision began, each has moved sideways at most with its
    ``getMaxSpeedLat``. Along the road, a SUMO step moves a vehicle by its new speed.

    Args:
        motion: Its rows are S, Y (of the start of the decision), SPEED and BEFORE, one column for
            each vehicle, the ego first. The function moves S on if a step has been made.
        limits: Its rows are LENGTH to GAP.
        commanded: The row of each vehicle that a driver of ours drives.
        wanted_m_s2: The acceleration that it wants.
        elapsed_s: The time since the decision began, seconds.
        step_s: The length of a SUMO step.
        lap_m: The length of a lap of the road, metres.
        lane_width_m: The width of a lane.
        known_m: The position up to which no other vehicle can be; one beyond it may stand.
        rows: An array of shape (1 + N,), whose first elements the function sets to the vehicles'
            rows, in ascending order.

    Returns:
        The number of rows.
    """
    n, count = motion.shape[1], 0
    speed_m_s, half_s = motion[SPEED], step_s / 2
    if elapsed_s > 0.0:
        motion[S] += speed_m_s * step_s
    most_m_s2, front_m = limits[ACCELERATION].copy(), motion[S] + limits[LENGTH] / 2
    aside_m = limits[ASIDE] * elapsed_s + MARGIN_M
    right_m = motion[Y] - limits[WIDTH] / 2 - aside_m
    left_m = motion[Y] + limits[WIDTH] / 2 + aside_m
    rear_m = front_m - limits[LENGTH]
    for one in range(len(commanded)):
        most_m_s2[commanded[one]] = max(most_m_s2[commanded[one]], wanted_m_s2[one])
    for row in range(1, n):
        lowest = lane_of(motion[Y, row] - aside_m[row], lane_width_m)
        highest = lane_of(motion[Y, row] + aside_m[row], lane_width_m)
        from_m, to_m = (lowest - 0.5) * lane_width_m, (highest + 0.5) * lane_width_m
        halved, fastest_m_s = 0.5 / limits[BRAKING, row], speed_m_s[row] + most_m_s2[row] * step_s
        needed_m = fastest_m_s * (fastest_m_s * halved + half_s) + MARGIN_M
        at_m = front_m[row] + limits[GAP, row]
        found = known_m - at_m < needed_m
        for other in range(n):  # without a branch, so that it is compiled to vector instructions
            ahead_m = front_m[other] - front_m[row] + MARGIN_M
            laps = (1.0 if ahead_m < 0.0 else 0.0) - (1.0 if ahead_m >= lap_m else 0.0)
            gap_m = rear_m[other] - at_m + laps * lap_m
            rest_m = speed_m_s[other] * (speed_m_s[other] * halved - half_s)
            room_m = max(gap_m, 0.0) + max(rest_m, 0.0)
            beside = (left_m[other] >= from_m) & (right_m[other] <= to_m)
            found |= beside & (room_m < needed_m) & (other != row)
        if found:
            rows[count] = row
            count += 1
    return count


@compiled
def requested_speeds(
    motion: FloatArray,
    limits: FloatArray,
    commanded: IntArray,
    wanted_m_s2: FloatArray,
    chosen_m_s: FloatArray,
    leaders: FloatArray,
    step_s: float,
    requested_m_s: FloatArray,
    rows: IntArray,
) -> int:
    """Set ``requested_m_s`` to the speed to request for each vehicle, or to ``LEFT_TO_SUMO``.

    Args:
        motion: As in ``near_limit``. The function sets BEFORE to SPEED at its end.
        limits: As in ``near_limit``, and likewise the next two.
        commanded: The row of each vehicle that a driver of ours drives.
        wanted_m_s2: The acceleration that it wants.
        chosen_m_s: The speed that SUMO's models chose for it in the last step.
        leaders: For each vehicle near its limit: its row; the gap to the vehicle ahead, without
            SUMO's minimum gap; and the speed of the vehicle ahead. The shape is (vehicles, 3).
        step_s: The length of a SUMO step, seconds.
        requested_m_s: The speeds requested before; the function changes them, shape (1 + N,).
        rows: An array of shape (1 + N,), whose first elements the function sets to the rows in
            which ``requested_m_s`` has changed.

    Returns:
        The number of these rows.
    """
    n, count = motion.shape[1], 0
    most, now = np.full(n, np.inf), np.full(n, LEFT_TO_SUMO)
    for one in range(len(leaders)):
        row = int(leaders[one, 0])
        most[row] = stoppable_speed(leaders[one, 1], leaders[one, 2], limits[BRAKING, row], step_s)
        accel_m_s2 = limits[ACCELERATION, row]
        now[row] = limited_speed(most[row], motion[SPEED, row], accel_m_s2, step_s)
    for one in range(len(commanded)):
        row = commanded[one]
        speed, braking_m_s2 = motion[SPEED, row], limits[BRAKING, row]
        wanted, chosen = wanted_m_s2[one], chosen_m_s[one]
        braked_m_s2 = (speed - motion[BEFORE, row]) / step_s
        now[row] = wished_speed(most[row], speed, wanted, chosen, braked_m_s2, braking_m_s2, step_s)
    for row in range(EGO + 1, n):
        if now[row] != requested_m_s[row]:
            requested_m_s[row], rows[count] = now[row], row
            count += 1
    motion[BEFORE] = motion[SPEED]
    return count


def limited_speed(most: float, speed: float, acceleration_m_s2: float, step_s: float) -> float:
    """Return the request to a vehicle that SUMO drives, at most ``most``; m/s."""
    return most if most < speed + acceleration_m_s2 * step_s else LEFT_TO_SUMO


def wished_speed(
    most: float,
    speed: float,
    wanted_m_s2: float,
    without_m_s: float,
    now_m_s2: float,
    braking_m_s2: float,
    step_s: float,
) -> float:
    """Return the request to a vehicle that wants an acceleration, at most ``most``; m/s.

    SUMO must keep control of the speed while its models brake the vehicle themselves. It does so to
    make room for a lane change, and in an emergency, in which it brakes harder than a request may.
    SUMO keeps control until it brakes normally again. ``without_m_s`` is the speed that SUMO's
    models chose in the last step, ``now_m_s2`` the acceleration in this step.
    """
    brakes = without_m_s < speed - 1e-6 or now_m_s2 < -braking_m_s2 - 1e-6
    if most >= speed and brakes:
        return LEFT_TO_SUMO
    return min(most, max(0.0, speed + wanted_m_s2 * step_s))


def stoppable_speed(gap_m: float, ahead_m_s: float, braking_m_s2: float, step_s: float) -> float:
    """Return the largest speed, m/s, from which a vehicle can stop behind the vehicle ahead.

    The formula is ours, with h = ``step_s``: both vehicles brake with b, the limit of the vehicle
    behind. The vehicle ahead brakes at once from speed u and covers u^2 / 2b - u h / 2. The vehicle
    behind first drives one step at speed v and covers v^2 / 2b + v h / 2 in all. When both stand,
    ``gap_m`` is used up, and SUMO's minimum gap, which it does not contain, is left between them.
    """
    room_m = max(gap_m, 0.0) + rest_of_way(ahead_m_s, braking_m_s2, step_s)
    b = braking_m_s2
    return b * (math.sqrt(squared(step_s) / 4 + 2 * room_m / b) - step_s / 2)


def rest_of_way(speed_m_s: float, braking_m_s2: float, step_s: float) -> float:
    """Return the distance, metres, that a vehicle covers which brakes at once until it stands."""
    return max(squared(speed_m_s) / (2 * braking_m_s2) - speed_m_s * step_s / 2, 0.0)
