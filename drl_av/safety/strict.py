"""``strict``: a check under which the ego hits nobody who keeps to stated bounds (ours).

**Bounds on the others** (section [strict] of the config; our vehicle types keep to them):

1. *Braking.* A vehicle brakes at most at ``braking_m_s2``, no less than the ego can.
2. *Sideways.* It moves at most at ``lateral_speed_m_s``.
3. *Cutting in.* It begins to move sideways into a lane only with nobody beside it there, and far
   enough ahead of the next vehicle behind it there for that one to stop behind it. Far enough
   ahead of the ego is more than ``cut_in_gap``: it goes on as it does for one decision, then
   brakes hard.
   Whose body is over a lane's line is in that lane; within ``CENTERED_M`` of a lane's centre
   nobody has begun to leave it, and who comes past a centre begins anew.
4. *Following.* Behind an ego whose body is over the line of its lane it stays behind: within
   ``follower_response_s``, in which it accelerates at most at ``acceleration_m_s2``, it begins to
   brake at ``follower_braking_m_s2`` if it must.

**The argument.** The *way out* is: brake hard until standstill, sideways go to the middle of the
lane that the ego's centre is in. Invariant: at each decision the way out is free. A vehicle ahead
comes to rest no sooner than after ``stopping_distance`` (bound 1), and the ego brakes no harder
than it may, so the speed at which their gap shrinks only grows until one of them stands: the gap
is smallest at the start or at rest, and where the ego comes to rest behind it, it never met it.
So each proposal is one number, the ``reach`` of the ego: how far it rolls in this decision and in
braking hard afterwards. It is permitted if that is less than the room to everybody ahead whom the
lane change may meet on its way to the end or on its way out; then the way out is free at the next
decision too. Where no proposal is permitted the way out is taken, which the invariant says is free.

Who may be met: who is in a lane that the ego's body is over, and who may come between where it is,
the end of its lane change and that of its way out, ``lateral_speed_m_s`` times one decision further
on the side that it moves to (bound 2). A vehicle may be anywhere between the centres of the lanes
that its body is over and of the one it moves towards. Those not met yet that move into the ego's
lanes later leave it more than ``cut_in_gap`` (bound 3), so that it may still brake when it sees
them. One behind in whose way the ego already is keeps behind it (bound 4); one that the ego moves
in front of must come to rest behind the ego, whatever that does next. One beside refuses the lane
change. Two may enter one lane from both sides while neither is in it: the ego turns back at the
next decision, when its centre is still in its lane, as fast as the other one comes. Its body may be
over the line by then: the one exception to the invariant, in which it brakes hard as well.

Under a longitudinal reference (IDM or ACC) the ego rolls at most as far as by the number of its
action, which is the ``reach`` above, and at least as far as by braking hard, which is what those
behind get to count on. The steering plant stays out of it: an abort drifts on before it turns.

Who breaks a bound may be hit; and whoever does not stay behind the ego hits it.
"""

import math
from typing import Any

import numpy as np

from drl_av.config import EgoConfig, SimulationConfig, StrictConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal, toward
from drl_av.driving.maneuver import next_lane_change
from drl_av.driving.scene import LaneChange, Scene
from drl_av.errors import ConfigError
from drl_av.safety.check import Rule, Verdict
from drl_av.safety.reachability import (
    ON_LINE_M,
    Others,
    is_held,
    lanes_under,
    lateral_extent,
    may_reach,
    met,
    must_reach,
)
from drl_av.safety.stopping import reach
from drl_av.traffic.snapshot import EGO

ORDER = (
    Longitudinal.ACCELERATE,
    Longitudinal.MAINTAIN,
    Longitudinal.BRAKE,
    Longitudinal.HARD_BRAKE,
)


def seconds_to_line(
    distance_m: Any, lane_width_m: float, ego: EgoConfig, sim: SimulationConfig
) -> Any:
    """Time until the ego's body, so far from a lane's line, is over it; whole SUMO steps.

    0 where it is over it already or will not be within this decision.
    """
    steps = np.ceil(distance_m * ego.lane_change_duration_s / lane_width_m / sim.step_length_s)
    soon = (steps > 0) & (steps <= sim.steps_per_decision)
    return np.where(soon, steps, 0) * sim.step_length_s


def corridor(
    scene: Scene, lane_change: LaneChange | None, ego: EgoConfig, decision_s: float
) -> tuple[float, float]:
    """Right and left end of what counts as the ego's way.

    The lanes that its body is over, and where it will be until its lane change is at its end, or
    if it takes the way out at the next decision.
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
    """The lane that a lateral position lies in; both, right first, where it is on their line."""
    right, left = (y_m - ON_LINE_M) / lane_width_m, (y_m + ON_LINE_M) / lane_width_m
    return math.floor(right + 0.5), math.floor(left + 0.5)


def fallback_maneuver(scene: Scene) -> LaneChange | None:
    """The lane change that ends in the lane that the ego's centre is in; None without any."""
    change = scene.lane_change
    return (
        change.reversed()
        if change is not None and change.target != scene.affordances.lane
        else change
    )


