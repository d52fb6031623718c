"""The auditor: which vehicles broke which of the bounds that ``strict`` assumes, and when."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.safety.reachability import STILL_M_S, lanes_under
from drl_av.safety.stopping import cut_in_gap, stopping_distance
from drl_av.traffic.road import ARRIVED_M, FloatArray, Road
from drl_av.traffic.snapshot import EGO, Snapshot

BoolArray = npt.NDArray[np.bool_]
TOLERANCE = 1e-6
BRAKED = "braked too hard"
ACCELERATED = "accelerated too hard"
SIDEWAYS = "moved sideways too fast"
CUT_IN = "cut in too close ahead of the ego"
BESIDE = "moved into the ego's lane beside it"
TOO_FAST = "moved in behind the ego too fast to stay there"
BEHIND = "did not stay behind the ego"


class Breach(NamedTuple):
    """One bound, broken once."""

    time_s: float
    vehicle: str
    bound: str


class Auditor:
    """Records the broken bounds of an episode, SUMO step by SUMO step."""

    def __init__(self, config: Config, road: Road) -> None:
        self._config, self._road = config, road
        self.start()

    def start(self) -> None:
        """Clear the records before a new episode."""
        self.breaches: list[Breach] = []
        self.cut_ins_m: list[float] = []
        """By how much each cut-in ahead of the ego exceeded the gap it had to leave."""
        self._before: Snapshot | None = None
        self._ego_m_s2 = 0.0
        self._lane_s = np.full(len(self._road.open_lanes), np.inf)

    def watch(self, after: Snapshot) -> None:
        """Compare the vehicles with those one SUMO step before; the first call only stores them."""
        before, self._before = self._before, after
        if before is None or len(before.ids) == 1:
            return
        step_s = self._config.simulation.step_length_s
        strict = self._config.strict
        rates = (after.speed_m_s - before.speed_m_s) / step_s
        self._ego_m_s2, acceleration = float(rates[EGO]), rates[1:]
        sideways = np.abs(after.y_m - before.y_m)[1:] / step_s
        self._tell(after, -acceleration > strict.braking_m_s2 + TOLERANCE, BRAKED)
        self._tell(after, acceleration > strict.acceleration_m_s2 + TOLERANCE, ACCELERATED)
        self._tell(after, sideways > strict.lateral_speed_m_s + TOLERANCE, SIDEWAYS)
        self._watch_sides(before, after)
        self._watch_followers(before, after, acceleration)

    def explain(self, vehicle: str, since_s: float) -> str:
        """The bounds that a vehicle broke since then, in words; empty without any."""
        found = {b.bound for b in self.breaches if b.vehicle == vehicle and b.time_s >= since_s}
        return "; ".join(sorted(found))

    def _record(self, after: Snapshot, row: int, bound: str) -> None:
        self.breaches.append(Breach(after.time_s, after.ids[row], bound))

    def _tell(self, after: Snapshot, broken: BoolArray, bound: str) -> None:
        for row in np.flatnonzero(broken):
            self._record(after, int(row) + 1, bound)

    def _ahead_m(self, shot: Snapshot) -> FloatArray:
        """Distances ahead of the ego round the loop, m, from 0 to its length; shape (vehicles,)."""
        ahead_m: FloatArray = (shot.s_m - shot.s_m[EGO]) % self._road.lap_m
        return ahead_m

    def _watch_sides(self, before: Snapshot, after: Snapshot) -> None:
        """Check bound 3 for vehicles that began to move into the ego's lanes in this SUMO step.

        A lane that the ego leaves in this step does not count: SUMO moves a vehicle after those
        ahead of it.
        """
        step_s, width_m = self._config.simulation.step_length_s, self._road.lane_width_m
        lowest, highest = lanes_under(before.y_m, before.width_m, width_m)
        stays = lanes_under(after.y_m[EGO], after.width_m[EGO], width_m)
        ego_lowest, ego_highest = max(lowest[EGO], stays[0]), min(highest[EGO], stays[1])
        earlier_m = before.y_m - before.lateral_speed_m_s * step_s
        moved_m = after.y_m - before.y_m
        for row in np.flatnonzero(np.abs(moved_m) > STILL_M_S * step_s).tolist():
            side, lane = self._heading(before.y_m[row], after.y_m[row])
            goes_on = (side, lane) == self._heading(earlier_m[row], before.y_m[row])
            arrived = abs(before.y_m[row] - lane * width_m) <= ARRIVED_M
            is_in = lowest[row] <= lane <= highest[row]
            if row == EGO or goes_on or arrived or is_in:
                continue
            if ego_lowest <= lane <= ego_highest:
                there = (lowest <= lane) & (lane <= highest) & (np.arange(len(moved_m)) != row)
                self._judge_entry(after, row, there)

    def _heading(self, from_m: float, to_m: float) -> tuple[int, int]:
        """Side and lane that a vehicle moves to; past a centre it is bound for the next lane."""
        width_m, side = self._road.lane_width_m, int(np.sign(to_m - from_m))
        lane = math.ceil if side > 0 else math.floor
        return side, lane((to_m - side * ARRIVED_M) / width_m)

    def _judge_entry(self, after: Snapshot, row: int, there: BoolArray) -> None:
        """Record a vehicle that moves into the ego's lane with too small a gap.

        ``there`` marks the vehicles that already are in the lane.
        """
        lengths_m = (after.length_m[row] + after.length_m[EGO]) / 2
        ahead_m, lap_m = self._ahead_m(after), self._road.lap_m
        gap_m, behind_m = ahead_m[row] - lengths_m, lap_m - ahead_m[row] - lengths_m
        if min(gap_m, behind_m) <= 0:
            self._record(after, row, BESIDE)
            return
        there[EGO] = False
        if not (there & (ahead_m < ahead_m[row])).any():
            self._judge_cut_in(after, row, float(gap_m), gap_m < behind_m)
        if not (there & (ahead_m > ahead_m[row])).any() and self._must_hit(after, behind_m)[row]:
            self._record(after, row, TOO_FAST)

    def _judge_cut_in(self, after: Snapshot, row: int, gap_m: float, is_nearer: bool) -> None:
        config = self._config
        ego_m_s, other_m_s = after.speed_m_s[EGO], after.speed_m_s[row]
        rate = self._ego_m_s2
        needs_m = cut_in_gap(ego_m_s, rate, other_m_s, config.strict, config.ego, config.simulation)
        if is_nearer:
            self.cut_ins_m.append(float(gap_m - needs_m))
        if gap_m <= needs_m:
            self._record(after, row, CUT_IN)

    def _must_hit(self, shot: Snapshot, behind_m: FloatArray | float) -> BoolArray:
        """Which vehicles could not stop behind the ego if both braked fully from now on."""
        strict, step_s = self._config.strict, self._config.simulation.step_length_s
        rolled_m = stopping_distance(shot.speed_m_s, strict.braking_m_s2, step_s)
        hard_m_s2 = self._config.ego.hard_brake_m_s2
        rest_m = behind_m + stopping_distance(shot.speed_m_s[EGO], hard_m_s2, step_s)
        result: BoolArray = rolled_m > rest_m
        return result

    def _watch_followers(self, before: Snapshot, after: Snapshot, acceleration: FloatArray) -> None:
        """Check bound 4: a vehicle behind that braked too little to avoid a hard-braking ego."""
        strict, step_s = self._config.strict, self._config.simulation.step_length_s
        lanes = np.arange(len(self._lane_s))
        lowest, highest = lanes_under(before.y_m, before.width_m, self._road.lane_width_m)
        over = (lowest[EGO] <= lanes) & (lanes <= highest[EGO])
        theirs = (lowest[1:, None] <= lanes) & (lanes <= highest[1:, None])
        shared_s = np.where(theirs & over, self._lane_s, -1.0).max(axis=1)
        self._lane_s = np.where(over, self._lane_s + step_s, 0.0)
        behind_m = -self._ahead_m(after) % self._road.lap_m
        gap_m = behind_m - (after.length_m + after.length_m[EGO]) / 2
        near = (gap_m > -after.length_m) & (gap_m < 100.0)
        late = (self._must_hit(after, gap_m) & near)[1:]
        idle = (acceleration > -strict.follower_braking_m_s2 + TOLERANCE) & (
            after.speed_m_s[1:] > 0
        )
        self._tell(after, late & idle & (shared_s >= strict.follower_response_s), BEHIND)
