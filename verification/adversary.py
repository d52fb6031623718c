"""Simulates many scenes at once without SUMO: an ego under a check, and an adversary's vehicles.

The ego decides and moves by the compiled functions of the package: indicators, the check
``strict``, the plan of a decision, and the collision within a step. An adversary commands the other
vehicles, within the bounds of ``safety/strict.py``. They may drive beyond the end of a lane; the
ego may not. Arrays have shape (scenes,) for the ego and (scenes, others) for the other vehicles.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from drl_av.arrays import BoolArray, FloatArray, IntArray
from drl_av.compiled import compiled
from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, ego_numbers
from drl_av.driving.affordances import compute_indicators
from drl_av.driving.scene import LaneChange, Scene
from drl_av.road.road import ARRIVED_M, Road, road_numbers
from drl_av.road.snapshot import Collision, CollisionKind, Snapshot
from drl_av.road.sweep import KINDS, swept_collision
from drl_av.safety.check import SafetyCheck, apply_check
from drl_av.safety.reachability import (
    STILL_M_S,
    cut_in_gap,
    lanes_under,
    lateral_extent,
    stopping_distance,
)
from verification.ego_in_scenes import judge, leave_road, plan_all
from verification.euler import Integration
from verification.separation import barrier_separation, swept_separation

ROAD = Road(10_000.0, 3.8, (True, True, True))
LANE_M, LENGTH_M, WIDTH_M = ROAD.lane_width_m, 5.0, 1.8
NONE = -9
"""Value of ``origin`` and ``target`` in a scene whose ego is not changing lanes."""
FASTEST_M_S = 40.0
TOUCHING_M = 1e-9
"""Largest overlap of two bodies that counts as a rounding error, not as a collision."""


@dataclass
class World:
    """The state of all vehicles in many scenes; the simulator changes it in place."""

    x_m: FloatArray
    """Centres along the road; shape (scenes, 1 + others) like the next three, the ego first."""
    y_m: FloatArray
    speed_m_s: FloatArray
    lateral_m_s: FloatArray
    """Lateral speed, left positive."""
    origin: IntArray
    """Lane in which the ego's lane change begins, or NONE; shape (scenes,)."""
    target: IntArray
    """Lane in which the ego's lane change ends, or NONE; shape (scenes,)."""
    lane_s: FloatArray
    """Time for which the ego's body has overlapped each lane, seconds; shape (scenes, lanes)."""
    collisions: dict[int, Collision] = field(default_factory=dict)
    """The ego's collision, by index of the scene; such a scene has ended."""
    road: Road = ROAD
    """A road of three lanes that are as wide as those of ``ROAD``."""

    def __post_init__(self) -> None:
        self.heading_rad = np.zeros(len(self.x_m))
        """Angle of the ego to its lane, left positive, (scenes,); 0 with the kinematic plant."""
        obstacles = self.x_m.shape[1] - 1 + len(self.road.barriers)
        self.least_m = np.full((len(self.x_m), obstacles), np.inf)
        """The smallest separation of each other vehicle, and then of each barrier, from the ego.

        Separation is the larger of the gaps along and across the road, negative if bodies overlap.
        The shape is (scenes, others + barriers).
        """

    def numbers(self) -> tuple[Any, ...]:
        """Return the state of all scenes, the ego's lanes and the road, for compiled functions."""
        state = self.x_m, self.y_m, self.speed_m_s, self.lateral_m_s
        sizes = np.full(self.x_m.shape[1], LENGTH_M), np.full(self.x_m.shape[1], WIDTH_M)
        lanes = np.column_stack([self.origin, self.target]).astype(np.int64)
        return *map(np.ascontiguousarray, state), *sizes, lanes, road_numbers(self.road)

    def scene(self, row: int) -> Scene:
        """Return the present state of the scene with index ``row``, as a safety check takes it."""
        names = tuple(f"vehicle{other}" for other in range(1, self.x_m.shape[1]))
        s_m, size = self.x_m[row] % self.road.lap_m, np.ones(self.x_m.shape[1])
        state = s_m, self.y_m[row], self.speed_m_s[row], self.lateral_m_s[row]
        shot = Snapshot(0.0, ("ego", *names), *state, LENGTH_M * size, WIDTH_M * size)
        origin, target = int(self.origin[row]), int(self.target[row])
        heading_rad = float(self.heading_rad[row])
        change = None if target == NONE else LaneChange(origin, target, heading_rad)
        return Scene(shot, compute_indicators(shot, self.road, 250.0), change, self.road)


