"""Settings of the ego: its limits, its actions and its observation."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting
from drl_av.config.traffic import STANDSTILL_GAP_M

LATERAL_PLANTS = ("kinematic", "steering")
LONGITUDINAL_REFERENCES = ("acceleration", "idm", "acc")


@dataclass(frozen=True)
class EgoConfig(Section):
    """The ego: its limits, the accelerations of its actions, and how it executes an action."""

    max_speed_m_s: float = setting(30.0, "ours", "highest speed of the ego", low=1, high=60)
    accelerate_m_s2: float = setting(
        2.0, "Sec. IV-A", "a_1, acceleration of the action accelerate", low=0.1, high=10
    )
    brake_m_s2: float = setting(
        2.0, "Sec. IV-A", "a_1, braking of the action brake", low=0.1, high=10
    )
    hard_brake_m_s2: float = setting(
        4.0, "Sec. IV-A", "a_2, braking of the action hard brake", low=0.1, high=10
    )
    lane_change_duration_s: float = setting(
        5.0, "Table I", "T_LC, duration of a lane change", low=1, high=20
    )
    lateral_plant: str = setting(
        "kinematic",
        "Sec. IV-A",
        "lateral motion: constant lateral speed (kinematic), or curvature feedback of Sec. III "
        "(steering)",
        choices=LATERAL_PLANTS,
    )
    max_curvature_per_m: float = setting(
        0.2,
        "ours",
        "lateral_plant steering: largest curvature of the path; 0.2 is a radius of 5 m",
        low=0.01,
        high=1,
    )
    max_lateral_acceleration_m_s2: float = setting(
        2.0,
        "ours",
        "lateral_plant steering: largest lateral acceleration, which an abort may reach",
        low=0.1,
        high=10,
    )
    steering_interval_s: float = setting(
        0.05,
        "ours",
        "lateral_plant steering: longest time between two curvature commands",
        low=0.001,
        high=0.1,
    )
    longitudinal_reference: str = setting(
        "acceleration",
        "Sec. III",
        "how maintain and accelerate set the speed: constant acceleration (acceleration), IDM "
        "(idm), or adaptive cruise control (acc)",
        choices=LONGITUDINAL_REFERENCES,
    )
    reference_headway_s: float = setting(
        1.3,
        "ours",
        "longitudinal_reference idm or acc: time gap; the same as in d_safe",
        low=0.1,
        high=10,
    )
    reference_standstill_gap_m: float = setting(
        STANDSTILL_GAP_M,
        "ours",
        "longitudinal_reference idm or acc: gap at standstill, SUMO's minGap",
        low=0,
        high=20,
    )
    acc_gap_gain_per_s: float = setting(
        0.4, "ours", "longitudinal_reference acc: lambda, gain on the gap error", low=0.01, high=10
    )
    acc_speed_gain_per_s: float = setting(
        0.4, "ours", "longitudinal_reference acc: gain on the speed error", low=0.01, high=10
    )
    overtake_right: bool = setting(
        True,
        "ours",
        "whether the ego's rule-based drivers may pass another vehicle on the right above 60 km/h",
    )

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
    """The observation: the sensor range, and the divisors that scale the 27 indicators."""

    range_m: float = setting(
        250.0, "Sec. IV-B", "range within which the ego observes other vehicles", low=10, high=2000
    )
    gap_scale_m: float = setting(
        100.0, "ours", "gap that becomes 1 in the observation", low=1, high=2000
    )
    speed_scale_m_s: float = setting(
        10.0, "ours", "relative velocity that becomes 1 in the observation", low=0.1, high=60
    )
    lateral_scale_m: float = setting(
        3.8, "ours", "lateral offset that becomes 1 in the observation", low=0.1, high=50
    )
    lateral_speed_scale_m_s: float = setting(
        0.76, "ours", "lateral velocity that becomes 1 in the observation", low=0.01, high=10
    )
    way: bool = setting(
        False,
        "ours",
        "whether the observation also has the groups lane_end and way, which a driver needs where "
        "its way demands lane changes",
    )
