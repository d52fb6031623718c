"""The check ``paper``: the short-horizon safety check of Sec. III, with its rules 1, 2 and 3."""

import math
from typing import Any

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing, compiled
from drl_av.config import Config, SafetyConfig, StrictConfig
from drl_av.driving.actions import (
    ACCELERATE,
    BRAKE,
    HARD_BRAKE,
    KEEP,
    LEFT,
    MAINTAIN,
    RIGHT,
    SIGNS,
    Action,
    EgoNumbers,
    ego_numbers,
)
from drl_av.driving.affordances import FRONT, LANE, NO_VEHICLE, Neighbor, has_lane, slot_of
from drl_av.driving.maneuver import next_change
from drl_av.driving.scene import Scene
from drl_av.road.snapshot import Vehicles
from drl_av.safety.check import IN_LANE, LANE_CHANGE, OFF_ROAD, Verdict, Verdicts, WholeCheck
from drl_av.safety.reachability import Ground
from drl_av.safety.strict import strict_verdicts


def closing_speed(front: Neighbor) -> float:
    """Return the speed at which the gap to the vehicle ahead shrinks, m/s; negative if it grows."""
    return -front.relative_speed_m_s


def time_to_collision(gap_m: float, closing_m_s: float) -> float:
    """Return the time to collision, T_C of eq. 4 of the paper: gap / closing speed, seconds.

    ``closing_m_s`` is positive if the gap shrinks; otherwise the result is inf.
    """
    return gap_m / closing_m_s if closing_m_s > 0 else math.inf


def gap_condition(gap_m: Any, closing_m_s: Any, config: SafetyConfig) -> Any:
    """Whether the gap condition (eq. 3 of the paper) holds: gap_m - T_min * closing_m_s > d_TVmin.

    ``closing_m_s`` is positive if the gap shrinks. Works elementwise on arrays.
    """
    return gap_m - config.minimum_ttc_s * closing_m_s > config.minimum_gap_m


def safe_action(ttc_s: float, config: SafetyConfig) -> int:
    """Return the number of the safe action (eq. 4 of the paper): hard brake, brake, or maintain.

    ``ttc_s`` is the time to collision with the vehicle ahead.
    """
    if ttc_s <= config.hard_brake_ttc_s:
        return HARD_BRAKE
    return BRAKE if ttc_s <= config.brake_ttc_s else MAINTAIN


