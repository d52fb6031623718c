"""``strict``: a check under which the ego hits nobody who keeps to stated bounds (ours).

**Bounds on the others** (section [strict] of the config; our vehicle types keep to them):

1. *Braking.* A vehicle brakes at most at ``braking_m_s2``, no less than the ego can.
2. *Sideways.* It moves at most at ``lateral_speed_m_s``.
3. *Cutting in.* It begins to move sideways into a lane only with nobody beside it there, and far
   enough ahead of the next vehicle behind it there. Far enough ahead of the ego is
   ``cut_in_gap``: one decision of full acceleration, then hard braking. Whose body is over a
   lane's line is in that lane.
4. *Following.* Behind an ego whose body is over the line of its lane it stays behind: within
   ``follower_response_s``, in which it accelerates at most at ``acceleration_m_s2``, it begins to
   brake at ``follower_braking_m_s2`` if it must.

**The argument.** The *way out* is: brake hard until standstill, sideways go to the middle of the
lane that the ego's centre is in. Invariant: at each decision the way out is free. A vehicle ahead
that brakes at b from speed v comes to rest after ``stopping_distance(v, b)``, wherever it is
headed earlier. The ego brakes no harder than that vehicle (bound 1), so the speed at which their
gap shrinks only grows until the first of them stands, and the gap is smallest at the start or at
rest: where the ego comes to rest behind it, it never met it. So each proposal is one number, the
``reach`` of the ego: how far it rolls in this decision and in braking hard afterwards. It is
permitted if that is less than the room ahead, to every vehicle that the lane change may meet on
its way to the end or on its way out: then the way out is free at the next decision as well. If no
proposal is, the way out is taken, which the invariant says is free.

Who may be met: a vehicle is taken to be anywhere between the centres of the lanes that its body
is over and of the one it moves towards; the ego sweeps from where it is to the ends of the lane
change and of its way out, and ``lateral_speed_m_s`` for one decision further on the side that it
moves to. Vehicles not yet met that move into the ego's lanes later leave ``cut_in_gap`` (bound
3). Of vehicles behind, those beside whom the ego already is keep behind it (bound 4); one that
the lane change will put the ego in front of must be able to: its own reach must end behind the
ego's. A vehicle beside refuses the lane change. Two vehicles may enter one lane from both sides,
neither in it yet: the ego turns back at the next decision, when its centre is still in its lane,
and its way back is as fast as the other's way in.

Who breaks a bound may still be hit, and the ego may be hit. No bound is put on how late SUMO's
followers brake in their own lane: rear ends of the ego are theirs.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.config import EgoConfig, SimulationConfig, StrictConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal, toward
from drl_av.driving.maneuver import LaneChange, Scene, steered
from drl_av.driving.safety import Rule, Verdict
from drl_av.errors import ConfigError
from drl_av.traffic.ring import FloatArray
from drl_av.traffic.snapshot import EGO


LINE_M = 0.01
"""How far a body must be over a lane's line to be in that lane."""
CENTERED_M = 0.05
"""Within this distance of a lane's centre a vehicle has arrived there; of a line, it is on it."""


def stopping_distance(
    speed_m_s: FloatArray | float, braking_m_s2: float, step_s: float
) -> FloatArray | float:
    """How far a vehicle rolls that brakes from now on until it stands, metres.

    SUMO's semi-implicit Euler: each step moves it by the speed that it has after the step; less by
    v dt / 2 than v^2 / 2b. Exact for any step; broadcasts.
    """
    steps = np.floor(speed_m_s / (braking_m_s2 * step_s))
    return step_s * steps * (speed_m_s - braking_m_s2 * step_s * (steps + 1) / 2)


def travel(
    speed_m_s: FloatArray | float,
    acceleration_m_s2: FloatArray | float,
    steps: int,
    step_s: float,
    max_speed_m_s: float = math.inf,
) -> tuple[FloatArray | float, FloatArray | float]:
    """Distance and speed after some steps at an acceleration within [0, max_speed_m_s]."""
    distance_m: FloatArray | float = 0.0
    speed = speed_m_s
    for step in range(1, steps + 1):
        wanted = speed_m_s + acceleration_m_s2 * (step * step_s)
        speed = np.minimum(np.maximum(wanted, 0.0), max_speed_m_s)
        distance_m = distance_m + speed * step_s
    return distance_m, speed


def reach(
    speed_m_s: FloatArray | float,
    acceleration_m_s2: FloatArray | float,
    ego: EgoConfig,
    sim: SimulationConfig,
) -> FloatArray | float:
    """How far the ego rolls in a decision at an acceleration and in braking hard afterwards."""
    step_s = sim.step_length_s
    distance_m, speed = travel(
        speed_m_s, acceleration_m_s2, sim.steps_per_decision, step_s, ego.max_speed_m_s
    )
    return distance_m + stopping_distance(speed, ego.hard_brake_m_s2, step_s)


