"""``strict``: a safety check under which the ego hits no vehicle that keeps to four bounds (ours).

**Terms.** The *reach* of an action is the distance that the ego covers if it executes the action
for one decision and then brakes hard until standstill. The *stopping distance* of another vehicle
is the distance that it covers if it brakes as hard as bound 1 allows. The *fallback maneuver* of
the ego is: brake hard until standstill, and move to the centre of the lane that contains the centre
of the ego. A vehicle is *in* each lane that its body overlaps.

**Bounds on the other vehicles.** Their values are the settings of the section ``[strict]``. The
vehicle types of our scenarios keep to 1 and 2; see *Limits* for 3 and 4.

1. *Braking.* A vehicle brakes at most with ``braking_m_s2``. The ego brakes no harder than that.
2. *Lateral speed.* A vehicle moves sideways at most at ``lateral_speed_m_s``.
3. *Cutting in.* A vehicle begins to move sideways into a lane only if no vehicle is beside it in
   that lane at any time of this SUMO step, and only if the next vehicle behind it in that lane can
   stop behind it. The ego can do so if the gap is larger than ``cut_in_gap``; the ego then executes
   its present action for one decision more, and brakes hard. A vehicle within ``ARRIVED_M`` of the
   centre of a lane has not begun to leave that lane. When it passes the centre of a lane, a new
   movement begins. A vehicle whose lateral speed is at most ``STILL_M_S`` does not move sideways:
   a movement begins when it becomes faster, and when its body comes over a line. A vehicle that is
   ahead of the ego in one of the lanes of the ego may move into another one at any time.
4. *Following.* A vehicle stays behind the ego while the body of the ego overlaps its lane. Within
   ``follower_response_s`` it begins to brake with ``follower_braking_m_s2`` if this is necessary.
   Until then it accelerates at most with ``acceleration_m_s2``.

**Invariant.** At each decision the fallback maneuver is free: if the ego begins it now, the ego
hits no vehicle ahead.

**Base case.** The invariant must hold at the first decision. It does for the random starts of our
scenarios under the default bounds: each vehicle starts at the centre of a lane, and slowly enough
to stop behind the vehicle ahead with half of the hard braking of the ego. A scenario that places
its vehicles exactly must provide the same; ``info["unsafe_start"]`` of a reset says where it does
not.

**One number for each action.** A vehicle ahead comes to rest no earlier than after its stopping
distance (bound 1), and the ego does not brake harder than this vehicle. Therefore the gap shrinks
faster and faster until one of the two stands, and it is smallest at the beginning or at rest. If
the ego comes to rest behind the vehicle, the ego never hits it. The check therefore compares only
the reach of each action.

**Step.** For each vehicle ahead, the ego has this distance: the gap, plus the stopping distance of
the vehicle, minus ``clearance_m``. The check permits an action if its reach is less than the
distance for every relevant vehicle ahead. The fallback maneuver is then free at the next decision
too. If the check permits no action, the ego executes the fallback maneuver, which is free by the
invariant.

**Relevant vehicles.** A vehicle is relevant if it is in a lane that the body of the ego overlaps.
It is also relevant if it can enter the range between the present lateral position of the ego, the
end of its lane change and the end of its fallback maneuver. On the side of a new lane change this
range is wider by ``lateral_speed_m_s`` times one decision (bound 2). The check assumes that a
vehicle can be anywhere between the centres of the lanes that it is in and of the lane that it moves
towards. A vehicle that is not relevant yet, and moves into the lanes of the ego later, leaves more
than ``cut_in_gap`` (bound 3). The ego can therefore still brake when it observes this vehicle.

**Lane change.** The ego changes lanes only if the reach is permitted for the relevant vehicles of
the lane change too. A relevant vehicle beside the ego forbids the lane change.

**Followers.** A vehicle behind stays behind if the ego is in its way already (bound 4). If the ego
moves in front of a vehicle, this vehicle must come to rest behind the ego, whatever the ego does
afterwards; otherwise the check forbids the lane change. Even if the vehicle accelerates, it must
not reach the ego in the decision in which the body of the ego crosses the line.

**Exception.** The ego and another vehicle can begin to enter one lane from both sides while neither
of them is in it. The ego then turns back at the next decision, as fast as the other vehicle
approaches. Its centre is still in its own lane at that time, but its body may overlap the line. The
ego brakes hard as well in this case. It is the only exception to the invariant.

**Longitudinal references.** With IDM or ACC, the ego covers at most the reach of its action, which
the check compares with the vehicles ahead. It covers at least the reach of hard braking, which the
check compares with the vehicles behind. ``cut_in_gap`` then takes ``ego.accelerate_m_s2``.

**Limits.** The ego may hit a vehicle that breaks a bound. A vehicle that does not stay behind the
ego may hit the ego. SUMO's own drivers break two bounds in rare cases, which
``docs/results/long_run.txt`` counts by cause: they brake too late behind an ego that brakes hard
(bound 4), and they cut in because they see the positions of the previous SUMO step (bound 3). If a
vehicle requests an interrupted lane change again, SUMO resumes it even into a vehicle beside it.
``safety/assumptions.py`` refuses, with the bound or the lemma (``verification``) that fails:

- *following*, *hand-over*: braking of the ego above ``braking_m_s2``, or below that of followers.
- *corridor*: the steering plant, with which an aborted lane change drifts on before it turns back.
- *response*: followers that brake with less than 0.5 m/s^2.
- *rounding*: ``clearance_m`` below 1 mm, with which bodies may touch by a rounding error.
- *abort*: lane changes without a decision between the time at which the body of the ego crosses
  a line and the time at which its centre does.
- *bound 3*: more than 0.01 random lane changes a second; lanes in which two vehicles fit beside
  each other; vehicles too wide for a lane; loops so short that a follower is too near ahead.
- *any bound*: vehicle types and trucks that exceed a bound, or that SUMO drives by another model
  than ours; SUMO steps longer than ``follower_response_s``.
"""

