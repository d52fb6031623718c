"""Computes the check ``strict`` for many scenes at once, with arrays, for millions of decisions.

The functions of ``drl_av/safety`` broadcast, so this module uses them. Only the choice of the
action is implemented a second time; a test compares the results with those of ``strict`` itself.
"""

import numpy as np

from drl_av.config import Config
from drl_av.driving.actions import ACTIONS, Lateral, Longitudinal
from drl_av.road.road import FloatArray
from drl_av.safety.check import SafetyCheck
from drl_av.safety.reachability import (
    ON_LINE_M,
    Others,
    lanes_under,
    lateral_extent,
    must_stay_behind,
    overlaps_laterally,
    stays_behind,
    stopping_limit,
)
from drl_av.safety.stopping import covered, reach
from drl_av.safety.strict import ORDER, seconds_to_line
from verification.kinematic_simulator import (
    LENGTH_M,
    NONE,
    ROAD,
    SIGN,
    WIDTH_M,
    BatchCheck,
    BoolArray,
    IntArray,
    World,
)

PLACE = np.array([ORDER.index(how) for how in Longitudinal])


def one_by_one(check: SafetyCheck) -> BatchCheck:
    """Return a BatchCheck that calls a safety check for each scene separately."""

    def checked(world: World, proposal: IntArray) -> IntArray:
        verdicts = (check(world.scene(row), ACTIONS[n]) for row, n in enumerate(proposal.tolist()))
        return np.array([verdict.action.number for verdict in verdicts])

    return checked


