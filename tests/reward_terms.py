"""The reward of a scene, by the functions that the environment compiles."""

from typing import NamedTuple

from drl_av.config import RewardConfig, SafetyConfig
from drl_av.driving.affordances import Indicators
from drl_av.driving.scene import Scene
from drl_av.env.reward import Rewards, desired_values, reward_terms


class Desired(NamedTuple):
    """v_des, m/s, and y_des, metres."""

    speed_m_s: float
    lateral_m: float


def desired(seen: Indicators, config: RewardConfig, safety: SafetyConfig) -> Desired:
    given = config.numbers, safety.numbers
    return Desired(*desired_values(seen.values, seen.codes, seen.ground[1], *given))


def rewards(world: Scene, config: RewardConfig) -> Rewards:
    values, codes, ground, *_ = world.indicators
    return Rewards(*reward_terms(values, codes, ground[1], config.numbers, SafetyConfig().numbers))