import math
from typing import Any

import numpy as np

from drl_av.config import EgoConfig, SimulationConfig, StrictConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal, toward
from drl_av.driving.maneuver import next_lane_change
from drl_av.driving.scene import LaneChange, Scene
from drl_av.errors import ConfigError
from drl_av.road.road import allowed_speed
from drl_av.road.snapshot import EGO
from drl_av.safety.assumptions import FALLBACK_CHECK
from drl_av.safety.check import Rule, Verdict
from drl_av.safety.reachability import (
    LINE_M,
    ON_LINE_M,
    Others,
    lanes_under,
    lateral_extent,
    must_stay_behind,
    overlaps_laterally,
    stays_behind,
    stopping_limit,
    with_barriers,
)
from drl_av.safety.stopping import covered, reach

ORDER = (
    Longitudinal.ACCELERATE,
    Longitudinal.MAINTAIN,
    Longitudinal.BRAKE,
    Longitudinal.HARD_BRAKE,
)
ROUNDING = 1e-6
"""Largest rounding error of a computed number of SUMO steps."""


def seconds_to_line(
    distance_m: Any, lane_width_m: float, ego: EgoConfig, sim: SimulationConfig
) -> Any:
    """Return the time, seconds, until the ego's body is over a line (a lane marking) beside it.

    ``distance_m`` is the distance from the nearer side of the body to the line, a number or an
    array; it is negative if that side is already beyond the line. The body is over the line when
    its side is more than ``LINE_M`` beyond it. The ego moves sideways at the speed of a lane
    change. The time is rounded up to whole SUMO steps. It is 0 if the body is already over the
    line, and also if it does not get there within this decision.
    """
    stride_m = lane_width_m / ego.lane_change_duration_s * sim.step_length_s
    steps = (distance_m + LINE_M) / stride_m
    soon = (steps > -ROUNDING) & (np.ceil(steps - ROUNDING) <= sim.steps_per_decision)
    return np.where(soon, np.ceil(steps + ROUNDING), 0) * sim.step_length_s


def corridor(
    scene: Scene, lane_change: LaneChange | None, ego: EgoConfig, decision_s: float
) -> tuple[float, float]:
    """Return the right and left end of the lateral range that the ego's body may use, metres.

    It contains the lanes that the ego's body overlaps, the rest of ``lane_change``, and the
    fallback maneuver if the ego begins it at the next decision, ``decision_s`` seconds later.
    """
    affordances, ego_m = scene.affordances, float(scene.snapshot.width_m[EGO])
    y_m, width_m = affordances.ego_y_m, affordances.lane_width_m
    places = [y_m, *(width_m * float(lane) for lane in lanes_under(y_m, ego_m, width_m))]
    if lane_change is not None:
        end_m = lane_change.target * width_m
        stride_m = min(abs(end_m - y_m), width_m / ego.lane_change_duration_s * decision_s)
        next_m = y_m + lane_change.sign * stride_m
        places += [end_m, *(width_m * lane for lane in lanes_about(next_m, width_m))]
    return min(places) - ego_m / 2, max(places) + ego_m / 2


