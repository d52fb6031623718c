"""The columns of ``drl-av evaluate --criticality``: comfort, and surrogate safety measures.

Like the other columns, they are measured once per decision. Accelerations and jerks are means over
a decision, so peaks within a decision are not seen. The measures themselves are pure functions.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.env.metrics import (
    CHANGE_M_S,
    CRAWLING_M_S,
    FORCED_M_S2,
    SHORT_HEADWAY_S,
    EpisodeMetrics,
    EpisodeResult,
    leader,
)
from drl_av.env.transition import Transition
from drl_av.evaluation.statistics import grouped
from drl_av.files.table import PossiblyInfinite
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.safety.paper import closing_speed, time_to_collision

LONGITUDINAL_M_S2 = (-4.05, 2.40)
LATERAL_M_S2 = 4.89
LONGITUDINAL_JERK_M_S3 = 4.13
JERK_M_S3 = 8.37
YAW_RATE_RAD_S = 0.95
YAW_ACCELERATION_RAD_S2 = 1.93
"""The bounds of nuPlan's metric ``ego_is_comfortable``.

All bounds except the interval ``LONGITUDINAL_M_S2`` apply to absolute values.

Source: the experiment configuration of motional/nuplan-devkit.
"""


class Motion(NamedTuple):
    """Accelerations, jerks and yaw motion of the ego; x is along the road, y to the left."""

    a_x_m_s2: float
    a_y_m_s2: float
    j_x_m_s3: float
    j_y_m_s3: float
    yaw_rate_rad_s: float
    yaw_acceleration_rad_s2: float

    @property
    def comfortable(self) -> bool:
        """Whether all values are within nuPlan's bounds of comfort."""
        least, most = LONGITUDINAL_M_S2
        return (
            least <= self.a_x_m_s2 <= most
            and abs(self.a_y_m_s2) <= LATERAL_M_S2
            and abs(self.j_x_m_s3) <= LONGITUDINAL_JERK_M_S3
            and math.hypot(self.j_x_m_s3, self.j_y_m_s3) <= JERK_M_S3
            and abs(self.yaw_rate_rad_s) <= YAW_RATE_RAD_S
            and abs(self.yaw_acceleration_rad_s2) <= YAW_ACCELERATION_RAD_S2
        )


def required_deceleration(gap_m: float, closing_m_s: float) -> float:
    """Return DRAC, the deceleration to avoid a crash: closing speed^2 / (2 gap), m/s^2.

    It is 0 if the gap does not shrink, and inf if there is no gap. The vehicle ahead is assumed to
    keep its speed (Cooper and Ferguson, 1976). SUMO's SSM device computes the same.
    """
    if closing_m_s <= 0.0:
        return 0.0
    return closing_m_s**2 / (2.0 * gap_m) if gap_m > 0.0 else math.inf


class Track(NamedTuple):
    """The states of one vehicle at T moments; each array has shape (T,)."""

    time_s: FloatArray
    s_m: FloatArray
    """Position of the body's centre along the road."""
    y_m: FloatArray
    length_m: FloatArray
    width_m: FloatArray


def post_encroachment_time(first: Track, second: Track, lap_m: float) -> float:
    """Return the smallest PET with ``first`` ahead and ``second`` behind it, seconds.

    PET (post-encroachment time) is the time from the moment at which the rear of ``first`` leaves a
    place to the moment at which the front of ``second`` arrives there (Allen, Shin and Cooper,
    1978). It is inf if ``second`` never arrives. The places are those of the rear of ``first`` at
    each moment, over its whole width. Between two moments ``second`` moves on a straight line. If
    both vehicles have the same speed, the PET is the time gap.

    Args:
        first: The vehicle that leaves.
        second: The vehicle that arrives, at the same moments; it never drives backwards.
        lap_m: Length of the loop; 0 on an open road.
    """
    steps_m, ahead_m = np.diff(second.s_m), first.s_m - second.s_m
    if lap_m:
        steps_m = (steps_m + lap_m / 2) % lap_m - lap_m / 2
        ahead_m = ahead_m % lap_m
    driven_m = np.concatenate(([0.0], np.cumsum(steps_m)))
    gap_m = ahead_m - (first.length_m + second.length_m) / 2
    place_m = driven_m + gap_m
    arrival_s = np.interp(place_m, driven_m, second.time_s)
    y_m = np.interp(arrival_s, second.time_s, second.y_m)
    reached = (gap_m >= 0.0) & (place_m <= driven_m[-1])
    reached &= abs(y_m - first.y_m) < (first.width_m + second.width_m) / 2
    return float((arrival_s - first.time_s)[reached].min(initial=math.inf))


CRITICAL_TTC_S = 3.0
"""A time to collision of at most this adds to TET and TIT (default of SUMO's SSM device)."""


