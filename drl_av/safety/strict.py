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
ego may hit the ego. The vehicles of our traffic break two bounds in rare cases, which
``docs/results/long_run.txt`` counts by cause: SUMO brakes them too late behind an ego that brakes
hard, and lets one that changes to another lane come too near (bound 4), and a driver may cut in by
the positions of the previous SUMO step (bound 3). If a vehicle requests an interrupted lane change
again, SUMO resumes it even into a vehicle beside it.
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
  than ours; SUMO steps longer than ``follower_response_s`` or than a vehicle's time gap.
"""

from typing import Any

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import compiled
from drl_av.config import EgoConfig, SimulationConfig, StrictConfig
from drl_av.driving.actions import (
    ACCELERATE,
    BRAKE,
    HARD_BRAKE,
    KEEP,
    LEFT,
    MAINTAIN,
    RIGHT,
    SIGNS,
    EgoNumbers,
    acceleration_of,
    ego_numbers,
)
from drl_av.driving.affordances import FRONT, LANE, has_lane
from drl_av.driving.maneuver import next_change
from drl_av.driving.scene import Scene
from drl_av.errors import ConfigError
from drl_av.road.road import allowed_speed_in
from drl_av.road.snapshot import EGO, Vehicles
from drl_av.safety.assumptions import FALLBACK_CHECK
from drl_av.safety.check import IN_LANE, LANE_CHANGE, OFF_ROAD, Verdicts, WholeCheck
from drl_av.safety.reachability import (
    Ground,
    corridor,
    covered,
    distances_ahead,
    fallback_lanes,
    lateral_extents,
    must_stay_behind,
    nearest_barrier,
    reach,
    seconds_to_line,
    stays_behind,
    stopping_limit,
)

ORDER = (ACCELERATE, MAINTAIN, BRAKE, HARD_BRAKE)
"""The longitudinal actions, the fastest first."""


class Strict(WholeCheck):
    """The check ``strict`` of this module; it raises ConfigError without the kinematic plant."""

    def __init__(self, strict: StrictConfig, ego: EgoConfig, simulation: SimulationConfig) -> None:
        if ego.has_steering:
            raise ConfigError(
                f"ego.lateral_plant is {ego.lateral_plant!r}, but the check strict holds for "
                f"'kinematic' only (the lemma corridor): take that, or {FALLBACK_CHECK}."
            )
        self._strict, self._ego = strict.numbers, ego_numbers(ego, simulation)

    def verdicts(self, scene: Scene) -> Verdicts:
        """Return the verdicts on all 12 actions.

        Of the proposed and all slower longitudinal actions, the ego executes the fastest one that
        keeps the fallback maneuver free, or else hard brake. If the check does not permit the
        proposed lateral action together with it, the ego executes that of the fallback maneuver.
        """
        found = Verdicts(np.empty(12, np.int64), np.empty(12, np.int64))
        strict_verdicts.fast(*self._arguments(scene), *found)
        if len(scene.indicators.speed_limits) and self._ego.has_constant_acceleration:
            self._expect_limits(scene, found)
        return found

    def _expect_limits(self, scene: Scene, found: Verdicts) -> None:
        """Change the verdicts where a speed limit may make the ego slower than its action.

        A lane change is then permitted only if it is also permitted with the fastest action that
        keeps the limit, or with hard brake.
        """
        ego, (values, codes, _, _, limits) = self._ego, scene.indicators
        speed, decision_s = values[24], ego.decision_interval_s
        ahead_m = values[FRONT] + speed * decision_s
        places_m = values[FRONT], ahead_m
        allowed = min(allowed_speed_in(limits, codes[LANE], m, ego.step_length_s) for m in places_m)
        keeps = [
            speed + acceleration_of(how, ego) * decision_s <= allowed for how in range(len(ORDER))
        ]
        permitted = found.executed.copy() // 4
        for number, (lateral, safe) in enumerate(zip(permitted, found.executed % 4, strict=True)):
            order = ORDER[ORDER.index(safe) :]
            slowest = next((how for how in order if keeps[how]), HARD_BRAKE)
            instead = permitted[4 * lateral + slowest]
            if lateral == number // 4 and instead != lateral:
                found.executed[number] = 4 * instead + safe
                found.rules[number] |= LANE_CHANGE

    def fallback_is_free(self, scene: Scene) -> bool:
        """Whether the invariant holds: the ego hits no vehicle ahead in its fallback maneuver."""
        return fallback_is_free.fast(*self._arguments(scene))

    def start_is_safe(self, scene: Scene) -> bool:
        """Whether the check can protect an episode that begins with this scene.

        Ahead: the ego can stop behind each vehicle. Beside: no body in the ego's way is beside it.
        Behind: each vehicle that must stay behind (bound 4) can stop behind the ego, if the ego
        keeps its speed for one decision and then brakes hard.
        """
        return start_is_safe.fast(*self._arguments(scene))

    def _arguments(self, scene: Scene) -> tuple[Any, ...]:
        """Return the arguments that describe a scene to the compiled functions."""
        values, codes, ground, *_ = scene.indicators
        around = scene.lanes, (*ground, values[FRONT])
        return scene.snapshot.arrays, codes, *around, self._strict, self._ego


@compiled
def start_is_safe(
    others: Vehicles,
    codes: IntArray,
    lanes: tuple[int, int],
    ground: Ground,
    strict: StrictConfig,
    ego: EgoNumbers,
) -> bool:
    """Return whether ``strict`` can protect an episode that begins with this scene.

    The arguments are those of ``strict_verdicts``.
    """
    if not fallback_is_free(others, codes, lanes, ground, strict, ego):
        return False
    s_m, y_m, speed_m_s, _, length_m, width_m = others
    covered_m = covered(speed_m_s[EGO], ego)[MAINTAIN]
    for row in range(1, len(s_m)):
        if not must_stay_behind(y_m[row], width_m[row], y_m[EGO], width_m[EGO], ground[1]):
            continue
        for ahead_m in distances_ahead(s_m, row, ground[0]):
            gap_m = abs(ahead_m) - (length_m[row] + length_m[EGO]) / 2
            is_behind = gap_m > 0 and ahead_m >= 0
            near = gap_m, is_behind, speed_m_s[row], 0.0, covered_m
            if not stays_behind(*near, strict, ego.step_length_s):
                return False
    return True


@compiled
def strict_verdicts(
    others: Vehicles,
    codes: IntArray,
    lanes: tuple[int, int],
    ground: Ground,
    strict: StrictConfig,
    ego: EgoNumbers,
    executed: IntArray,
    rules: IntArray,
) -> None:
    """Compute the verdicts of ``strict`` on all 12 actions of one scene.

    ``codes`` is that of ``indicators``. ``lanes`` are those of the lane change in progress, equal
    if there is none. The function fills the fields of ``Verdicts``, ``executed`` and ``rules``.
    """
    origin, target = lanes
    spans_m = lateral_extents(others[1], others[3], others[5], ground[1])
    lane, covered_m = codes[LANE], covered(others[2][EGO], ego)
    back = fallback_lanes(origin, target, lane)
    may_m = free_distance(others, spans_m, ground, back, strict, ego)
    for lateral in range(3):
        change = next_change(origin, target, lane, SIGNS[lateral])
        goes, is_back, rule, permitted = lateral, True, 0, 0
        if change[0] != change[1] and change != back:
            is_back = False
            if has_lane(codes, change[1] - lane):
                permitted = permitted_with(others, spans_m, ground, change, covered_m, strict, ego)
                rule = LANE_CHANGE
            else:
                rule = OFF_ROAD
            goes = KEEP if back[0] == back[1] else LEFT if back[1] > back[0] else RIGHT
        for proposed in range(4):
            number, safe = 4 * lateral + proposed, HARD_BRAKE
            for how in (HARD_BRAKE, BRAKE, MAINTAIN, ACCELERATE):
                if place(how) >= place(proposed) and covered_m[how, -1] < may_m:
                    safe = how
            rules[number] = IN_LANE * (safe != proposed)
            if is_back or permitted & (1 << safe) != 0:
                executed[number] = 4 * lateral + safe
            else:
                executed[number] = 4 * goes + safe
                rules[number] |= rule


@compiled
def fallback_is_free(
    others: Vehicles,
    codes: IntArray,
    lanes: tuple[int, int],
    ground: Ground,
    strict: StrictConfig,
    ego: EgoNumbers,
) -> bool:
    """Whether the invariant of ``strict`` holds; the arguments are those of ``strict_verdicts``."""
    spans_m = lateral_extents(others[1], others[3], others[5], ground[1])
    back = fallback_lanes(lanes[0], lanes[1], codes[LANE])
    rolled_m = reach(others[2][EGO], -ego.hard_brake_m_s2, ego, ego)
    return bool(rolled_m < free_distance(others, spans_m, ground, back, strict, ego))


def place(longitudinal: int) -> int:
    """Return the place of a longitudinal action in ``ORDER``, the fastest first."""
    return (1, 0, 2, 3)[longitudinal]


def free_distance(
    others: Vehicles,
    spans_m: FloatArray,
    ground: Ground,
    change: tuple[int, int],
    strict: StrictConfig,
    ego: EgoNumbers,
) -> float:
    """Return the distance, metres, within which the ego must stop in a lane change or without it.

    It is inf if no vehicle is in the way.
    """
    ends_m = corridor(others[1][EGO], others[5][EGO], change, ground[1], ego)
    nearest_m = nearest_barrier(ground, ends_m, strict)
    for row in range(1, len(others[0])):
        if spans_m[row, 1] > ends_m[0] and spans_m[row, 0] < ends_m[1]:
            for ahead_m in distances_ahead(others[0], row, ground[0]):
                gap_m = abs(ahead_m) - (others[4][row] + others[4][EGO]) / 2
                limit_m = stopping_limit(
                    gap_m, ahead_m >= 0, others[2][row], strict, ego.step_length_s
                )
                nearest_m = min(nearest_m, limit_m)
    return nearest_m


def permitted_with(
    others: Vehicles,
    spans_m: FloatArray,
    ground: Ground,
    change: tuple[int, int],
    covered_m: FloatArray,
    strict: StrictConfig,
    ego: EgoNumbers,
) -> int:
    """Return with which longitudinal actions the check permits a new lane change, as a bit set.

    ``covered_m`` is the result of ``covered``.
    """
    width_m, aside_m = ground[1], strict.lateral_speed_m_s * ego.decision_interval_s
    ego_y_m, ego_width_m, sign = others[1][EGO], others[5][EGO], 1 if change[1] > change[0] else -1
    right_m, left_m = corridor(ego_y_m, ego_width_m, change, width_m, ego)
    ends_m = (right_m, left_m + aside_m) if sign > 0 else (right_m - aside_m, left_m)
    line_m = (change[0] + change[1]) / 2 * width_m
    crosses_s = seconds_to_line(sign * (line_m - ego_y_m) - ego_width_m / 2, width_m, ego)
    nearest_m, permitted = nearest_barrier(ground, ends_m, strict), 15
    for row in range(1, len(others[0])):
        if not (spans_m[row, 1] > ends_m[0] and spans_m[row, 0] < ends_m[1]):
            continue
        speed, its_width_m = others[2][row], others[5][row]
        held = must_stay_behind(others[1][row], its_width_m, ego_y_m, ego_width_m, width_m)
        for ahead_m in distances_ahead(others[0], row, ground[0]):
            gap_m, is_ahead = abs(ahead_m) - (others[4][row] + others[4][EGO]) / 2, ahead_m >= 0
            limit_m = stopping_limit(gap_m, is_ahead, speed, strict, ego.step_length_s)
            nearest_m = min(nearest_m, limit_m)
            if held or (is_ahead and gap_m > 0):
                continue
            for how in range(4):
                slowest = how if ego.has_constant_acceleration else HARD_BRAKE
                if permitted & (1 << how) != 0 and not stays_behind(
                    gap_m, is_ahead, speed, crosses_s, covered_m[slowest], strict, ego.step_length_s
                ):
                    permitted &= ~(1 << how)
    for how in range(4):
        if covered_m[how, -1] >= nearest_m:
            permitted &= ~(1 << how)
    return permitted
