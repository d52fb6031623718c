"""The check ``paper`` on one action, in plain Python."""

import math

from drl_av.config import SafetyConfig
from drl_av.driving.actions import Action, Lateral, Longitudinal, toward
from drl_av.driving.affordances import Affordances, Neighbor
from drl_av.driving.scene import Scene
from drl_av.safety.check import Rule, Verdict
from oracles.affordances import has_lane
from oracles.plan import next_lane_change


def closing_speed(front: Neighbor) -> float:
    """Return the speed at which the gap to the vehicle ahead shrinks, m/s; negative if it grows."""
    return -front.relative_speed_m_s


def time_to_collision(gap_m: float, closing_m_s: float) -> float:
    """Return the time to collision, T_C of eq. 4 of the paper: gap / closing speed, seconds.

    ``closing_m_s`` is positive if the gap shrinks; otherwise the result is inf.
    """
    return gap_m / closing_m_s if closing_m_s > 0 else math.inf


def gap_condition(gap_m: float, closing_m_s: float, config: SafetyConfig) -> bool:
    """Whether eq. 3 of the paper holds: gap_m - T_min * closing_m_s > d_TVmin.

    ``closing_m_s`` is positive if the gap shrinks.
    """
    return gap_m - config.minimum_ttc_s * closing_m_s > config.minimum_gap_m


def safe_action(ttc_s: float, config: SafetyConfig) -> Longitudinal:
    """Return the action that eq. 4 of the paper demands: hard brake, brake, or maintain.

    ``ttc_s`` is the time to collision with the vehicle ahead.
    """
    if ttc_s <= config.hard_brake_ttc_s:
        return Longitudinal.HARD_BRAKE
    if ttc_s <= config.brake_ttc_s:
        return Longitudinal.BRAKE
    return Longitudinal.MAINTAIN


def paper(scene: Scene, proposed: Action, config: SafetyConfig) -> Verdict:
    """Return the verdict of the three rules of Sec. III on the proposed action.

    The ego may still collide: see docs/safety.md. We decide two cases that the paper leaves open.
    Rule 1 permits a proposal that brakes at least as hard as eq. 4 demands. If rule 3 permits the
    ego neither to continue nor to abort a lane change, the ego moves to the lane that contains its
    centre. The settings ``printed_rule_1`` and ``printed_rule_3`` apply the rules as printed.
    """
    longitudinal, in_lane = _checked_longitudinal(scene, proposed.longitudinal, config)
    lateral, across = _checked_lateral(scene, proposed.lateral, config)
    rule = in_lane | across if across and in_lane else in_lane or across
    return Verdict(Action(lateral, longitudinal), rule)


def _checked_longitudinal(
    scene: Scene, proposed: Longitudinal, config: SafetyConfig
) -> tuple[Longitudinal, Rule]:
    """Return the action after rule 1, and its rule: gap condition (eq. 3), safe action (eq. 4)."""
    front = scene.affordances.own_front
    if front is None or front.relative_speed_m_s >= 0:
        return proposed, Rule.NONE
    closing = closing_speed(front)
    if gap_condition(front.gap_m, closing, config):
        return proposed, Rule.NONE
    safe = safe_action(time_to_collision(front.gap_m, closing), config)
    brakes_enough = proposed != Longitudinal.ACCELERATE and proposed >= safe
    if proposed == safe or (brakes_enough and not config.printed_rule_1):
        return proposed, Rule.NONE
    return safe, Rule.IN_LANE


def _checked_lateral(scene: Scene, proposed: Lateral, config: SafetyConfig) -> tuple[Lateral, Rule]:
    """Return the lateral action after rules 2 and 3, and the rule that replaced it."""
    affordances = scene.affordances
    wanted = next_lane_change(scene.lane_change, affordances.lane, proposed)
    if wanted is None:
        return proposed, Rule.NONE
    if not has_lane(affordances, wanted.target - affordances.lane):
        instead = Lateral.KEEP if scene.lane_change is None else toward(-wanted.sign)
        return instead, Rule.OFF_ROAD
    if lane_is_clear(affordances, wanted.target, config):
        return proposed, Rule.NONE
    if scene.lane_change is None:
        return Lateral.KEEP, Rule.LANE_CHANGE
    goes_back = config.printed_rule_3 or wanted.origin == affordances.lane
    there = has_lane(affordances, wanted.origin - affordances.lane)
    if goes_back or (there and lane_is_clear(affordances, wanted.origin, config)):
        return toward(-wanted.sign), Rule.LANE_CHANGE
    return proposed, Rule.NONE


def lane_is_clear(affordances: Affordances, lane: int, config: SafetyConfig) -> bool:
    """Whether rule 3 of the paper permits a lane change to the lane with this index.

    The gap condition (eq. 3) must hold for the vehicle ahead in the ego's lane, and for those ahead
    and behind in ``lane``, where there are any.
    """
    sign = lane - affordances.lane
    fronts, rear = (affordances.own_front, affordances.front(sign)), affordances.rear(sign)
    pairs = [(front.gap_m, closing_speed(front)) for front in fronts if front is not None]
    pairs += [] if rear is None else [(rear.gap_m, rear.relative_speed_m_s)]
    return all(gap_condition(*pair, config) for pair in pairs)
