"""Settings of the reward."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting

DESIRED_VALUES = ("traffic", "fixed")


@dataclass(frozen=True)
class RewardConfig(Section):
    """The reward (eq. 6 to 8) and the source of its desired values."""

    desired: str = setting(
        "traffic",
        "Sec. IV-C",
        "desired values: from the traffic, or fixed",
        choices=DESIRED_VALUES,
    )
    desired_speed_m_s: float = setting(30.0, "Sec. IV-C", "v_des on a free road", low=1, high=60)
    desired_lateral_m: float = setting(
        3.8, "Sec. IV-C", "y_des where the desired values are fixed", low=0, high=50
    )
    collision_reward: float = setting(
        -3.0, "ours", "r_col, reward of a collision", low=-1000, high=0
    )
    safe_headway_s: float = setting(1.3, "Sec. IV-C", "time gap of d_safe", low=0.1, high=10)
    catch_up_time_s: float = setting(
        8.0, "ours", "time in which v_des lets the ego close a gap", low=1, high=60
    )
    worthwhile_gain_m_s: float = setting(
        3.0, "ours", "additional speed that makes another lane the best one", low=0, high=30
    )
    speed_tolerance_m_s: float = setting(
        1.0,
        "ours",
        "tolerance of v_des behind a vehicle: half of what a decision changes the speed by",
        low=0,
        high=10,
    )