class Paper(WholeCheck):
    """The three rules of Sec. III as a safety check; ``paper`` describes them."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config.numbers

    def verdicts(self, scene: Scene) -> Verdicts:
        """Return the verdicts of the three rules on all 12 actions."""
        found = Verdicts(np.empty(12, np.int64), np.empty(12, np.int64))
        values, codes, *_ = scene.indicators
        paper_verdicts.fast(values, codes, scene.lanes, self._config, *found)
        return found


def paper(scene: Scene, proposed: Action, config: SafetyConfig) -> Verdict:
    """Return the verdict of the three rules of Sec. III on the proposed action.

    The ego may still collide: see docs/safety.md. We decide two cases that the paper leaves open.
    Rule 1 permits a proposal that brakes at least as hard as eq. 4 demands. If rule 3 permits the
    ego neither to continue nor to abort a lane change, the ego moves to the lane that contains its
    centre. The settings ``printed_rule_1`` and ``printed_rule_3`` apply the rules as printed.
    """
    return Paper(config)(scene, proposed)


@borrowing
def paper_verdicts(
    values: FloatArray,
    codes: IntArray,
    lanes: tuple[int, int],
    safety: SafetyConfig,
    executed: IntArray,
    rules: IntArray,
) -> None:
    """Compute the verdicts of ``paper`` on all 12 actions of one scene.

    ``values`` and ``codes`` are those of ``indicators``. ``lanes`` are those of the lane change in
    progress, equal if there is none. The function fills the fields of ``Verdicts``, ``executed``
    and ``rules``.
    """
    for lateral in range(3):
        across, rule = checked_lateral(values, codes, lanes, lateral, safety)
        for longitudinal in range(4):
            along = checked_longitudinal(values, codes, longitudinal, safety)
            executed[4 * lateral + longitudinal] = 4 * across + along
            rules[4 * lateral + longitudinal] = rule | (IN_LANE * (along != longitudinal))


def checked_longitudinal(
    values: FloatArray, codes: IntArray, proposed: int, safety: SafetyConfig
) -> int:
    """Return the action after rule 1: gap condition (eq. 3) and safe action (eq. 4)."""
    gap_m, closing_m_s = values[0], -values[1]
    if codes[0] == NO_VEHICLE or closing_m_s <= 0 or gap_condition(gap_m, closing_m_s, safety):
        return proposed
    safe = safe_action(time_to_collision(gap_m, closing_m_s), safety)
    if proposed != ACCELERATE and proposed >= safe and not safety.printed_rule_1:
        return proposed  # brakes enough
    return safe


def checked_lateral(
    values: FloatArray, codes: IntArray, lanes: tuple[int, int], proposed: int, safety: SafetyConfig
) -> tuple[int, int]:
    """Return the lateral action after rules 2 and 3, and the rule that replaced it."""
    still = lanes[0] == lanes[1]
    start, end = next_change(*lanes, codes[LANE], SIGNS[proposed])
    if start == end:
        return proposed, 0
    back = KEEP if still else RIGHT if end > start else LEFT
    if not has_lane(codes, end - codes[LANE]):
        return back, OFF_ROAD
    if is_clear(values, codes, end - codes[LANE], safety):
        return proposed, 0
    back_to = start - codes[LANE]
    goes_back = (
        still
        or safety.printed_rule_3
        or back_to == 0
        or (has_lane(codes, back_to) and is_clear(values, codes, back_to, safety))
    )
    return (back, LANE_CHANGE) if goes_back else (proposed, 0)


def is_clear(values: FloatArray, codes: IntArray, sign: int, safety: SafetyConfig) -> bool:
    """Whether rule 3 of the paper permits to be in the own (0), left (+1) or right (-1) lane.

    The gap condition (eq. 3) must hold for the vehicle ahead in the ego's lane, and for those ahead
    and behind in the other lane.
    """
    front = slot_of(sign)
    return (
        (codes[0] == NO_VEHICLE or gap_condition(values[0], -values[1], safety))
        and (codes[front] == NO_VEHICLE or clear_of(values, front, -1, safety))
        and (codes[front + 1] == NO_VEHICLE or clear_of(values, front + 1, 1, safety))
    )


def clear_of(values: FloatArray, slot: int, direction: int, safety: SafetyConfig) -> bool:
    """Whether the gap condition (eq. 3) holds in a slot; ``direction`` is -1 ahead, +1 behind."""
    return bool(gap_condition(values[4 * slot], direction * values[4 * slot + 1], safety))


class PaperBeforeLaneEnds(Paper):
    """``paper``, and the ego stays able to stop before its lane ends.

    The paper has no lane that ends. As a vehicle that stands there, the end would be braked for too
    late: with the thresholds of the safe action (eq. 4), 2 and 3 s, the ego stops from each speed
    up to 14 m/s, and from none above 20 m/s. Rules 1 and 3 therefore do not see the end of the
    ego's own lane. The action that they return is then replaced as ``strict`` would on the road
    without other vehicles, which covers the divider of a ramp too. That argument needs
    ``ego.lateral_plant = "kinematic"``; a steered ego may drift a little beyond.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config.safety)
        self._strict = config.strict.numbers
        self._ego = ego_numbers(config.ego, config.simulation)

    def verdicts(self, scene: Scene) -> Verdicts:
        """Return the verdicts of the three rules and of the lane ends on all 12 actions."""
        values, codes, ground, *_ = scene.indicators
        if not len(ground[2]):
            return super().verdicts(scene)
        found = Verdicts(np.empty(12, np.int64), np.empty(12, np.int64))
        around = scene.lanes, (*ground, values[FRONT])
        settings = self._config, self._strict, self._ego
        seen = scene.snapshot.arrays, values, codes.copy()  # which it changes meanwhile
        before_lane_ends.fast(*seen, *around, *settings, *found)
        return found


@compiled
def before_lane_ends(
    scene: Vehicles,
    values: FloatArray,
    codes: IntArray,
    lanes: tuple[int, int],
    ground: Ground,
    safety: SafetyConfig,
    strict: StrictConfig,
    ego: EgoNumbers,
    executed: IntArray,
    rules: IntArray,
) -> None:
    """Compute the verdicts of ``PaperBeforeLaneEnds`` on all 12 actions of one scene.

    The arguments are those of ``paper_verdicts`` and of ``strict_verdicts``.
    """
    ahead = codes[0]
    if ahead >= len(scene[0]):  # the end of the lane
        codes[0] = NO_VEHICLE
    paper_verdicts(values, codes, lanes, safety, executed, rules)
    codes[0] = ahead
    s_m, y_m, speed, lateral, length_m, width_m = scene
    alone = s_m[:1], y_m[:1], speed[:1], lateral[:1], length_m[:1], width_m[:1]
    instead, why = np.empty(12, np.int64), np.empty(12, np.int64)
    strict_verdicts(alone, codes, lanes, ground, strict, ego, instead, why)
    for action in range(12):
        going = executed[action]
        executed[action] = instead[going]
        rules[action] = 0 if instead[going] == action else rules[action] | why[going]
