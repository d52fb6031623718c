"""The auditor: records which vehicles break the bounds that ``strict`` assumes, and when.

It compares the positions at the ends of the SUMO steps. It therefore misses a breach of bound 3 if
two vehicles are side by side only in the middle of a step, for example while one passes the other.
"""

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray
from drl_av.config import Config
from drl_av.road.road import ARRIVED_M, Road
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.road.sweep import NO_CONTACT, contact, moved
from drl_av.safety.reachability import STILL_M_S, cut_in_gap, lanes_under, stopping_distance

TOLERANCE = 1e-6
BRAKED = "braked too hard"
ACCELERATED = "accelerated too hard"
SIDEWAYS = "moved sideways too fast"
CUT_IN = "cut in too close ahead of the ego"
BESIDE = "moved into the ego's lane beside it"
TOO_FAST = "moved in behind the ego too fast to stay there"
BEHIND = "did not stay behind the ego"
BRAKES = "the ego brakes"
LEAVES = "it is leaving the lane of the ego"
BETWEEN = "it begins between the centres of two lanes"
THROUGH = "it goes on past the centre of a lane without stopping there"
SOONER = "it kept the bound a SUMO step sooner"
"""Circumstances of a breach. SOONER means that the move obeyed the bound at the positions before
the SUMO step, on which the vehicle's driver decided."""


class Breach(NamedTuple):
    """A bound of ``strict`` that a vehicle broke in one SUMO step."""

    time_s: float
    vehicle: str
    bound: str
    circumstance: str = ""
    """One of the circumstances above, such as ``SOONER``, or empty."""


def in_both(*shots: Snapshot) -> list[Snapshot]:
    """Return two snapshots with those vehicles only that are in both, in the same order."""
    common = [name for name in shots[0].ids if name in set(shots[1].ids)]
    return [shot.of_rows([shot.ids.index(name) for name in common]) for shot in shots]


def touching(before: Snapshot, after: Snapshot, road: Road) -> list[tuple[str, str]]:
    """Return each pair of vehicles, by id, that touch each other in a SUMO step."""
    columns = before.s_m, before.y_m, after.s_m, after.y_m, after.length_m, after.width_m
    rows = zip(after.ids, *(column.tolist() for column in columns), strict=True)
    bodies = [
        (name, moved(s_m, y_m, to_s_m, to_y_m, road.lap_m), length_m, width_m)
        for name, s_m, y_m, to_s_m, to_y_m, length_m, width_m in rows
    ]
    return [
        (one, other)
        for (one, its, a_m, b_m), (other, others, c_m, d_m) in combinations(bodies, 2)
        if contact(its, others, (a_m + c_m) / 2, (b_m + d_m) / 2, road.lap_m)[1] != NO_CONTACT
    ]