class Strict:
    """The check; see the module for its bounds and its argument."""

    def __init__(self, strict: StrictConfig, ego: EgoConfig, simulation: SimulationConfig) -> None:
        if strict.braking_m_s2 < ego.hard_brake_m_s2:
            raise ConfigError(
                f"strict.braking_m_s2 is {strict.braking_m_s2:g}, but must be at least "
                f"ego.hard_brake_m_s2, {ego.hard_brake_m_s2:g}: the check rests on that."
            )
        if ego.lateral_plant != "kinematic":
            raise ConfigError(
                f"ego.lateral_plant is {ego.lateral_plant!r}, but the check strict holds for "
                "'kinematic' alone: take that, or the check paper."
            )
        self._strict, self._ego, self._simulation = strict, ego, simulation
        self._accelerations = np.array([how.acceleration_m_s2(ego) for how in Longitudinal])

    def __call__(self, scene: Scene, proposed: Action) -> Verdict:
        """The proposal sideways where it is free at the speed that the way out allows; else that.

        The speed is the proposed one, or the fastest milder one by which the way out stays free.
        """
        affordances, neighbors, out = (
            scene.affordances,
            self.others(scene),
            fallback_maneuver(scene),
        )
        wanted = next_lane_change(scene.lane_change, affordances.lane, proposed.lateral)
        speed = affordances.ego_speed_m_s
        reaches = reach(speed, self._accelerations, self._ego, self._simulation).tolist()
        may_m = self._may_reach(scene, out, neighbors)
        order = milder(proposed.longitudinal)
        safe = next((how for how in order if reaches[how] < may_m), Longitudinal.HARD_BRAKE)
        rule = Rule.NONE if safe == proposed.longitudinal else Rule.IN_LANE
        if wanted is None or wanted == out:
            return Verdict(Action(proposed.lateral, safe), rule)
        if not affordances.has_lane(wanted.target - affordances.lane):
            rule |= Rule.OFF_ROAD
        elif self._permits(scene, wanted, neighbors, reaches[safe], reaches[self._slowest(safe)]):
            return Verdict(Action(proposed.lateral, safe), rule)
        else:
            rule |= Rule.LANE_CHANGE
        return Verdict(Action(Lateral.KEEP if out is None else toward(out.sign), safe), rule)

    def _slowest(self, how: Longitudinal) -> Longitudinal:
        """The action whose number lets the ego roll no farther than this one may come to."""
        by_number = self._ego.longitudinal_reference == "acceleration"
        return how if by_number else Longitudinal.HARD_BRAKE

    def others(self, scene: Scene) -> Others:
        """The other vehicles of a scene as the check takes them.

        On a loop each is there twice: as far ahead of the ego as it is, and as far behind.
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
        held = is_held(
            y_m, width_m, affordances.ego_y_m, float(shot.width_m[EGO]), affordances.lane_width_m
        )
        facts = gap_m, ahead_m >= 0, shot.speed_m_s[rows]
        may_m = may_reach(*facts, self._strict, self._simulation.step_length_s)
        return Others(*ends_m, *facts, may_m, held)

    def fallback_is_free(self, scene: Scene) -> bool:
        """The invariant: hard braking on the way out meets nobody ahead."""
        ego, speed = self._ego, scene.affordances.ego_speed_m_s
        rolled_m = float(reach(speed, -ego.hard_brake_m_s2, ego, self._simulation))
        return rolled_m < self._may_reach(scene, fallback_maneuver(scene), self.others(scene))

    def _may_reach(self, scene: Scene, out: LaneChange | None, neighbors: Others) -> float:
        """How far the ego may roll on its way out."""
        ends_m = corridor(scene, out, self._ego, self._simulation.decision_interval_s)
        return float(neighbors.most_m[met(neighbors, *ends_m)].min(initial=np.inf))

    def _permits(
        self,
        scene: Scene,
        change: LaneChange,
        neighbors: Others,
        at_most_m: float,
        at_least_m: float,
    ) -> bool:
        """Whether the ego may roll so far in a lane change that is not its way out."""
        strict, sim, affordances = self._strict, self._simulation, scene.affordances
        right_m, left_m = corridor(scene, change, self._ego, sim.decision_interval_s)
        aside_m = strict.lateral_speed_m_s * sim.decision_interval_s
        right_m, left_m = (
            (right_m, left_m + aside_m) if change.sign > 0 else (right_m - aside_m, left_m)
        )
        meets = met(neighbors, right_m, left_m)
        if not meets.any():
            return True
        if at_most_m >= neighbors.most_m[meets].min():
            return False
        width_m, ego_m = affordances.lane_width_m, float(scene.snapshot.width_m[EGO])
        line_m = (change.origin + change.target) / 2 * width_m
        to_line_m = change.sign * (line_m - affordances.ego_y_m) - ego_m / 2
        delay_s = strict.follower_response_s + seconds_to_line(to_line_m, width_m, self._ego, sim)
        must_m = must_reach(neighbors, float(delay_s), strict, sim.step_length_s)
        return bool(at_least_m > must_m[meets & ~neighbors.is_held].max(initial=-np.inf))


def milder(longitudinal: Longitudinal) -> tuple[Longitudinal, ...]:
    """A longitudinal action and those that brake harder, in that order."""
    return ORDER[ORDER.index(longitudinal) :]
