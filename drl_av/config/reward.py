"""Settings of the reward."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting

DESIRED_VALUES = ("traffic", "best-lane", "fixed")


@dataclass(frozen=True)
class RewardConfig(Section):
    """The reward (eq. 7 to 9 of the paper), and the choice of the desired speed and lane.

    desired: v_des and y_des: computed from the traffic, v_des for the ego's lane (traffic) or for
        the best lane nearby (best-lane), or constant (fixed) (Sec. IV-C)
    desired_speed_m_s: v_des on a free road, and if desired is fixed (Sec. IV-C)
    desired_lateral_m: y_des if desired is fixed; 0 is the centre of the rightmost lane, left is
        positive (Sec. IV-C)
    collision_reward: r_col, reward of a decision with a collision (ours)
    safe_headway_s: time gap of d_safe, the safe gap of eq. 9 (Sec. IV-C)
    catch_up_time_s: time in which the ego reduces a larger gap to d_safe if it drives at v_des
        (ours)
    worthwhile_gain_m_s: y_des is the centre of another lane if that allows a speed higher by more
        than this (ours)
    speed_tolerance_m_s: largest deviation from v_des behind another vehicle that costs no reward;
        the default is half of the speed change of one decision (ours)
    """

    desired: str = setting("traffic", choices=DESIRED_VALUES)
    desired_speed_m_s: float = setting(30.0, low=1, high=60)
    desired_lateral_m: float = setting(3.8, low=0, high=50)
    collision_reward: float = setting(-3.0, low=-1000, high=0)
    safe_headway_s: float = setting(1.3, low=0.1, high=10)
    catch_up_time_s: float = setting(8.0, low=1, high=60)
    worthwhile_gain_m_s: float = setting(3.0, low=0, high=30)
    speed_tolerance_m_s: float = setting(1.0, low=0, high=10)