class Orders(NamedTuple):
    """The commands of the adversary for all scenes in one decision."""

    proposal: IntArray
    """The proposed actions of the ego, 0 to 11; shape (scenes,)."""
    acceleration_m_s2: FloatArray
    """Acceleration of the other vehicles; shape (scenes, others)."""
    side: FloatArray
    """Lateral speed of the others as a fraction of its bound, from -1 (right) to 1 (left)."""


BatchCheck = Callable[[World, IntArray], IntArray]
"""A function from a world and the proposed actions to the executed actions, 0 to 11, (scenes,)."""


class Mover:
    """Advances the vehicles of a World kinematically, in steps as long as those of SUMO."""

    def __init__(self, config: Config, integration: Integration = Integration.EULER) -> None:
        self._config, self._integration = config, integration
        self._ego = ego_numbers(config.ego, config.simulation)
        self.step_s = config.simulation.step_length_s

    def decision(self, world: World, executed: IntArray, orders: Orders) -> None:
        """Advance all scenes of ``world``, in place, by one decision interval.

        ``executed`` holds the ego's action number, 0 to 11, in each scene. A scene stops at the
        step of its first collision.
        """
        for _ in self.steps(world, executed, orders):
            pass

    def steps(
        self, world: World, executed: IntArray, orders: Orders
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Advance as ``decision`` does, and yield speeds and lateral positions after each step.

        Both arrays have shape (scenes, 1 + others), the ego first.
        """
        steps, ego = self._config.simulation.steps_per_decision, self._config.ego
        rates = np.array([0.0, ego.accelerate_m_s2, -ego.brake_m_s2, -ego.hard_brake_m_s2])
        plans = np.empty((len(executed), 3, steps))
        lanes, heading_rad = np.empty((len(executed), 2), np.int64), world.heading_rad.copy()
        given = world.numbers(), self._ego, np.asarray(executed, np.int64)
        plan_all(*given, plans, lanes, heading_rad)
        for step in range(steps):
            self._step(world, rates[executed % 4], orders, _going(world), plans[:, :, step])
            yield world.speed_m_s, world.y_m
        changes, going = lanes[:, 0] != lanes[:, 1], _going(world)
        world.origin, world.target = np.where(changes[:, None], lanes, NONE).T.copy()
        world.heading_rad = heading_rad
        arrived = (world.target == NONE) & going
        world.lateral_m_s[:, 0] = np.where(arrived, 0.0, world.lateral_m_s[:, 0])

    def _step(
        self, world: World, rate: FloatArray, orders: Orders, going: BoolArray, plan: FloatArray
    ) -> None:
        """Advance by one SUMO step; ``plan``, (scenes, 3), is the ego's state after it."""
        speed, bounds = world.speed_m_s.copy(), self._config.strict
        speed[:, 0] = plan[:, 0]
        rates = -bounds.braking_m_s2, bounds.acceleration_m_s2
        wanted = self._staying_behind(world, np.clip(orders.acceleration_m_s2, *rates))
        speed[:, 1:] = np.clip(speed[:, 1:] + wanted * self.step_s, 0.0, FASTEST_M_S)
        moved = self._integration.mean_speed(world.speed_m_s, speed)
        x_m, y_m = world.x_m, world.y_m
        world.x_m = np.where(going[:, None], world.x_m + moved * self.step_s, world.x_m)
        world.speed_m_s = np.where(going[:, None], speed, world.speed_m_s)
        side = self._permitted_side(world, orders.side, rate, x_m)
        self._sideways(world, side, going, plan)
        self._collide(world, x_m, y_m, going)

    def _collide(
        self, world: World, from_x_m: FloatArray, from_y_m: FloatArray, going: BoolArray
    ) -> None:
        """Record the ego's collisions in a step that begins at ``from_x_m`` and ``from_y_m``.

        If the ego hits the edge of the road and a vehicle in one step, only the edge is recorded.
        """
        sizes_m, places = (LENGTH_M, WIDTH_M), (world.x_m, world.y_m)
        least_m = swept_separation((from_x_m, from_y_m), places, *sizes_m)
        to_barriers_m = barrier_separation(world.road.barriers, places, *sizes_m)
        world.least_m = np.minimum(world.least_m, np.column_stack([least_m, to_barriers_m]))
        leaves = np.empty(len(going), np.bool_)
        leave_road(world.numbers(), leaves)
        for row in np.flatnonzero(going & leaves).tolist():
            world.collisions[row] = Collision(CollisionKind.HIT_EDGE, None)
        touches = (least_m < -TOUCHING_M).any(axis=1)
        for row in np.flatnonzero(going & touches & ~leaves).tolist():
            ways = from_x_m[row], from_y_m[row], world.x_m[row], world.y_m[row]
            length_m, width_m = (np.full(len(ways[0]), size_m) for size_m in sizes_m)
            other, kind, _ = swept_collision(*ways, length_m, width_m, ROAD.lap_m)
            world.collisions[row] = Collision(KINDS[kind], f"vehicle{other}")

    def _permitted_side(
        self, world: World, side: FloatArray, rate: FloatArray, from_x_m: FloatArray
    ) -> FloatArray:
        """Return the other vehicles' sides, with 0 where bound 3 of ``strict`` forbids a side.

        A vehicle begins a lane change only if no vehicle of the new lane is beside it at any time
        in this step. ``from_x_m`` holds the positions at the start of the step.
        """
        strict, ego = self._config.strict, self._config.ego
        y_m, width_m = world.y_m[:, 1:], ROAD.lane_width_m
        lane = _bound_for(y_m, side)
        lowest, highest = lanes_under(world.y_m, WIDTH_M, ROAD.lane_width_m)
        off_m = np.abs(y_m - width_m * np.round(y_m / width_m))
        earlier_m = y_m - world.lateral_m_s[:, 1:] * self.step_s
        goes_on = (np.sign(world.lateral_m_s[:, 1:]) == np.sign(side)) & (off_m > ARRIVED_M)
        goes_on &= _bound_for(earlier_m, side) == lane
        goes_on &= np.abs(world.lateral_m_s[:, 1:]) > STILL_M_S
        is_in = (lowest[:, 1:] <= lane) & (lane <= highest[:, 1:])
        # there[:, a, b]: vehicle a is in the lane that vehicle b would move into
        there = (lowest[:, :, None] <= lane[:, None]) & (lane[:, None] <= highest[:, :, None])
        n = y_m.shape[1]
        there[:, np.arange(1, n + 1), np.arange(n)] = False
        lead_m = world.x_m[:, None, 1:] - world.x_m[:, :, None]
        from_m = from_x_m[:, None, 1:] - from_x_m[:, :, None]
        nearest_m = np.minimum(np.abs(lead_m), np.abs(from_m)) * (lead_m * from_m > 0)
        beside = (there & (nearest_m <= LENGTH_M)).any(axis=1)
        behind_m = np.where(there & (lead_m > 0), lead_m, np.inf)
        follower = behind_m.argmin(axis=1)
        gap_m = behind_m.min(axis=1) - LENGTH_M
        rows = np.arange(len(y_m))[:, None]
        speed, own = world.speed_m_s[rows, follower], world.speed_m_s[:, 1:]
        needs_m = cut_in_gap(speed, rate[:, None], own, strict, ego, self._config.simulation)
        brakes = (strict.braking_m_s2, self.step_s)
        other_m = stopping_distance(speed, *brakes) - stopping_distance(own, *brakes)
        needs_m = np.where(follower == 0, needs_m, np.maximum(other_m, 0.0) + strict.clearance_m)
        front = there[:, 0] & (lead_m[:, 0] < 0)
        behind_ego_m = -lead_m[:, 0] - LENGTH_M
        faster = own + strict.acceleration_m_s2 * self.step_s
        stops_m = stopping_distance(faster, strict.follower_braking_m_s2, self.step_s)
        ego_stops_m = stopping_distance(world.speed_m_s[:, :1], ego.hard_brake_m_s2, self.step_s)
        follows = behind_ego_m + ego_stops_m > stops_m + faster * self.step_s + 1.0
        begins = ~beside & (gap_m > needs_m) & (~front | follows)
        shares = (lowest[:, :1] <= highest[:, 1:]) & (lowest[:, 1:] <= highest[:, :1])
        is_met = shares & (lead_m[:, 0] > LENGTH_M)
        permitted = goes_on | is_in | begins | is_met | self._creeps_in_lane(y_m, side)
        return np.where(permitted, side, 0.0)

    def _creeps_in_lane(self, y_m: FloatArray, side: FloatArray) -> BoolArray:
        """Return which vehicles move too slowly sideways for the check, and stay in their lanes."""
        lateral_m_s = side * self._config.strict.lateral_speed_m_s
        after_m = y_m + lateral_m_s * self.step_s
        lowest, highest = lanes_under(y_m, WIDTH_M, ROAD.lane_width_m)
        lowest_after, highest_after = lanes_under(after_m, WIDTH_M, ROAD.lane_width_m)
        stays = (lowest_after >= lowest) & (highest_after <= highest)
        result: BoolArray = stays & (np.abs(lateral_m_s) < STILL_M_S)
        return result

    def _staying_behind(self, world: World, wanted: FloatArray) -> FloatArray:
        """Return accelerations, reduced behind the ego as bound 4 of ``strict`` demands."""
        strict, ego = self._config.strict, self._config.ego
        gap_m = world.x_m[:, :1] - world.x_m[:, 1:] - LENGTH_M
        must = (gap_m >= 0) & (self._shared_s(world) >= strict.follower_response_s - 1e-9)
        braking, step_s = strict.follower_braking_m_s2, self.step_s
        rest_m = gap_m + stopping_distance(world.speed_m_s[:, :1], ego.hard_brake_m_s2, step_s)
        result = np.where(must, np.minimum(wanted, -braking), wanted)
        for rate in (-2.0, 0.0, 1.0, strict.acceleration_m_s2):
            tried = np.minimum(rate, wanted)
            speed = np.clip(world.speed_m_s[:, 1:] + tried * step_s, 0.0, FASTEST_M_S)
            rolled_m = speed * step_s + stopping_distance(speed, braking, step_s)
            result = np.where(must & (rolled_m + 0.1 < rest_m), tried, result)
        return result

    def _shared_s(self, world: World) -> FloatArray:
        """Return how long, s, the ego has been in a lane of each other vehicle; -1 if in none.

        Then add this step to ``world.lane_s``.
        """
        lowest, highest = lanes_under(world.y_m[:, :1], WIDTH_M, ROAD.lane_width_m)
        lanes = np.arange(len(ROAD.open_lanes))
        over = (lowest <= lanes) & (lanes <= highest)
        right_m, left_m = np.empty((2, *world.x_m[:, 1:].shape, 1))
        set_extents(world.y_m, world.lateral_m_s, right_m, left_m)
        theirs = (right_m < lanes * ROAD.lane_width_m) & (lanes * ROAD.lane_width_m < left_m)
        shared = theirs & over[:, None]
        result: FloatArray = np.where(shared, world.lane_s[:, None], -1.0).max(axis=2)
        world.lane_s = np.where(over, world.lane_s + self.step_s, 0.0)
        return result

    def _sideways(self, world: World, side: FloatArray, going: BoolArray, plan: FloatArray) -> None:
        reach_m = self._config.strict.lateral_speed_m_s * self.step_s
        ends = ROAD.lane_width_m * (len(ROAD.open_lanes) - 1)
        to_m = np.clip(world.y_m[:, 1:] + side * reach_m, 0.0, ends)
        center_m = ROAD.lane_width_m * _bound_for(world.y_m[:, 1:], side)
        to_m = np.where(side > 0, np.minimum(to_m, center_m), to_m)
        to_m = np.where(side < 0, np.maximum(to_m, center_m), to_m)
        to_m = np.where(going[:, None], to_m, world.y_m[:, 1:])
        lateral_m_s = np.column_stack([plan[:, 2], (to_m - world.y_m[:, 1:]) / self.step_s])
        world.lateral_m_s = np.where(going[:, None], lateral_m_s, world.lateral_m_s)
        ego_y_m = np.where(going, plan[:, 1], world.y_m[:, 0])
        world.y_m = np.column_stack([ego_y_m, to_m])


@compiled
def set_extents(
    y_m: FloatArray, lateral_m_s: FloatArray, right_m: FloatArray, left_m: FloatArray
) -> None:
    """Set the ends of ``lateral_extent`` of the other vehicles, shape (scenes, others, 1)."""
    scenes, vehicles = y_m.shape
    for row in range(scenes):
        for one in range(1, vehicles):
            ends_m = lateral_extent(y_m[row, one], lateral_m_s[row, one], WIDTH_M, LANE_M)
            right_m[row, one - 1, 0], left_m[row, one - 1, 0] = ends_m


def _bound_for(y_m: FloatArray, side: FloatArray) -> FloatArray:
    """Return the lane whose centre a vehicle reaches next on its side; for side 0 the nearest."""
    place = y_m / ROAD.lane_width_m
    right, left = np.ceil(place - 1e-6) - 1, np.floor(place + 1e-6) + 1
    return np.where(side > 0, left, np.where(side < 0, right, np.round(place)))


def _going(world: World) -> BoolArray:
    """Return which scenes have had no collision yet, shape (scenes,)."""
    going = np.ones(len(world.x_m), dtype=np.bool_)
    going[list(world.collisions)] = False
    return going


def one_by_one(check: SafetyCheck) -> BatchCheck:
    """Return a BatchCheck that calls a safety check for each scene separately."""

    def checked(world: World, proposal: IntArray) -> IntArray:
        asked = enumerate(proposal.tolist())
        verdicts = [apply_check(check, world.scene(row), ACTIONS[n]) for row, n in asked]
        return np.array([verdict.action.number for verdict in verdicts])

    return checked


class BatchStrict:
    """The check ``strict`` as a BatchCheck: a function of a World of many scenes."""

    def __init__(self, config: Config) -> None:
        self._strict = config.strict.numbers
        self._ego = ego_numbers(config.ego, config.simulation)

    def __call__(self, world: World, proposal: IntArray) -> IntArray:
        """Return the executed action for each proposed action; both are 0 to 11, (scenes,)."""
        return self.verdicts(world)[np.arange(len(proposal)), proposal]

    def verdicts(self, world: World) -> IntArray:
        """Return the executed action for each of the 12 actions, shape (scenes, 12)."""
        return self._judged(world)[0]

    def free(self, world: World) -> BoolArray:
        """Return whether the invariant of ``strict`` holds in each scene, shape (scenes,).

        The invariant is that the fallback maneuver is free of collisions.
        """
        return self._judged(world)[1]

    def _judged(self, world: World) -> tuple[IntArray, BoolArray]:
        scenes = len(world.x_m)
        found = np.empty((scenes, len(ACTIONS)), np.int64), np.empty(scenes, np.bool_)
        judge(world.numbers(), self._strict, self._ego, *found)
        return found
