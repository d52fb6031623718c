"""Who broke which of the bounds that ``driving/strict.py`` puts on the other vehicles, and when."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.safety.reachability import CENTERED_M, STILL_M_S, lanes_under
from drl_av.safety.stopping import cut_in_gap, stopping_distance
from drl_av.traffic.road import FloatArray, Road
from drl_av.traffic.snapshot import EGO, Snapshot

BoolArray = npt.NDArray[np.bool_]
TOLERANCE = 1e-6
BRAKED = "braked too hard"
ACCELERATED = "accelerated too hard"
SIDEWAYS = "moved sideways too fast"
CUT_IN = "cut in too close ahead of the ego"
BESIDE = "moved into the ego's lane beside it"
BEHIND = "did not stay behind the ego"


class Breach(NamedTuple):
    """One bound, broken once."""

    time_s: float
    vehicle: str
    bound: str


class Auditor:
    """Watches an episode SUMO step by SUMO step."""

    def __init__(self, config: Config, road: Road) -> None:
        self._config, self._road = config, road
        self.start()

    def start(self) -> None:
        """Forget; a new episode begins."""
        self.breaches: list[Breach] = []
        self.cut_ins_m: list[float] = []
        """By how much each cut-in ahead of the ego exceeded the gap it had to leave."""
        self._before: Snapshot | None = None
        self._ego_m_s2 = 0.0
        self._lane_s = np.full(len(self._road.open_lanes), np.inf)

    def watch(self, after: Snapshot) -> None:
        """Look at the vehicles after a SUMO step; the first call only remembers."""
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

    def _tell(self, after: Snapshot, broken: BoolArray, bound: str) -> None:
        for row in np.flatnonzero(broken):
            self.breaches.append(Breach(after.time_s, after.ids[row + 1], bound))

    def _ahead_m(self, shot: Snapshot) -> FloatArray:
        return self._road.ahead_m(float(shot.s_m[EGO]), shot.s_m)

    def _watch_sides(self, before: Snapshot, after: Snapshot) -> None:
        """Bound 3, for those that began to move sideways in this SUMO step."""
        width_m = self._road.lane_width_m
        moved_m, ahead_m = after.y_m - before.y_m, self._ahead_m(after)
        lowest, highest = lanes_under(before.y_m, before.width_m, width_m)
        for row in np.flatnonzero(np.abs(moved_m) > STILL_M_S):
            side = 1 if moved_m[row] > 0 else -1
            place = before.y_m[row] / width_m
            centered = abs(place - round(place)) * width_m <= CENTERED_M
            goes_on = before.lateral_speed_m_s[row] * side > STILL_M_S and not centered
            lane = round(place) + side if centered else int(np.floor(place) + (side > 0))
            is_in = lowest[row] <= lane <= highest[row]
            arrived = (
                centered and abs(after.y_m[row] / width_m - round(place)) * width_m <= CENTERED_M
            )
            if row == EGO or arrived or goes_on or is_in or not lowest[EGO] <= lane <= highest[EGO]:
                continue
            there = (lowest <= lane) & (lane <= highest) & (np.arange(len(moved_m)) != row)
            self._judge_cut_in(after, int(row), there, ahead_m)

    def _judge_cut_in(
        self, after: Snapshot, row: int, there: BoolArray, ahead_m: FloatArray
    ) -> None:
        gap_m = abs(ahead_m[row]) - (after.length_m[row] + after.length_m[EGO]) / 2
        if gap_m <= 0:
            self.breaches.append(Breach(after.time_s, after.ids[row], BESIDE))
            return
        between = there & (ahead_m > 0) & (ahead_m < ahead_m[row])
        if ahead_m[row] < 0 or between.any():
            return
        config = self._config
        ego_m_s, other_m_s = after.speed_m_s[EGO], after.speed_m_s[row]
        rate = self._ego_m_s2
        needs_m = cut_in_gap(ego_m_s, rate, other_m_s, config.strict, config.ego, config.simulation)
        self.cut_ins_m.append(float(gap_m - needs_m))
        if gap_m <= needs_m:
            self.breaches.append(Breach(after.time_s, after.ids[row], CUT_IN))

    def _watch_followers(self, before: Snapshot, after: Snapshot, acceleration: FloatArray) -> None:
        """Bound 4: braked less than it must, and has to hit the ego now if that brakes hard."""
        strict, step_s = self._config.strict, self._config.simulation.step_length_s
        lanes = np.arange(len(self._lane_s))
        lowest, highest = lanes_under(before.y_m, before.width_m, self._road.lane_width_m)
        over = (lowest[EGO] <= lanes) & (lanes <= highest[EGO])
        theirs = (lowest[1:, None] <= lanes) & (lanes <= highest[1:, None])
        shared_s = np.where(theirs & over, self._lane_s, -1.0).max(axis=1)
        self._lane_s = np.where(over, self._lane_s + step_s, 0.0)
        gap_m = -self._ahead_m(after)[1:] - (after.length_m[1:] + after.length_m[EGO]) / 2
        rolled_m = stopping_distance(after.speed_m_s[1:], strict.braking_m_s2, step_s)
        hard_m_s2 = self._config.ego.hard_brake_m_s2
        rest_m = gap_m + stopping_distance(after.speed_m_s[EGO], hard_m_s2, step_s)
        late = (gap_m > -after.length_m[1:]) & (gap_m < 100.0) & (rolled_m > rest_m)
        idle = (acceleration > -strict.follower_braking_m_s2 + TOLERANCE) & (
            after.speed_m_s[1:] > 0
        )
        self._tell(after, late & idle & (shared_s >= strict.follower_response_s), BEHIND)
