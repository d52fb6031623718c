"""Settings of the ego: its motion and its observation."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting
from drl_av.config.traffic import STANDSTILL_GAP_M

LATERAL_PLANTS = ("kinematic", "steering")
LONGITUDINAL_REFERENCES = ("acceleration", "idm", "acc")


@dataclass(frozen=True)
class EgoConfig(Section):
    """Limits of the ego, its actions and how it carries them out."""

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
        "lateral plant: constant lateral speed (kinematic), or curvature feedback (Sec. III)",
        choices=LATERAL_PLANTS,
    )
    max_curvature_per_m: float = setting(
        0.2, "ours", "steering: largest curvature, a radius of 5 m", low=0.01, high=1
    )
    max_lateral_acceleration_m_s2: float = setting(
        2.0, "ours", "steering: largest lateral acceleration of an abort", low=0.1, high=10
    )
    steering_interval_s: float = setting(
        0.05, "ours", "steering: longest time between two curvature commands", low=0.001, high=0.1
    )
    longitudinal_reference: str = setting(
        "acceleration",
        "Sec. III",
        "reference of maintain and accelerate: the numbers above, IDM, or cruise control",
        choices=LONGITUDINAL_REFERENCES,
    )
    reference_headway_s: float = setting(
        1.3, "ours", "idm, acc: time gap; equal to the headway of d_safe", low=0.1, high=10
    )
    reference_standstill_gap_m: float = setting(
        STANDSTILL_GAP_M, "ours", "idm, acc: gap at standstill, SUMO's minGap", low=0, high=20
    )
    acc_gap_gain_per_s: float = setting(
        0.4, "ours", "acc: lambda, gain on the error of the gap", low=0.01, high=10
    )
    acc_speed_gain_per_s: float = setting(
        0.4, "ours", "acc: gain on the error of the speed", low=0.01, high=10
    )
    overtake_right: bool = setting(
        True, "ours", "whether rule-based drivers of the ego may pass on the right above 60 km/h"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("brake_m_s2", "hard_brake_m_s2")


@dataclass(frozen=True)
class ObservationConfig(Section):
    """Constants that scale the 27 indicators to about [-1, 1]."""

    range_m: float = setting(
        250.0, "Sec. IV-B", "range within which the ego observes other vehicles", low=10, high=2000
    )
    gap_scale_m: float = setting(
        100.0, "ours", "gap that the observation scales to 1", low=1, high=2000
    )
    speed_scale_m_s: float = setting(
        10.0, "ours", "relative velocity that scales to 1", low=0.1, high=60
    )
    lateral_scale_m: float = setting(
        3.8, "ours", "lateral offset that scales to 1", low=0.1, high=50
    )
    lateral_speed_scale_m_s: float = setting(
        0.76, "ours", "lateral velocity that the observation scales to 1", low=0.01, high=10
    )
