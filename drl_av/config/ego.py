"""Settings of the ego: its limits and actions, its observation, and the reward."""

from dataclasses import dataclass

from drl_av.config.section import Section, setting
from drl_av.config.traffic import STANDSTILL_GAP_M

LATERAL_PLANTS = ("kinematic", "steering")
LONGITUDINAL_REFERENCES = ("acceleration", "idm", "acc")


@dataclass(frozen=True)
class EgoConfig(Section):
    """The ego: its limits, the accelerations of its actions, and how it executes an action.

    max_speed_m_s: highest speed of the ego (ours)
    accelerate_m_s2: a_1, acceleration of the action accelerate (Sec. IV-A)
    brake_m_s2: a_1, braking of the action brake (Sec. IV-A)
    hard_brake_m_s2: a_2, braking of the action hard brake (Sec. IV-A)
    lane_change_duration_s: T_LC, duration of a lane change (Table I)
    lateral_plant: lateral motion: constant lateral speed (kinematic), or curvature feedback of Sec.
        III (steering) (Sec. IV-A)
    max_curvature_per_m: lateral_plant steering: largest curvature of the path; 0.2 is a radius of 5
        m (ours)
    max_lateral_acceleration_m_s2: lateral_plant steering: largest lateral acceleration, which an
        abort may reach (ours)
    steering_interval_s: lateral_plant steering: longest time between two curvature commands (ours)
    longitudinal_reference: how maintain and accelerate set the speed: constant acceleration
        (acceleration), IDM (idm), or adaptive cruise control (acc) (Sec. III)
    reference_headway_s: longitudinal_reference idm or acc: time gap; the same as in d_safe (ours)
    reference_standstill_gap_m: longitudinal_reference idm or acc: gap at standstill, SUMO's minGap
        (ours)
    acc_gap_gain_per_s: longitudinal_reference acc: lambda, gain on the gap error (ours)
    acc_speed_gain_per_s: longitudinal_reference acc: gain on the speed error (ours)
    """

    max_speed_m_s: float = setting(30.0, low=1, high=60)
    accelerate_m_s2: float = setting(2.0, low=0.1, high=10)
    brake_m_s2: float = setting(2.0, low=0.1, high=10)
    hard_brake_m_s2: float = setting(4.0, low=0.1, high=10)
    lane_change_duration_s: float = setting(5.0, low=1, high=20)
    lateral_plant: str = setting("kinematic", choices=LATERAL_PLANTS)
    max_curvature_per_m: float = setting(0.2, low=0.01, high=1)
    max_lateral_acceleration_m_s2: float = setting(2.0, low=0.1, high=10)
    steering_interval_s: float = setting(0.05, low=0.001, high=0.1)
    longitudinal_reference: str = setting("acceleration", choices=LONGITUDINAL_REFERENCES)
    reference_headway_s: float = setting(1.3, low=0.1, high=10)
    reference_standstill_gap_m: float = setting(STANDSTILL_GAP_M, low=0, high=20)
    acc_gap_gain_per_s: float = setting(0.4, low=0.01, high=10)
    acc_speed_gain_per_s: float = setting(0.4, low=0.01, high=10)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("brake_m_s2", "hard_brake_m_s2")

    @property
    def has_steering(self) -> bool:
        """Whether ``lateral_plant`` is the steering plant, not the kinematic one."""
        return self.lateral_plant == "steering"

    @property
    def has_constant_acceleration(self) -> bool:
        """Whether ``longitudinal_reference`` is a constant acceleration, not a model."""
        return self.longitudinal_reference == "acceleration"

    @property
    def has_acc(self) -> bool:
        """Whether ``longitudinal_reference`` is adaptive cruise control."""
        return self.longitudinal_reference == "acc"


@dataclass(frozen=True)
class ObservationConfig(Section):
    """The observation: the sensor range, and the divisors that scale the 27 indicators.

    range_m: range within which the ego observes other vehicles (Sec. IV-B)
    gap_scale_m: gap that becomes 1 in the observation (ours)
    speed_scale_m_s: relative velocity that becomes 1 in the observation (ours)
    lateral_scale_m: lateral offset that becomes 1 in the observation (ours)
    lateral_speed_scale_m_s: lateral velocity that becomes 1 in the observation (ours)
    way: whether the observation also has the groups lane_end and way, which a driver needs where
        its way demands lane changes (ours)
    """

    range_m: float = setting(250.0, low=10, high=2000)
    gap_scale_m: float = setting(100.0, low=1, high=2000)
    speed_scale_m_s: float = setting(10.0, low=0.1, high=60)
    lateral_scale_m: float = setting(3.8, low=0.1, high=50)
    lateral_speed_scale_m_s: float = setting(0.76, low=0.01, high=10)
    way: bool = False


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

    @property
    def desired_is_fixed(self) -> bool:
        """Whether ``desired`` is a fixed speed and lane."""
        return self.desired == "fixed"

    @property
    def desired_is_best_lane(self) -> bool:
        """Whether the speed that ``desired`` means is that of the best lane."""
        return self.desired == "best-lane"
