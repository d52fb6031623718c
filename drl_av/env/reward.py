"""The reward of a decision: eq. 6, 7 and 8 of the paper, and what they are measured against."""

import math
from typing import NamedTuple

from drl_av.config import EgoConfig, RewardConfig, SafetyConfig
from drl_av.driving.affordances import Affordances
from drl_av.safety.paper import lane_is_clear


class Desired(NamedTuple):
    """What the reward compares the ego with."""

    speed_m_s: float
    lateral_m: float


class Rewards(NamedTuple):
    """The three terms, each in [-1, 0]."""

    r_v: float
    r_y: float
    r_x: float

    @property
    def total(self) -> float:
        """Their equally weighted mean, in [-1, 0]."""
        return (self.r_v + self.r_y + self.r_x) / 3


def speed_reward(speed_m_s: float, desired_m_s: float) -> float:
    """r_v, eq. 6: 0 at the desired speed, towards -1 away from it."""
    return math.exp(-((speed_m_s - desired_m_s) ** 2) / 10) - 1


def lateral_reward(lateral_m: float, desired_m: float) -> float:
    """r_y, eq. 7: 0 at the desired lateral position, towards -1 away from it."""
    return math.exp(-((lateral_m - desired_m) ** 2) / 10) - 1


def gap_reward(gap_m: float, safe_gap_m: float) -> float:
    """r_x, eq. 8: 0 from the safe gap on, towards -1 the closer the vehicle ahead is."""
    if gap_m >= safe_gap_m:
        return 0.0
    return math.exp(-((gap_m - safe_gap_m) ** 2) / (10 * safe_gap_m)) - 1


def speed_bonus(speed_m_s: float, ego: EgoConfig, weight: float) -> float:
    """What may be learnt beside the reward: the weight at the ego's highest speed (ours)."""
    return weight * speed_m_s / ego.max_speed_m_s


def safe_gap(speed_m_s: float, headway_s: float, minimum_gap_m: float) -> float:
    """d_safe, Sec. IV-C: the gap of the wanted headway, at least the minimum gap, metres."""
    return max(headway_s * speed_m_s, minimum_gap_m)


def attainable_speed(
    affordances: Affordances, sign: int, config: RewardConfig, minimum_gap_m: float
) -> float:
    """Speed that the own (0), left (+1) or right (-1) lane allows now, m/s (ours).

    That of its vehicle ahead, and what closing the gap behind it to d_safe within
    ``catch_up_time_s`` adds; never above the desired speed of a free road.
    """
    front = affordances.front(sign)
    if front is None:
        return config.desired_speed_m_s
    leader_m_s = affordances.ego_speed_m_s + front.relative_speed_m_s
    spare_m = front.gap_m - safe_gap(leader_m_s, config.safe_headway_s, minimum_gap_m)
    return min(config.desired_speed_m_s, leader_m_s + max(0.0, spare_m) / config.catch_up_time_s)


def tolerated_speed(speed_m_s: float, attainable_m_s: float, config: RewardConfig) -> float:
    """The nearest speed to the ego's within the tolerance of what its lane allows, m/s (ours).

    Behind another vehicle the ego is ``speed_tolerance_m_s`` off for nothing, because decisions
    change its speed in steps. On a free road there is no tolerance: it can reach that speed.
    """
    if attainable_m_s >= config.desired_speed_m_s:
        return config.desired_speed_m_s
    lowest = attainable_m_s - config.speed_tolerance_m_s
    highest = min(attainable_m_s + config.speed_tolerance_m_s, config.desired_speed_m_s)
    return min(max(speed_m_s, lowest), highest)


def desired(affordances: Affordances, config: RewardConfig, safety: SafetyConfig) -> Desired:
    """The desired speed and lateral position in this traffic, a function of the indicators.

    ``fixed``: the two numbers of the config. ``traffic``: the ``tolerated_speed`` in the own
    lane, and the centre of the best lane, the nearest of equally good ones; another lane than the
    own is better only from ``worthwhile_gain_m_s`` on, and only where rule 3 lets the ego into it.
    """
    if config.desired == "fixed":
        return Desired(config.desired_speed_m_s, config.desired_lateral_m)
    own = attainable_speed(affordances, 0, config, safety.minimum_gap_m)
    best, sign = own + config.worthwhile_gain_m_s, 0
    nearer = 1 if affordances.ego_y_m >= affordances.lane_center_m else -1
    for side in (nearer, -nearer):
        if affordances.has_lane(side):
            there = attainable_speed(affordances, side, config, safety.minimum_gap_m)
            if there > best and lane_is_clear(affordances, affordances.lane + side, safety):
                best, sign = there, side
    return Desired(
        tolerated_speed(affordances.ego_speed_m_s, own, config),
        affordances.lane_center_m + sign * affordances.lane_width_m,
    )


def rewards(
    affordances: Affordances, target: Desired, config: RewardConfig, minimum_gap_m: float
) -> Rewards:
    """The three terms of one moment; r_x reads the vehicle ahead in the ego's own lane."""
    front = affordances.own_front
    safe_gap_m = safe_gap(affordances.ego_speed_m_s, config.safe_headway_s, minimum_gap_m)
    return Rewards(
        speed_reward(affordances.ego_speed_m_s, target.speed_m_s),
        lateral_reward(affordances.ego_y_m, target.lateral_m),
        0.0 if front is None else gap_reward(front.gap_m, safe_gap_m),
    )
