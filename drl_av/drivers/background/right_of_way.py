"""Decides the right of way of two vehicles that want to enter the same lane from opposite sides.

Neither vehicle is in that lane yet, so neither counts in the other's gaps. Without this rule both
would begin and could collide in the middle of the lane.
"""

from collections.abc import Sequence
from typing import NamedTuple

from drl_av.config import SimulationConfig
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot, TrafficCommand
from drl_av.safety.stopping import stopping_distance


class Entry(NamedTuple):
    """A vehicle that is entering a lane, or that wants to enter it."""

    row: int
    """The vehicle's row index in the snapshot arrays."""
    lane: int
    """Index of the lane it enters."""


def give_way(
    traffic_commands: Sequence[TrafficCommand],
    snapshot: Snapshot,
    road: Road,
    braking_m_s2: float,
    timing: SimulationConfig,
) -> list[TrafficCommand]:
    """Return the commands without the lane changes that conflict with another vehicle's.

    Two vehicles conflict if they enter the same lane from opposite sides, and the rear vehicle
    could not stop behind the front vehicle by braking with ``braking_m_s2`` from the next decision
    on. A vehicle that is already changing lanes has priority. Between two others, the vehicle whose
    command comes first in ``traffic_commands`` has priority.
    """
    if not any(command.side for command in traffic_commands):
        return list(traffic_commands)
    entries = _under_way(snapshot, road)
    allowed = []
    for command in traffic_commands:
        if command.side:
            lane = road.lane_of(float(snapshot.y_m[command.row])) + command.side
            entry = Entry(command.row, lane)
            if any(_meet(entry, other, snapshot, road, braking_m_s2, timing) for other in entries):
                command = command._replace(side=0)
            else:
                entries.append(entry)
        allowed.append(command)
    return allowed


def _under_way(snapshot: Snapshot, road: Road) -> list[Entry]:
    """Return each vehicle that moves sideways; its lane is the one whose centre it reaches next."""
    entries = []
    for row, speed in enumerate(snapshot.lateral_speed_m_s.tolist()):
        if speed:
            y_m = float(snapshot.y_m[row])
            lane = road.lane_of(y_m)
            leaves = (y_m - road.center_m(lane)) * speed >= 0.0
            entries.append(Entry(row, lane + (1 if speed > 0 else -1) * leaves))
    return entries


def _meet(
    one: Entry,
    other: Entry,
    snapshot: Snapshot,
    road: Road,
    braking_m_s2: float,
    timing: SimulationConfig,
) -> bool:
    center_m = road.center_m(one.lane)
    sides = [float(snapshot.y_m[entry.row]) < center_m for entry in (one, other)]
    if one.lane != other.lane or sides[0] == sides[1]:
        return False
    ahead_m = float(road.ahead_m(snapshot.s_m[one.row], snapshot.s_m[other.row]))
    rear, front = (one.row, other.row) if ahead_m >= 0.0 else (other.row, one.row)
    lengths_m = snapshot.length_m[[one.row, other.row]]
    gap_m = abs(ahead_m) - float(lengths_m.sum()) / 2
    fast, slow = (float(snapshot.speed_m_s[row]) for row in (rear, front))
    step_s = timing.step_length_s
    fast_m, slow_m = (stopping_distance(speed, braking_m_s2, step_s) for speed in (fast, slow))
    rolled_m = timing.decision_interval_s * fast + max(float(fast_m - slow_m), 0.0)
    return gap_m < STANDSTILL_GAP_M + rolled_m
