"""The reward of a decision, eq. 7 to 9 of the paper, and the desired values in these equations."""

import math
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing, squared
from drl_av.config import RewardConfig, SafetyConfig
from drl_av.driving.affordances import ALLOWED, CHANGES, LANE, NO_VEHICLE, WITHIN, has_lane, slot_of
from drl_av.road.road import LANE_CHANGE_DUE_M
from drl_av.safety.paper import is_clear


class Rewards(NamedTuple):
    """The three terms of the reward (eq. 7, 8 and 9 of the paper), each in [-1, 0]."""

    r_v: float
    r_y: float
    r_x: float

    @property
    def total(self) -> float:
        """Mean of the three terms, in [-1, 0]."""
        return (self.r_v + self.r_y + self.r_x) / 3


def speed_reward(speed_m_s: float, desired_m_s: float) -> float:
    """Return r_v (eq. 7 of the paper): 0 at the desired speed, and down to -1 far from it."""
    return math.exp(-squared(speed_m_s - desired_m_s) / 10) - 1


def lateral_reward(lateral_m: float, desired_m: float) -> float:
    """Return r_y (eq. 8 of the paper): 0 at the desired position, and down to -1 far from it."""
    return math.exp(-squared(lateral_m - desired_m) / 10) - 1


def gap_reward(gap_m: float, safe_gap_m: float) -> float:
    """Return r_x (eq. 9 of the paper): 0 if the gap is at least d_safe, and down to -1 below."""
    if gap_m >= safe_gap_m:
        return 0.0
    return math.exp(-squared(gap_m - safe_gap_m) / (10 * safe_gap_m)) - 1


def safe_gap(speed_m_s: float, headway_s: float, minimum_gap_m: float) -> float:
    """Return d_safe (Sec. IV-C), m: headway times speed, but at least the minimum gap."""
    return max(headway_s * speed_m_s, minimum_gap_m)


def attainable_speed(
    gap_m: float, leader_m_s: float, config: RewardConfig, minimum_gap_m: float
) -> float:
    """Return the speed that a lane allows now, m/s (ours).

    It is the speed of the vehicle ahead in this lane, ``leader_m_s``, plus the closing speed that
    reduces the gap to d_safe within ``catch_up_time_s``. It is at most ``desired_speed_m_s``.
    """
    spare_m = gap_m - safe_gap(leader_m_s, config.safe_headway_s, minimum_gap_m)
    return min(config.desired_speed_m_s, leader_m_s + max(0.0, spare_m) / config.catch_up_time_s)


def tolerated_speed(speed_m_s: float, attainable_m_s: float, config: RewardConfig) -> float:
    """Return v_des, m/s: the attainable speed of the lane, with a tolerance (ours).

    Behind another vehicle the ego's speed may deviate from the attainable speed by
    ``speed_tolerance_m_s`` without a penalty, because actions change the speed in steps. v_des is
    therefore the speed within this tolerance that is nearest to the ego's speed. On a free road
    there is no tolerance, because the ego can reach the desired speed exactly.
    """
    if attainable_m_s >= config.desired_speed_m_s:
        return config.desired_speed_m_s
    lowest = attainable_m_s - config.speed_tolerance_m_s
    highest = min(attainable_m_s + config.speed_tolerance_m_s, config.desired_speed_m_s)
    return min(max(speed_m_s, lowest), highest)