class Auditor:
    """Records the broken bounds of an episode, SUMO step by SUMO step."""

    def __init__(self, config: Config, road: Road) -> None:
        self._config, self._road = config, road
        self.start()

    def start(self) -> None:
        """Clear the records before a new episode."""
        self.breaches: list[Breach] = []
        self.cut_ins_m: list[float] = []
        """For each cut-in ahead of the ego, its gap minus the smallest permitted gap."""
        self._before: Snapshot | None = None
        self._ego_m_s2 = (0.0, 0.0)
        """The ego's acceleration in the step before this one, and in this one."""
        self._lane_s = np.full(len(self._road.open_lanes), np.inf)

    def watch(self, after: Snapshot) -> None:
        """Compare a snapshot with that of one SUMO step before; the first call only stores it.

        A vehicle that has entered an open road or left it in between is not compared.
        """
        before, self._before = self._before, after
        if before is not None and before.ids != after.ids:
            before, after = in_both(before, after)
        if before is None or len(before.ids) == 1:
            return
        step_s = self._config.simulation.step_length_s
        strict = self._config.strict
        rates = (after.speed_m_s - before.speed_m_s) / step_s
        self._ego_m_s2 = (self._ego_m_s2[1], float(rates[EGO]))
        acceleration = rates[1:]
        sideways = np.abs(after.y_m - before.y_m)[1:] / step_s
        self._tell(after, -acceleration > strict.braking_m_s2 + TOLERANCE, BRAKED)
        self._tell(after, acceleration > strict.acceleration_m_s2 + TOLERANCE, ACCELERATED)
        self._tell(after, sideways > strict.lateral_speed_m_s + TOLERANCE, SIDEWAYS)
        self._watch_sides(before, after)
        self._watch_followers(before, after, acceleration)

    def explain(self, vehicle: str, since_s: float) -> str:
        """Return, as text, the bounds that a vehicle has broken since a time; empty if none."""
        found = {b.bound for b in self.breaches if b.vehicle == vehicle and b.time_s >= since_s}
        return "; ".join(sorted(found))

    def _record(self, after: Snapshot, row: int, bound: str, circumstance: str = "") -> None:
        self.breaches.append(Breach(after.time_s, after.ids[row], bound, circumstance))

    def _tell(self, after: Snapshot, broken: BoolArray, bound: str, circumstance: str = "") -> None:
        for row in np.flatnonzero(broken):
            self._record(after, int(row) + 1, bound, circumstance)

    def _ahead_m(self, shot: Snapshot) -> FloatArray:
        """Return each vehicle's distance ahead of the ego, m, in [0, lap), shape (1 + others,)."""
        result: FloatArray = (shot.s_m - shot.s_m[EGO]) % self._road.lap_m
        return result

    def _watch_sides(self, before: Snapshot, after: Snapshot) -> None:
        """Record each vehicle that breaks bound 3 as it begins to move into a lane of the ego.

        Bound 3 is the gap that such a vehicle must leave to the ego. The ego's lanes are those that
        its body overlaps before and after the step. A lane that the ego leaves in the step does not
        count, because SUMO moves the vehicles behind the ego after the ego. A vehicle ahead of the
        ego may move from one of the ego's lanes to another.
        """
        step_s, width_m = self._config.simulation.step_length_s, self._road.lane_width_m
        lowest, highest = lanes_under(before.y_m, before.width_m, width_m)
        stays = lanes_under(after.y_m[EGO], after.width_m[EGO], width_m)
        ego_lowest, ego_highest = max(lowest[EGO], stays[0]), min(highest[EGO], stays[1])
        earlier_m = before.y_m - before.lateral_speed_m_s * step_s
        moved_m = after.y_m - before.y_m
        moved = np.abs(before.lateral_speed_m_s) > STILL_M_S
        lowest_after, highest_after = lanes_under(after.y_m, after.width_m, width_m)
        enters = (lowest_after < lowest) | (highest_after > highest)
        for row in np.flatnonzero((np.abs(moved_m) > STILL_M_S * step_s) | enters).tolist():
            side, lane = self._heading(before.y_m[row], after.y_m[row])
            goes_on = moved[row] and (side, lane) == self._heading(earlier_m[row], before.y_m[row])
            arrived = abs(before.y_m[row] - lane * width_m) <= ARRIVED_M
            is_in = lowest[row] <= lane <= highest[row]
            if row == EGO or goes_on or arrived or is_in:
                continue
            if ego_lowest <= lane <= ego_highest:
                there = (lowest <= lane) & (lane <= highest) & (np.arange(len(moved_m)) != row)
                is_met = lowest[row] <= highest[EGO] and lowest[EGO] <= highest[row]
                self._judge_entry(before, after, row, there, is_met)

    def _heading(self, from_m: float, to_m: float) -> tuple[int, int]:
        """Return the side, left +1 or right -1, and the lane to whose centre a vehicle moves."""
        width_m, side = self._road.lane_width_m, int(np.sign(to_m - from_m))
        lane = math.ceil if side > 0 else math.floor
        return side, lane((to_m - side * ARRIVED_M) / width_m)

    def _judge_entry(
        self, before: Snapshot, after: Snapshot, row: int, there: BoolArray, is_met: bool
    ) -> None:
        """Record the vehicle ``row`` if it enters the ego's lane with too small a gap.

        ``there`` marks the other vehicles in this lane. ``is_met`` is whether the vehicle was in a
        lane of the ego before the step.
        """
        ahead_m = self._ahead_m(after)
        gap_m, behind_m = self._gaps(after, row)
        if min(gap_m, behind_m) <= 0:
            self._record(after, row, BESIDE, self._began(before, row))
            return
        there[EGO] = False
        if not is_met and not (there & (ahead_m < ahead_m[row])).any():
            self._judge_cut_in(before, after, row)
        if not (there & (ahead_m > ahead_m[row])).any() and self._must_hit(after, behind_m)[row]:
            sooner = not self._must_hit(before, self._gaps(before, row)[1])[row]
            self._record(after, row, TOO_FAST, SOONER if sooner else self._began(before, row))

    def _gaps(self, shot: Snapshot, row: int) -> tuple[float, float]:
        """Return a vehicle's gap, m, ahead of the ego and behind it; on a loop it has both."""
        lengths_m = (shot.length_m[row] + shot.length_m[EGO]) / 2
        ahead_m = self._ahead_m(shot)[row]
        return float(ahead_m - lengths_m), float(self._road.lap_m - ahead_m - lengths_m)

    def _began(self, before: Snapshot, row: int) -> str:
        """Return ``BETWEEN`` or ``THROUGH`` if a move began elsewhere than at rest in a lane."""
        lane = before.y_m[row] / self._road.lane_width_m
        off_m = abs(lane - round(lane)) * self._road.lane_width_m
        moved = abs(before.lateral_speed_m_s[row]) > STILL_M_S
        return BETWEEN if off_m > ARRIVED_M else THROUGH if moved else ""

    def _judge_cut_in(self, before: Snapshot, after: Snapshot, row: int) -> None:
        rate_before, rate = self._ego_m_s2
        margin_m = self._cut_in_margin_m(after, row, rate)
        gap_m, behind_m = self._gaps(after, row)
        if gap_m < behind_m:
            self.cut_ins_m.append(margin_m)
        if margin_m <= 0:
            sooner = self._cut_in_margin_m(before, row, rate_before) > 0
            self._record(after, row, CUT_IN, SOONER if sooner else self._began(before, row))

    def _cut_in_margin_m(self, shot: Snapshot, row: int, rate: float) -> float:
        """Return the gap ahead of the ego minus the smallest gap of a permitted cut-in, m."""
        config, speeds = self._config, (shot.speed_m_s[EGO], rate, shot.speed_m_s[row])
        needs_m = cut_in_gap(*speeds, config.strict, config.ego, config.simulation)
        return self._gaps(shot, row)[0] - float(needs_m)

    def _must_hit(self, shot: Snapshot, behind_m: FloatArray | float) -> BoolArray:
        """Return which vehicles would hit the ego from behind if both braked hard.

        The vehicles brake with ``strict.follower_braking_m_s2``, on which the check relies, even if
        ``strict.braking_m_s2`` permits vehicles ahead to brake harder. ``behind_m`` is the gap of
        each vehicle to the ego ahead of it, m. The result has shape (1 + others,).
        """
        strict, step_s = self._config.strict, self._config.simulation.step_length_s
        rolled_m = stopping_distance(shot.speed_m_s, strict.follower_braking_m_s2, step_s)
        hard_m_s2 = self._config.ego.hard_brake_m_s2
        rest_m = behind_m + stopping_distance(shot.speed_m_s[EGO], hard_m_s2, step_s)
        result: BoolArray = rolled_m > rest_m
        return result

    def _watch_followers(self, before: Snapshot, after: Snapshot, acceleration: FloatArray) -> None:
        """Record each vehicle behind the ego that breaks bound 4.

        Such a vehicle shares a lane with the ego before and after the step. It brakes too little,
        although it could not stop behind an ego that brakes hard.
        """
        strict, step_s = self._config.strict, self._config.simulation.step_length_s
        theirs, over = self._lanes(before)
        shared_s = np.where(theirs & over, self._lane_s, -1.0).max(axis=1)
        self._lane_s = np.where(over, self._lane_s + step_s, 0.0)
        theirs_after, over_after = self._lanes(after)
        shares = (theirs_after & over_after).any(axis=1)
        behind_m = -self._ahead_m(after) % self._road.lap_m
        gap_m = behind_m - (after.length_m + after.length_m[EGO]) / 2
        near = (gap_m > -after.length_m) & (gap_m < 100.0)
        late = (self._must_hit(after, gap_m) & near)[1:]
        idle = (acceleration > -strict.follower_braking_m_s2 + TOLERANCE) & (
            after.speed_m_s[1:] > 0
        )
        responds = shares & (shared_s >= strict.follower_response_s)
        aside_m = (after.y_m - after.y_m[EGO])[1:]
        leaves = (after.y_m - before.y_m)[1:] * np.sign(aside_m) > STILL_M_S * step_s
        breaks, brakes = late & idle & responds, BRAKES if self._ego_m_s2[1] < 0 else ""
        self._tell(after, breaks & leaves, BEHIND, LEAVES)
        self._tell(after, breaks & ~leaves, BEHIND, brakes)

    def _lanes(self, shot: Snapshot) -> tuple[BoolArray, BoolArray]:
        """Return which lanes the others, (others, lanes), and the ego, (lanes,), overlap."""
        lowest, highest = lanes_under(shot.y_m, shot.width_m, self._road.lane_width_m)
        lanes = np.arange(len(self._lane_s))
        over: BoolArray = (lowest[:, None] <= lanes) & (lanes <= highest[:, None])
        return over[1:], over[EGO]