def cut_in_gap(
    speed_m_s: FloatArray | float,
    other_m_s: FloatArray | float,
    strict: StrictConfig,
    ego: EgoConfig,
    sim: SimulationConfig,
) -> FloatArray | float:
    """Bound 3: the gap to the ego at which a vehicle may begin to move in ahead of it, metres."""
    ahead_m = stopping_distance(other_m_s, strict.braking_m_s2, sim.step_length_s)
    rolled_m = reach(speed_m_s, ego.accelerate_m_s2, ego, sim)
    return np.maximum(rolled_m - ahead_m, 0.0) + strict.clearance_m


def lanes_under(
    y_m: FloatArray, width_m: FloatArray, lane_width_m: float
) -> tuple[FloatArray, FloatArray]:
    """Rightmost and leftmost lane that a body is over."""
    lowest = np.floor((y_m - width_m / 2 + LINE_M) / lane_width_m + 0.5)
    return lowest, np.ceil((y_m + width_m / 2 - LINE_M) / lane_width_m - 0.5)


def room(
    y_m: FloatArray, lateral_speed_m_s: FloatArray, width_m: FloatArray, lane_width_m: float
) -> tuple[FloatArray, FloatArray]:
    """Right and left end of where a vehicle's body may be, metres.

    It is anywhere between the centres of the lanes that its body is over and of the one it moves
    towards.
    """
    half_m = width_m / 2
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    off_m = np.abs(y_m - lane_width_m * np.round(y_m / lane_width_m))
    moving = (np.abs(lateral_speed_m_s) > 0.01) & (off_m > CENTERED_M)
    left, right = moving & (lateral_speed_m_s > 0), moving & (lateral_speed_m_s < 0)
    lowest = np.where(right, np.minimum(lowest, np.floor(y_m / lane_width_m)), lowest)
    highest = np.where(left, np.maximum(highest, np.ceil(y_m / lane_width_m)), highest)
    return (
        np.minimum(lowest * lane_width_m, y_m) - half_m,
        np.maximum(highest * lane_width_m, y_m) + half_m,
    )


class Others(NamedTuple):
    """The other vehicles as the check takes them; arrays of one shape, the last axis theirs."""

    right_m: FloatArray
    left_m: FloatArray
    """Between these their bodies may be."""
    most_m: FloatArray
    """How far the ego may reach: to where one ahead comes to rest at the soonest; inf for one
    behind, -inf for one beside."""
    least_m: FloatArray
    """How far the ego must reach: to where one behind comes to rest at the latest; -inf for one
    ahead, inf for one beside."""


def is_held(
    y_m: FloatArray, width_m: FloatArray, ego_y_m: Any, ego_width_m: float, lane_width_m: float
) -> npt.NDArray[np.bool_]:
    """Whether a vehicle behind has to stay there wherever it moves (bound 4).

    The ego's body is over the lines of all its lanes, and in its way.
    """
    lowest, highest = lanes_under(y_m, width_m, lane_width_m)
    ego_lowest, ego_highest = lanes_under(ego_y_m, np.float64(ego_width_m), lane_width_m)
    in_the_way = np.abs(y_m - ego_y_m) < (width_m + ego_width_m) / 2
    held: npt.NDArray[np.bool_] = in_the_way & (ego_lowest <= lowest) & (highest <= ego_highest)
    return held


def others(
    ahead_m: FloatArray,
    beside_m: FloatArray,
    speed_m_s: FloatArray,
    ends_m: tuple[FloatArray, FloatArray],
    strict: StrictConfig,
    step_s: float,
) -> Others:
    """The others from their centres ahead of the ego's, the lengths that make them beside it,
    their speeds and the ends of their rooms."""
    gap_m = np.abs(ahead_m) - beside_m
    is_ahead, is_beside = ahead_m >= 0.0, gap_m <= 0.0
    rest_m = gap_m - strict.clearance_m + stopping_distance(speed_m_s, strict.braking_m_s2, step_s)
    steps = math.ceil(strict.follower_response_s / step_s - 1e-9)
    response_m, speed = travel(speed_m_s, strict.acceleration_m_s2, steps, step_s)
    rolled_m = response_m + stopping_distance(speed, strict.follower_braking_m_s2, step_s)
    return Others(
        *ends_m,
        np.where(is_beside, -np.inf, np.where(is_ahead, rest_m, np.inf)),
        np.where(is_beside, np.inf, np.where(is_ahead, -np.inf, rolled_m - gap_m + strict.clearance_m)),
    )


def corridor(
    scene: Scene, lane_change: LaneChange | None, ego: EgoConfig, decision_s: float
) -> tuple[float, float]:
    """Right and left end of where the ego's body will be, until its lane change is at its end and
    also if it takes the way out at the next decision."""
    seen, half_m = scene.seen, float(scene.snapshot.width_m[EGO]) / 2
    y_m, width_m = seen.ego_y_m, seen.lane_width_m
    places = [y_m]
    if lane_change is not None:
        end_m = lane_change.target * width_m
        stride_m = min(abs(end_m - y_m), width_m / ego.lane_change_duration_s * decision_s)
        next_m = y_m + lane_change.sign * stride_m
        places += [end_m, *(width_m * lane for lane in lanes_about(next_m, width_m))]
    return min(places) - half_m, max(places) + half_m


