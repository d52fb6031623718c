"""Settings of the reward."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting

DESIRED_VALUES = ("traffic", "fixed")


@dataclass(frozen=True)
class RewardConfig(Section):
    """The reward (eq. 6 to 8) and where its desired values come from."""

    desired: str = setting(
        "traffic",
        "Sec. IV-C",
        "desired values: follow the traffic, or stay fixed",
        choices=DESIRED_VALUES,
    )
    desired_speed_m_s: float = setting(30.0, "Sec. IV-C", "v_des on a free road", low=1, high=60)
    desired_lateral_m: float = setting(3.8, "Sec. IV-C", "y_des when fixed", low=0, high=50)
    collision_reward: float = setting(-3.0, "ours", "r_col", low=-1000, high=0)
    safe_headway_s: float = setting(1.3, "Sec. IV-C", "headway behind d_safe", low=0.1, high=10)
    catch_up_time_s: float = setting(
        8.0, "ours", "time in which a gap ahead may be closed", low=1, high=60
    )
    worthwhile_gain_m_s: float = setting(
        3.0, "ours", "speed another lane must offer above the own one", low=0, high=30
    )
    speed_tolerance_m_s: float = setting(
        1.0,
        "ours",
        "how far v_des may be from what the lane allows, behind a vehicle: half a decision's step",
        low=0,
        high=10,
    )