@borrowing
def desired_values(
    values: FloatArray,
    codes: IntArray,
    lane_width_m: float,
    config: RewardConfig,
    safety: SafetyConfig,
) -> tuple[float, float]:
    """Return the desired speed v_des, m/s, and lateral position y_des, metres (ours).

    Both depend only on the arrays that ``indicators`` has filled. The setting ``reward.desired``
    says how:

    - "fixed": both are constants of the config.
    - "traffic": v_des is the ``tolerated_speed`` of the ego's lane. y_des is the centre of the best
      lane (``faster_side``).
    - "best-lane": as "traffic", but v_des is the tolerated speed of the fastest lane
      (``best_speed``).

    While mandatory lane changes are due (``due_changes``), "traffic" and "best-lane" do not differ.
    Then y_des is the centre of the lane to which these lane changes lead. v_des is the tolerated
    speed of the next lane in their direction, or of the ego's lane if the next lane has not begun
    yet.
    """
    if config.desired_is_fixed:
        return min(config.desired_speed_m_s, values[ALLOWED]), config.desired_lateral_m
    changes = codes[CHANGES]
    lanes = due_changes(changes, values[WITHIN])
    next_lane = np.sign(changes) if lanes != 0 and has_lane(codes, np.sign(changes)) else 0
    speed_m_s = lane_speed(values, codes, next_lane, config, safety)
    if lanes == 0:
        lanes = faster_side(values, codes, lane_width_m, speed_m_s, config, safety)
        if config.desired_is_best_lane:
            speed_m_s = best_speed(values, codes, config, safety)
    y_m = codes[LANE] * lane_width_m + lanes * lane_width_m
    return tolerated_speed(values[24], speed_m_s, config), y_m


def lane_speed(
    values: FloatArray, codes: IntArray, sign: int, config: RewardConfig, safety: SafetyConfig
) -> float:
    """Return the ``attainable_speed`` of the own (0), left (+1) or right (-1) lane, m/s.

    It is ``desired_speed_m_s`` if the lane is free, and at most what the speed limits allow.
    """
    slot = slot_of(sign)
    most_m_s: float = min(config.desired_speed_m_s, values[ALLOWED])
    if codes[slot] == NO_VEHICLE:
        return most_m_s
    leader_m_s = values[24] + values[4 * slot + 1]
    speed_m_s = attainable_speed(values[4 * slot], leader_m_s, config, safety.minimum_gap_m)
    return min(speed_m_s, most_m_s)


def best_speed(
    values: FloatArray, codes: IntArray, config: RewardConfig, safety: SafetyConfig
) -> float:
    """Return the highest ``lane_speed`` of the ego's lane and those beside it, m/s (ours).

    Whether rule 3 permits a lane change now does not matter.
    """
    best = lane_speed(values, codes, 0, config, safety)
    for side in (1, -1):
        if has_lane(codes, side):
            best = max(best, lane_speed(values, codes, side, config, safety))
    return best


def due_changes(changes: int, within_m: float) -> int:
    """Return how many of the mandatory lane changes are due now, left positive (ours).

    The arguments are the fields of ``MandatoryChange``. A lane change is due if it cannot be
    postponed, assuming that each takes ``LANE_CHANGE_DUE_M``.
    """
    if changes == 0:
        return 0
    due = max(abs(changes) - int(within_m // LANE_CHANGE_DUE_M), 0)
    return due if changes > 0 else -due


def faster_side(
    values: FloatArray,
    codes: IntArray,
    lane_width_m: float,
    own_m_s: float,
    config: RewardConfig,
    safety: SafetyConfig,
) -> int:
    """Return which lane is the best: +1 the left lane, -1 the right lane, 0 the ego's own (ours).

    Another lane is better if rule 3 permits the lane change, and if its attainable speed exceeds
    that of the ego's lane, ``own_m_s``, by more than ``worthwhile_gain_m_s``. If both other lanes
    are equally good, the lane nearer to the ego's centre is the best.
    """
    best, sign = own_m_s + config.worthwhile_gain_m_s, 0
    nearer = 1 if values[25] >= codes[LANE] * lane_width_m else -1
    for side in (nearer, -nearer):
        if has_lane(codes, side):
            there = lane_speed(values, codes, side, config, safety)
            if there > best and is_clear(values, codes, side, safety):
                best, sign = there, side
    return sign


@borrowing
def reward_terms(
    values: FloatArray,
    codes: IntArray,
    lane_width_m: float,
    config: RewardConfig,
    safety: SafetyConfig,
) -> tuple[float, float, float]:
    """Return the fields of ``Rewards`` in a scene, from the arrays that ``indicators`` fills."""
    desired_m_s, desired_m = desired_values(values, codes, lane_width_m, config, safety)
    gap_m = np.inf if codes[0] == NO_VEHICLE else values[0]
    return (
        speed_reward(values[24], desired_m_s),
        lateral_reward(values[25], desired_m),
        gap_reward(gap_m, safe_gap(values[24], config.safe_headway_s, safety.minimum_gap_m)),
    )
