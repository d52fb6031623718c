"""The reward of a scene, by the functions that the environment compiles."""

import math
from typing import NamedTuple

from drl_av.config import RewardConfig, SafetyConfig
from drl_av.driving.affordances import Affordances, Indicators
from drl_av.env.reward import Rewards, desired_values, terms


class Desired(NamedTuple):
    """v_des, m/s, and y_des, metres."""

    speed_m_s: float
    lateral_m: float


def desired(seen: Indicators, config: RewardConfig, safety: SafetyConfig) -> Desired:
    given = config.numbers, safety.numbers
    return Desired(*desired_values(seen.values, seen.codes, seen.ground[1], *given))


def rewards(
    affordances: Affordances, target: Desired, config: RewardConfig, minimum_gap_m: float
) -> Rewards:
    front = affordances.own_front
    gap_m = math.inf if front is None else front.gap_m
    state = affordances.ego_speed_m_s, affordances.ego_y_m, gap_m
    return Rewards(*terms(*state, *target, config, minimum_gap_m))