@dataclass(frozen=True)
class CriticalityResult(EpisodeResult):
    """One row of the table with ``--criticality``: the usual columns, and those of this module."""

    driven_m: float
    """Distance that the ego drives: the speed after each decision times its duration."""
    mean_abs_jerk_m_s3: float
    """Mean absolute longitudinal jerk."""
    max_abs_jerk_m_s3: float
    max_abs_lateral_acceleration_m_s2: float
    comfortable_decisions: int
    """Number of decisions within nuPlan's bounds of comfort."""
    reversals: int
    """Number of accelerations after braking, and of brakings after an acceleration."""
    tet_s: float
    """Time exposed time-to-collision (Minderhoud and Bovy 2001): the time with a TTC of at most 3 s
    to the vehicle ahead."""
    tit_s2: float
    """Time integrated time-to-collision: the integral of 3 s minus TTC over that time."""
    max_drac_m_s2: PossiblyInfinite
    """Largest deceleration needed behind the vehicle ahead at constant speed (Cooper 1976)."""
    min_pet_s: PossiblyInfinite
    """Smallest post-encroachment time between the ego and any vehicle, in either order (Allen et
    al. 1978)."""
    short_headways: int
    """Number of decisions after which the time gap ahead is below 1 s at more than 5 m/s."""
    forced_brakes: int
    """Number of decisions during a lane change in which the rear vehicle brakes beyond 2 m/s^2."""
    max_forced_braking_m_s2: float
    """Hardest braking of the vehicle behind the ego during a lane change; 0 without any."""


class CriticalityMetrics(EpisodeMetrics):
    """Computes the metrics of one episode with those of comfort and criticality."""

    def __init__(self) -> None:
        super().__init__()
        self.motions: list[Motion] = []
        self.reversals = self.short_headways = self.forced_brakes = 0
        self.driven_m = self.tet_s = self.tit_s2 = 0.0
        self.max_drac_m_s2 = self.max_forced_braking_m_s2 = 0.0
        self._sign = 0
        self._snapshots: list[Snapshot] = []
        self._lap_m = 0.0

    def add(self, decision: Transition) -> None:
        """Update the metrics with the next decision of the episode."""
        super().add(decision)
        before, after = decision.scene.snapshot, decision.next_scene.snapshot
        self._snapshots += [after] if self._snapshots else [before, after]
        self._lap_m = decision.scene.affordances.circumference_m
        duration_s = after.time_s - before.time_s
        if duration_s == 0.0:  # the ego left the lanes in the first SUMO step
            return
        self.driven_m += self.speeds_m_s[-1] * duration_s
        self._add_motion(before, after, duration_s)
        self._add_front(decision, duration_s)
        self._add_rear(decision, duration_s)

    def _add_motion(self, before: Snapshot, after: Snapshot, duration_s: float) -> None:
        """Add the ego's motion in a decision; the jerk of the first decision counts as 0."""
        (v_x, v_y, heading), (next_v_x, next_v_y, next_heading) = map(_velocity, (before, after))
        a_x, a_y = (next_v_x - v_x) / duration_s, (next_v_y - v_y) / duration_s
        yaw_rate = (next_heading - heading) / duration_s
        former = self.motions[-1] if self.motions else Motion(a_x, a_y, 0.0, 0.0, yaw_rate, 0.0)
        motion = Motion(
            a_x,
            a_y,
            (a_x - former.a_x_m_s2) / duration_s,
            (a_y - former.a_y_m_s2) / duration_s,
            yaw_rate,
            (yaw_rate - former.yaw_rate_rad_s) / duration_s,
        )
        self.motions.append(motion)
        sign = (next_v_x - v_x > CHANGE_M_S) - (next_v_x - v_x < -CHANGE_M_S)
        self.reversals += sign * self._sign < 0
        self._sign = sign or self._sign

    def _add_front(self, decision: Transition, duration_s: float) -> None:
        """Update the metrics that depend on the vehicle ahead, if there is one."""
        front = leader(decision.next_scene)
        if front is None or front.vehicle >= len(decision.next_scene.snapshot.ids):
            return
        closing_m_s, speed_m_s = closing_speed(front), self.speeds_m_s[-1]
        exposed_s = CRITICAL_TTC_S - time_to_collision(front.gap_m, closing_m_s)
        if exposed_s >= 0.0:
            self.tet_s += duration_s
            self.tit_s2 += exposed_s * duration_s
        drac = required_deceleration(front.gap_m, closing_m_s)
        self.max_drac_m_s2 = max(self.max_drac_m_s2, drac)
        if speed_m_s > CRAWLING_M_S:
            self.short_headways += front.gap_m < SHORT_HEADWAY_S * speed_m_s

    def _add_rear(self, decision: Transition, duration_s: float) -> None:
        """During a lane change, update the metrics on the braking of the vehicle behind."""
        scenes = decision.scene, decision.next_scene
        rear = decision.next_scene.affordances.own_rear
        if rear is None or not any(scene.lane_change for scene in scenes):
            return
        before, after = (scene.snapshot for scene in scenes)
        name = after.ids[rear.vehicle]
        if name not in before.ids:
            return
        old_m_s = float(before.speed_m_s[before.ids.index(name)])
        braking = (old_m_s - float(after.speed_m_s[rear.vehicle])) / duration_s
        self.forced_brakes += braking > FORCED_M_S2
        self.max_forced_braking_m_s2 = max(self.max_forced_braking_m_s2, braking)

    @property
    def min_pet_s(self) -> float:
        """Smallest post-encroachment time between the ego and any other vehicle; inf if none."""
        ego = _track(self._snapshots, [EGO] * len(self._snapshots))
        times_s = [math.inf]
        for name in {name: None for shot in self._snapshots for name in shot.ids[EGO + 1 :]}:
            present = [place for place, shot in enumerate(self._snapshots) if name in shot.ids]
            shots = [self._snapshots[place] for place in present]
            other = _track(shots, [shot.ids.index(name) for shot in shots])
            here = Track(*(values[present] for values in ego))
            times_s.append(post_encroachment_time(other, here, self._lap_m))
            times_s.append(post_encroachment_time(here, other, self._lap_m))
        return min(times_s)

    def result(self, driver: str, safety_check: str, vehicles: int, seed: int) -> CriticalityResult:
        """Return the table's row for the episode: the four arguments and the metrics."""
        motions = self.motions or [Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)]
        jerks = [abs(motion.j_x_m_s3) for motion in motions]
        found = self.columns(CriticalityResult)
        return CriticalityResult(
            **found | vars(super().result(driver, safety_check, vehicles, seed)),
            mean_abs_jerk_m_s3=sum(jerks) / len(jerks),
            max_abs_jerk_m_s3=max(jerks),
            max_abs_lateral_acceleration_m_s2=max(abs(each.a_y_m_s2) for each in motions),
            comfortable_decisions=sum(motion.comfortable for motion in self.motions),
        )


