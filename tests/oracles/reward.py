"""The reward of a scene from its indicators by name, in plain Python."""

import math

from reward_terms import Desired

from drl_av.config import RewardConfig, SafetyConfig
from drl_av.driving.affordances import Affordances
from drl_av.env.reward import Rewards
from drl_av.road.road import LANE_CHANGE_DUE_M, MandatoryChange
from oracles.affordances import has_lane
from oracles.paper import lane_is_clear


def speed_reward(speed_m_s: float, desired_m_s: float) -> float:
    """Return r_v (eq. 7 of the paper): 0 at the desired speed, and down to -1 far from it."""
    return math.exp(-((speed_m_s - desired_m_s) ** 2) / 10) - 1


def lateral_reward(lateral_m: float, desired_m: float) -> float:
    """Return r_y (eq. 8 of the paper): 0 at the desired position, and down to -1 far from it."""
    return math.exp(-((lateral_m - desired_m) ** 2) / 10) - 1


def gap_reward(gap_m: float, safe_gap_m: float) -> float:
    """Return r_x (eq. 9 of the paper): 0 if the gap is at least d_safe, and down to -1 below."""
    if gap_m >= safe_gap_m:
        return 0.0
    return math.exp(-((gap_m - safe_gap_m) ** 2) / (10 * safe_gap_m)) - 1


def safe_gap(speed_m_s: float, headway_s: float, minimum_gap_m: float) -> float:
    """Return d_safe (Sec. IV-C), m: headway times speed, but at least the minimum gap."""
    return max(headway_s * speed_m_s, minimum_gap_m)


def attainable_speed(
    affordances: Affordances, sign: int, config: RewardConfig, minimum_gap_m: float
) -> float:
    """Return the speed that a lane allows now, m/s (ours).

    ``sign`` selects the lane: the own (0), left (+1) or right (-1) lane. The speed is that of the
    vehicle ahead in this lane, plus the closing speed that reduces the gap to d_safe within
    ``catch_up_time_s``. It is at most ``desired_speed_m_s``, and equal to it if the lane is free.
    """
    front = affordances.front(sign)
    if front is None:
        return config.desired_speed_m_s
    leader_m_s = affordances.ego_speed_m_s + front.relative_speed_m_s
    spare_m = front.gap_m - safe_gap(leader_m_s, config.safe_headway_s, minimum_gap_m)
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


def desired(affordances: Affordances, config: RewardConfig, safety: SafetyConfig) -> Desired:
    """Return the desired speed v_des, m/s, and lateral position y_des, metres (ours).

    Both depend on the affordance indicators only. ``config.desired`` says how:

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
    if config.desired == "fixed":
        return Desired(config.desired_speed_m_s, config.desired_lateral_m)
    lanes = due_changes(affordances.mandatory)
    side = 1 if lanes > 0 else -1
    next_lane = side if lanes and has_lane(affordances, side) else 0
    speed_m_s = attainable_speed(affordances, next_lane, config, safety.minimum_gap_m)
    if not lanes:
        lanes = faster_side(affordances, speed_m_s, config, safety)
        if config.desired == "best-lane":
            speed_m_s = best_speed(affordances, config, safety.minimum_gap_m)
    return Desired(
        tolerated_speed(affordances.ego_speed_m_s, speed_m_s, config),
        affordances.lane_center_m + lanes * affordances.lane_width_m,
    )


def best_speed(affordances: Affordances, config: RewardConfig, minimum_gap_m: float) -> float:
    """Return the highest ``attainable_speed`` of the ego's lane and those beside it, m/s (ours).

    Whether rule 3 permits a lane change now does not matter.
    """
    sides = [0, *(side for side in (1, -1) if has_lane(affordances, side))]
    return max(attainable_speed(affordances, side, config, minimum_gap_m) for side in sides)


def due_changes(mandatory: MandatoryChange) -> int:
    """Return how many of the mandatory lane changes are due now, left positive (ours).

    A lane change is due if it cannot be postponed, assuming that each takes ``LANE_CHANGE_DUE_M``.
    """
    if not mandatory.lanes:
        return 0
    due = max(abs(mandatory.lanes) - int(mandatory.within_m // LANE_CHANGE_DUE_M), 0)
    return due if mandatory.lanes > 0 else -due


def faster_side(
    affordances: Affordances, own_m_s: float, config: RewardConfig, safety: SafetyConfig
) -> int:
    """Return which lane is the best: +1 the left lane, -1 the right lane, 0 the ego's own (ours).

    Another lane is better if rule 3 permits the lane change, and if its attainable speed exceeds
    that of the ego's lane, ``own_m_s``, by more than ``worthwhile_gain_m_s``. If both other lanes
    are equally good, the lane nearer to the ego's centre is the best.
    """
    best, sign = own_m_s + config.worthwhile_gain_m_s, 0
    nearer = 1 if affordances.ego_y_m >= affordances.lane_center_m else -1
    for side in (nearer, -nearer):
        if has_lane(affordances, side):
            there = attainable_speed(affordances, side, config, safety.minimum_gap_m)
            if there > best and lane_is_clear(affordances, affordances.lane + side, safety):
                best, sign = there, side
    return sign


def rewards(
    affordances: Affordances, target: Desired, config: RewardConfig, minimum_gap_m: float
) -> Rewards:
    """Return the three reward terms of a scene; r_x uses the vehicle ahead in the own lane."""
    front = affordances.own_front
    safe_gap_m = safe_gap(affordances.ego_speed_m_s, config.safe_headway_s, minimum_gap_m)
    return Rewards(
        speed_reward(affordances.ego_speed_m_s, target.speed_m_s),
        lateral_reward(affordances.ego_y_m, target.lateral_m),
        0.0 if front is None else gap_reward(front.gap_m, safe_gap_m),
    )