def lanes_about(y_m: float, lane_width_m: float) -> tuple[int, int]:
    """Return the right and the left lane that contain a lateral position; usually they are equal.

    They differ if the position is within ``ON_LINE_M`` of the marking between two lanes.
    """
    right, left = (y_m - ON_LINE_M) / lane_width_m, (y_m + ON_LINE_M) / lane_width_m
    return math.floor(right + 0.5), math.floor(left + 0.5)


def fallback_maneuver(scene: Scene) -> LaneChange | None:
    """Return the lane change of the fallback maneuver, or None if no lane change is in progress."""
    change = scene.lane_change
    return (
        change.reversed()
        if change is not None and change.target != scene.affordances.lane
        else change
    )


class Strict:
    """The check ``strict`` of this module; it raises ConfigError without the kinematic plant."""

    def __init__(self, strict: StrictConfig, ego: EgoConfig, simulation: SimulationConfig) -> None:
        if ego.lateral_plant != "kinematic":
            raise ConfigError(
                f"ego.lateral_plant is {ego.lateral_plant!r}, but the check strict holds for "
                f"'kinematic' only (the lemma corridor): take that, or {FALLBACK_CHECK}."
            )
        self._strict, self._ego, self._simulation = strict, ego, simulation
        self._accelerations = np.array([how.acceleration_m_s2(ego) for how in Longitudinal])

    def __call__(self, scene: Scene, proposed: Action) -> Verdict:
        """Return the action that the ego executes, and the rules that replaced the proposed action.

        Of the proposed and all slower longitudinal actions, the ego executes the fastest one that
        keeps the fallback maneuver free, or else hard brake. If the check does not permit the
        proposed lateral action together with it, the ego executes that of the fallback maneuver.
        """
        affordances, neighbors = scene.affordances, self.others(scene)
        fallback = fallback_maneuver(scene)
        wanted = next_lane_change(scene.lane_change, affordances.lane, proposed.lateral)
        speed = affordances.ego_speed_m_s
        reaches = reach(speed, self._accelerations, self._ego, self._simulation).tolist()
        may_m = self._may_reach(scene, fallback, neighbors)
        order = same_or_slower(proposed.longitudinal)
        safe = next((how for how in order if reaches[how] < may_m), Longitudinal.HARD_BRAKE)
        rule = Rule.NONE if safe == proposed.longitudinal else Rule.IN_LANE
        if wanted is None or wanted == fallback:
            return Verdict(Action(proposed.lateral, safe), rule)
        if not affordances.has_lane(wanted.target - affordances.lane):
            rule |= Rule.OFF_ROAD
        elif self._permits(scene, wanted, neighbors, safe, reaches):
            return Verdict(Action(proposed.lateral, safe), rule)
        else:
            rule |= Rule.LANE_CHANGE
        lateral = Lateral.KEEP if fallback is None else toward(fallback.sign)
        return Verdict(Action(lateral, safe), rule)

    def _slowest(self, scene: Scene, how: Longitudinal) -> Longitudinal:
        """Return the slowest action that the ego may execute in place of ``how``.

        It is ``how`` itself, but hard brake with IDM or ACC, which may brake so hard at any time.
        Where a speed limit slows the ego down, it is the fastest action that keeps the limit.
        """
        if self._ego.longitudinal_reference != "acceleration":
            return Longitudinal.HARD_BRAKE
        affordances, decision_s = scene.affordances, self._simulation.decision_interval_s
        if not affordances.speed_limits:
            return how
        speed, step_s = affordances.ego_speed_m_s, self._simulation.step_length_s
        allowed = allowed_speed(affordances.speed_limits, speed * decision_s, step_s)
        return next(
            (
                slower
                for slower in same_or_slower(how)
                if speed + self._accelerations[slower] * decision_s <= allowed
            ),
            Longitudinal.HARD_BRAKE,
        )

    def others(self, scene: Scene) -> Others:
        """Return the other vehicles of a scene as the check needs them.

        On a loop each vehicle has two entries: one ahead of the ego and one behind it. A barrier,
        such as the end of a lane, is a standing vehicle of length 0.
        """
        shot, affordances = scene.snapshot, scene.affordances
        ahead_m, rows = shot.s_m[1:] - shot.s_m[EGO], np.arange(1, len(shot.ids))
        if lap_m := affordances.circumference_m:
            ahead_m = np.concatenate((ahead_m % lap_m, ahead_m % lap_m - lap_m))
            rows = np.concatenate((rows, rows))
        y_m, width_m = shot.y_m[rows], shot.width_m[rows]
        gap_m = np.abs(ahead_m) - (shot.length_m[rows] + shot.length_m[EGO]) / 2
        ends_m = lateral_extent(
            y_m, shot.lateral_speed_m_s[rows], width_m, affordances.lane_width_m
        )
        held = must_stay_behind(
            y_m, width_m, affordances.ego_y_m, float(shot.width_m[EGO]), affordances.lane_width_m
        )
        facts = gap_m, ahead_m >= 0, shot.speed_m_s[rows]
        may_m = stopping_limit(*facts, self._strict, self._simulation.step_length_s)
        others = Others(*ends_m, *facts, may_m, held)
        barriers, clearance_m = affordances.barriers, self._strict.clearance_m
        return with_barriers(others, barriers, clearance_m) if barriers else others

    def fallback_is_free(self, scene: Scene) -> bool:
        """Whether the invariant holds: the ego hits no vehicle ahead in its fallback maneuver."""
        ego, speed = self._ego, scene.affordances.ego_speed_m_s
        rolled_m = float(reach(speed, -ego.hard_brake_m_s2, ego, self._simulation))
        return rolled_m < self._may_reach(scene, fallback_maneuver(scene), self.others(scene))

    def _may_reach(self, scene: Scene, fallback: LaneChange | None, neighbors: Others) -> float:
        """Return the distance, metres, within which the fallback maneuver must stop the ego."""
        ends_m = corridor(scene, fallback, self._ego, self._simulation.decision_interval_s)
        return float(
            neighbors.stop_within_m[overlaps_laterally(neighbors, *ends_m)].min(initial=np.inf)
        )

    def _permits(
        self,
        scene: Scene,
        change: LaneChange,
        neighbors: Others,
        how: Longitudinal,
        reaches_m: list[float],
    ) -> bool:
        """Whether the check permits a lane change other than that of the fallback maneuver."""
        strict, sim = self._strict, self._simulation
        right_m, left_m = corridor(scene, change, self._ego, sim.decision_interval_s)
        aside_m = strict.lateral_speed_m_s * sim.decision_interval_s
        right_m, left_m = (
            (right_m, left_m + aside_m) if change.sign > 0 else (right_m - aside_m, left_m)
        )
        meets = overlaps_laterally(neighbors, right_m, left_m)
        if not meets.any():
            return True
        if reaches_m[how] >= neighbors.stop_within_m[meets].min():
            return False
        slowest = self._slowest(scene, how)
        speed, acceleration = scene.affordances.ego_speed_m_s, self._accelerations[slowest]
        covered_m = [*covered(speed, acceleration, self._ego, sim), reaches_m[slowest]]
        crosses_s = self._crosses_s(scene, change)
        stays = stays_behind(neighbors, crosses_s, covered_m, strict, sim.step_length_s)
        return bool(stays[meets & ~neighbors.must_stay_behind].all())

    def _crosses_s(self, scene: Scene, change: LaneChange) -> float:
        """Return ``seconds_to_line`` for a lane change of the ego, seconds."""
        width_m, ego_m = scene.affordances.lane_width_m, float(scene.snapshot.width_m[EGO])
        line_m = (change.origin + change.target) / 2 * width_m
        to_line_m = change.sign * (line_m - scene.affordances.ego_y_m) - ego_m / 2
        return float(seconds_to_line(to_line_m, width_m, self._ego, self._simulation))


def same_or_slower(longitudinal: Longitudinal) -> tuple[Longitudinal, ...]:
    """Return the given action and all actions with a lower acceleration, fastest first."""
    return ORDER[ORDER.index(longitudinal) :]
