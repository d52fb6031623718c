"""Computes the check ``strict`` for many scenes at once, for millions of decisions."""

from typing import Any

import numpy as np

from drl_av.compiled import compiled, numbers
from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, EgoNumbers, ego_numbers
from drl_av.driving.affordances import CODES, VALUES, indicators
from drl_av.road.road import FloatArray
from drl_av.road.road_numbers import RoadNumbers, road_numbers
from drl_av.safety.check import SafetyCheck
from drl_av.safety.reachability import StrictNumbers
from drl_av.safety.strict import fallback_is_free, strict_verdicts
from verification.kinematic_simulator import (
    LENGTH_M,
    WIDTH_M,
    BatchCheck,
    BoolArray,
    IntArray,
    World,
)


def one_by_one(check: SafetyCheck) -> BatchCheck:
    """Return a BatchCheck that calls a safety check for each scene separately."""

    def checked(world: World, proposal: IntArray) -> IntArray:
        verdicts = (check(world.scene(row), ACTIONS[n]) for row, n in enumerate(proposal.tolist()))
        return np.array([verdict.action.number for verdict in verdicts])

    return checked


class BatchStrict:
    """The check ``strict`` as a BatchCheck: a function of a World of many scenes."""

    def __init__(self, config: Config) -> None:
        self._strict = numbers(StrictNumbers, config.strict)
        self._ego = ego_numbers(config.ego, config.simulation)

    def __call__(self, world: World, proposal: IntArray) -> IntArray:
        """Return the executed action for each proposed action; both are 0 to 11, (scenes,)."""
        executed, free = np.empty(len(world.x_m), np.int64), np.empty(len(world.x_m), np.bool_)
        judge(*self._arguments(world), np.asarray(proposal, np.int64), executed, free)
        return executed

    def free(self, world: World) -> BoolArray:
        """Return whether the invariant of ``strict`` holds in each scene, shape (scenes,).

        The invariant is that the fallback maneuver is free of collisions.
        """
        executed, free = np.empty(len(world.x_m), np.int64), np.empty(len(world.x_m), np.bool_)
        judge(*self._arguments(world), np.zeros(len(free), np.int64), executed, free)
        return free

    def _arguments(self, world: World) -> tuple[Any, ...]:
        state = world.x_m, world.y_m, world.speed_m_s, world.lateral_m_s
        lanes = np.column_stack([world.origin, world.target]).astype(np.int64)
        road = road_numbers(world.road)
        return *map(np.ascontiguousarray, state), lanes, road, self._strict, self._ego


@compiled
def judge(
    x_m: FloatArray,
    y_m: FloatArray,
    speed_m_s: FloatArray,
    lateral_m_s: FloatArray,
    lanes: IntArray,
    road: RoadNumbers,
    strict: StrictNumbers,
    ego: EgoNumbers,
    proposal: IntArray,
    executed: IntArray,
    free: BoolArray,
) -> None:
    """Set ``executed`` and ``free`` for each scene; the first five arrays are those of a World.

    ``lanes``, shape (scenes, 2), holds ``origin`` and ``target``. The vehicles of a World are not
    on a loop, so none is both ahead of the ego and behind it.
    """
    scenes, vehicles = x_m.shape
    lengths_m, widths_m = np.full(vehicles, LENGTH_M), np.full(vehicles, WIDTH_M)
    values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
    verdicts, rules = np.empty(12, np.int64), np.empty(12, np.int64)
    for row in range(scenes):
        state = (x_m[row], y_m[row], speed_m_s[row], lateral_m_s[row], lengths_m, widths_m)
        indicators(*state, road, 250.0, values, codes)
        ground = (0.0, road.lane_width_m, road.barriers, x_m[row, 0] + LENGTH_M / 2)
        scene = (*state, codes, lanes[row, 0], lanes[row, 1], *ground, strict, ego)
        strict_verdicts(*scene, verdicts, rules)
        executed[row] = verdicts[proposal[row]]
        free[row] = fallback_is_free(*scene)