def lanes_about(y_m: float, lane_width_m: float) -> tuple[int, int]:
    """The lane that a lateral position lies in; both, right first, where it is on their line."""
    right, left = (y_m - CENTERED_M) / lane_width_m, (y_m + CENTERED_M) / lane_width_m
    return math.floor(right + 0.5), math.floor(left + 0.5)


def way_out(scene: Scene) -> LaneChange | None:
    """The lane change that ends in the lane that the ego's centre is in; None without any."""
    change = scene.lane_change
    return change.turned() if change is not None and change.target != scene.seen.lane else change


class Strict:
    """The check; see the module for its bounds and its argument."""

    def __init__(self, strict: StrictConfig, ego: EgoConfig, simulation: SimulationConfig) -> None:
        if strict.braking_m_s2 < ego.hard_brake_m_s2:
            raise ConfigError(
                f"strict.braking_m_s2 is {strict.braking_m_s2:g}, but must be at least "
                f"ego.hard_brake_m_s2, {ego.hard_brake_m_s2:g}: the check rests on that."
            )
        self._strict, self._ego, self._simulation = strict, ego, simulation
        self._accelerations = np.array([how.acceleration_m_s2(ego) for how in Longitudinal])

    def __call__(self, scene: Scene, proposed: Action) -> Verdict:
        """The proposal; else the same sideways, as fast as is safe; else the way out sideways."""
        seen, around = scene.seen, self.others(scene)
        wanted, out = steered(scene.lane_change, seen.lane, proposed.lateral), way_out(scene)
        speed = seen.ego_speed_m_s
        reaches = reach(speed, self._accelerations, self._ego, self._simulation).tolist()
        _, most_m = self._limits(scene, out, around)
        safe = next(
            (how for how in milder(proposed.longitudinal) if reaches[how] < most_m),
            Longitudinal.HARD_BRAKE,
        )
        rule = Rule.NONE if safe == proposed.longitudinal else Rule.IN_LANE
        if wanted == out:
            return Verdict(Action(proposed.lateral, safe), rule)
        if wanted is not None and not seen.has_lane(wanted.target - seen.lane):
            return Verdict(Action(_lateral(out), safe), rule | Rule.OFF_ROAD)
        least_m, most_m = self._limits(scene, wanted, around)
        if least_m < reaches[safe] < most_m:
            return Verdict(Action(proposed.lateral, safe), rule)
        return Verdict(Action(_lateral(out), safe), rule | Rule.LANE_CHANGE)

    def others(self, scene: Scene) -> Others:
        """The other vehicles of a scene as the check takes them."""
        shot, lap_m = scene.snapshot, scene.seen.circumference_m
        ahead_m = shot.s_m[1:] - shot.s_m[EGO]
        if lap_m:
            ahead_m = (ahead_m + lap_m / 2) % lap_m - lap_m / 2
        width_m = shot.width_m[1:]
        ends_m = room(shot.y_m[1:], shot.lateral_speed_m_s[1:], width_m, scene.seen.lane_width_m)
        beside_m = (shot.length_m[1:] + shot.length_m[EGO]) / 2
        step_s = self._simulation.step_length_s
        return others(ahead_m, beside_m, shot.speed_m_s[1:], ends_m, self._strict, step_s)

    def _limits(
        self, scene: Scene, lane_change: LaneChange | None, around: Others
    ) -> tuple[float, float]:
        """How far the ego must and may reach in a lane change, or in none, metres."""
        decision_s = self._simulation.decision_interval_s
        right_m, left_m = corridor(scene, lane_change, self._ego, decision_s)
        if lane_change is not None and lane_change != way_out(scene):
            aside_m = self._strict.lateral_speed_m_s * decision_s
            right_m -= aside_m * (lane_change.sign < 0)
            left_m += aside_m * (lane_change.sign > 0)
        met = (around.left_m > right_m) & (around.right_m < left_m)
        shot, lane_m = scene.snapshot, scene.seen.lane_width_m
        ego_m = float(shot.width_m[EGO])
        held = is_held(shot.y_m[1:], shot.width_m[1:], scene.seen.ego_y_m, ego_m, lane_m)
        most_m = float(np.min(around.most_m, where=met, initial=np.inf))
        least_m = float(np.max(around.least_m, where=met & ~held, initial=-np.inf))
        return least_m, most_m


def milder(longitudinal: Longitudinal) -> tuple[Longitudinal, ...]:
    """A longitudinal action and those that brake harder, in that order."""
    order = (
        Longitudinal.ACCELERATE,
        Longitudinal.MAINTAIN,
        Longitudinal.BRAKE,
        Longitudinal.HARD_BRAKE,
    )
    return order[order.index(longitudinal) :]


def _lateral(lane_change: LaneChange | None) -> Lateral:
    return Lateral.KEEP if lane_change is None else toward(lane_change.sign)