def _velocity(snapshot: Snapshot) -> tuple[float, float, float]:
    """Return the ego's speed and lateral speed, m/s, and the direction of its motion, radians."""
    v_x, v_y = float(snapshot.speed_m_s[EGO]), float(snapshot.lateral_speed_m_s[EGO])
    return v_x, v_y, math.atan2(v_y, v_x)


def _track(snapshots: list[Snapshot], rows: list[int]) -> Track:
    states = [
        (shot.time_s, shot.s_m[row], shot.y_m[row], shot.length_m[row], shot.width_m[row])
        for shot, row in zip(snapshots, rows, strict=True)
    ]
    return Track(*np.array(states).reshape(-1, 5).T)


class Style(NamedTuple):
    """The comfort and criticality of one driver, or group of trainings, over all its episodes."""

    driver: str
    reversals_per_km: float
    mean_abs_jerk_m_s3: float
    comfortable_percent: float
    """Share of decisions within nuPlan's bounds of comfort."""
    tet_s_per_km: float
    """Time with a TTC of at most 3 s to the vehicle ahead, seconds per kilometre."""
    max_drac_m_s2: float
    min_pet_s: float
    short_headways_percent: float
    forced_brakes_per_1000: float
    """Forced brakings of other vehicles per 1,000 decisions."""


def styles(rows: Iterable[EpisodeResult]) -> list[Style]:
    """Compute the style of each driver from its rows of the class ``CriticalityResult``.

    Other rows are ignored. The drivers are in the order of their first rows.
    """
    measured = (row for row in rows if isinstance(row, CriticalityResult))
    groups = grouped(measured, lambda row: row.compared_as)
    return [_style(driver, group) for driver, group in groups.items()]


def _style(driver: str, rows: list[CriticalityResult]) -> Style:
    decisions = sum(row.decisions for row in rows)
    driven_km = max(sum(row.driven_m for row in rows), 1.0) / 1000
    return Style(
        driver=driver,
        reversals_per_km=sum(row.reversals for row in rows) / driven_km,
        mean_abs_jerk_m_s3=sum(row.mean_abs_jerk_m_s3 * row.decisions for row in rows) / decisions,
        comfortable_percent=100 * sum(row.comfortable_decisions for row in rows) / decisions,
        tet_s_per_km=sum(row.tet_s for row in rows) / driven_km,
        max_drac_m_s2=max(row.max_drac_m_s2 for row in rows),
        min_pet_s=min(row.min_pet_s for row in rows),
        short_headways_percent=100 * sum(row.short_headways for row in rows) / decisions,
        forced_brakes_per_1000=1000 * sum(row.forced_brakes for row in rows) / decisions,
    )