class BatchStrict:
    """The check ``strict`` as a BatchCheck: a function of a World of many scenes."""

    def __init__(self, config: Config) -> None:
        self._config = config
        ego = config.ego
        self._rates = np.array([how.acceleration_m_s2(ego) for how in Longitudinal])

    def __call__(self, world: World, proposal: IntArray) -> IntArray:
        """Return the executed action for each proposed action; both are 0 to 11, (scenes,)."""
        sign, longitudinal = SIGN[proposal // 4], proposal % 4
        neighbors, lane = self._others(world), _lane(world.y_m[:, 0])
        speed, still = world.speed_m_s[:, :1], world.target == NONE
        reaches = reach(speed, self._rates, self._config.ego, self._config.simulation)
        may_m, out = self._may_reach(world, neighbors), np.where(still, NONE, lane)
        safe = np.full(len(lane), int(Longitudinal.HARD_BRAKE))
        for how in reversed(ORDER):
            fits = (reaches[:, how] < may_m) & (ORDER.index(how) >= PLACE[longitudinal])
            safe = np.where(fits, int(how), safe)
        turns = (sign != 0) & (sign == world.origin - world.target)
        target = np.where(sign == 0, NONE, lane + sign)
        target = np.where(still, target, np.where(turns, world.origin, world.target))
        origin = np.where(still, lane, world.origin + world.target - target)
        fits = self._permits(world, origin, target, neighbors, safe)
        fits &= (target == NONE) | _has_lane(world, lane, target)
        back = np.where(still, int(Lateral.KEEP), _toward(out, world))
        lateral = np.where(fits | (target == out), proposal // 4, back)
        result: IntArray = 4 * lateral + safe
        return result

    def free(self, world: World) -> BoolArray:
        """Return whether the invariant of ``strict`` holds in each scene, shape (scenes,).

        The invariant is that the fallback maneuver is free of collisions.
        """
        ego = self._config.ego
        rolled_m = reach(world.speed_m_s[:, 0], -ego.hard_brake_m_s2, ego, self._config.simulation)
        result: BoolArray = np.asarray(rolled_m) < self._may_reach(world, self._others(world))
        return result

    def _others(self, world: World) -> Others:
        width_m = np.full(world.x_m[:, 1:].shape, WIDTH_M)
        ends_m = lateral_extent(
            world.y_m[:, 1:], world.lateral_m_s[:, 1:], width_m, ROAD.lane_width_m
        )
        ahead_m = world.x_m[:, 1:] - world.x_m[:, :1]
        gap_m, is_ahead, speed = np.abs(ahead_m) - LENGTH_M, ahead_m >= 0, world.speed_m_s[:, 1:]
        step_s = self._config.simulation.step_length_s
        may_m = stopping_limit(gap_m, is_ahead, speed, self._config.strict, step_s)
        y_m, lane_m = world.y_m, ROAD.lane_width_m
        held = must_stay_behind(y_m[:, 1:], width_m, y_m[:, :1], WIDTH_M, lane_m)
        others = Others(*ends_m, gap_m, is_ahead, speed, may_m, held)
        return self._with_barriers(others, world) if world.road.barriers else others

    def _with_barriers(self, others: Others, world: World) -> Others:
        """Add the road's barriers to the vehicles, as ``reachability.with_barriers`` does.

        A barrier that the ego's front has passed gets an empty lateral range.
        """
        s_m, right_m, left_m = np.array(world.road.barriers).T
        gap_m = s_m - (world.x_m[:, :1] + LENGTH_M / 2)
        ahead, standing = gap_m >= 0, np.zeros(gap_m.shape)
        stop_within_m = np.where(gap_m > 0, gap_m - self._config.strict.clearance_m, -np.inf)
        ends_m = np.where(ahead, right_m, np.inf), np.where(ahead, left_m, -np.inf)
        rows = (*ends_m, gap_m, standing == 0, standing, stop_within_m, standing == 0)
        return Others(*(np.column_stack(pair) for pair in zip(others, rows, strict=True)))

    def _may_reach(self, world: World, neighbors: Others) -> FloatArray:
        lane = _lane(world.y_m[:, 0])
        right_m, left_m = self._corridor(world, np.where(world.target == NONE, NONE, lane))
        meets = overlaps_laterally(neighbors, right_m[:, None], left_m[:, None])
        result: FloatArray = np.where(meets, neighbors.stop_within_m, np.inf).min(axis=1)
        return result

    def _permits(
        self,
        world: World,
        origin: IntArray,
        target: IntArray,
        neighbors: Others,
        how: IntArray,
    ) -> BoolArray:
        config, sim, lane_m = self._config, self._config.simulation, ROAD.lane_width_m
        strict, y_m, sign = config.strict, world.y_m[:, 0], np.sign(target - origin)
        right_m, left_m = self._corridor(world, target)
        aside_m = strict.lateral_speed_m_s * sim.decision_interval_s
        right_m, left_m = right_m - aside_m * (sign < 0), left_m + aside_m * (sign > 0)
        meets = overlaps_laterally(neighbors, right_m[:, None], left_m[:, None])
        to_line_m = sign * ((origin + target) / 2 * lane_m - y_m) - WIDTH_M / 2
        crosses_s = seconds_to_line(to_line_m, lane_m, config.ego, sim)[:, None]
        motion = world.speed_m_s[:, :1], self._rates[how][:, None], config.ego, sim
        covered_m = [*covered(*motion), reach(*motion)]
        stays = stays_behind(neighbors, crosses_s, covered_m, strict, sim.step_length_s)
        free = covered_m[-1] < np.where(meets, neighbors.stop_within_m, np.inf)
        result: BoolArray = (free & (stays | ~meets | neighbors.must_stay_behind)).all(axis=1)
        return result

    def _corridor(self, world: World, target: IntArray) -> tuple[FloatArray, FloatArray]:
        config, lane_m, y_m = self._config, ROAD.lane_width_m, world.y_m[:, 0]
        changing = target != NONE
        end_m = np.where(changing, target * lane_m, y_m)
        stride_m = lane_m / config.ego.lane_change_duration_s
        stride_m *= config.simulation.decision_interval_s
        next_m = y_m + np.sign(end_m - y_m) * np.minimum(np.abs(end_m - y_m), stride_m)
        out = [lane_m * _lane(next_m + tilt_m) for tilt_m in (-ON_LINE_M, ON_LINE_M)]
        under = [lane_m * lane for lane in lanes_under(y_m, WIDTH_M, lane_m)]
        places = np.stack([y_m, end_m, *under, *(np.where(changing, place, y_m) for place in out)])
        return places.min(axis=0) - WIDTH_M / 2, places.max(axis=0) + WIDTH_M / 2


def _lane(y_m: FloatArray) -> IntArray:
    return np.floor(y_m / ROAD.lane_width_m + 0.5).astype(np.int64)


def _has_lane(world: World, lane: IntArray, target: IntArray) -> BoolArray:
    """Return where the road permits the lane change at the ego's centre and front, (scenes,)."""
    road, result = world.road, (target >= 0) & (target < len(world.road.open_lanes))
    for row in np.flatnonzero(result & (lane != target)) if road.partial_lanes else ():
        at_m = float(world.x_m[row, 0])
        ways = (int(lane[row]), int(target[row]))
        result[row] = all(road.is_beside(*ways, s_m) for s_m in (at_m, at_m + LENGTH_M / 2))
    return result


def _toward(lane: IntArray, world: World) -> IntArray:
    sign = np.where(lane == world.target, world.target - world.origin, world.origin - world.target)
    result: IntArray = np.where(sign > 0, int(Lateral.LEFT), int(Lateral.RIGHT))
    return result
