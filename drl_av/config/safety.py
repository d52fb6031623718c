"""Settings of the safety checks."""

from dataclasses import dataclass

from drl_av.config.section import Section, setting


@dataclass(frozen=True)
class SafetyConfig(Section):
    """The safety check; the gap condition (eq. 3) and the safe action (eq. 4) of ``paper``.

    check: name of the safety check: permit_all, paper or strict (Sec. III)
    minimum_ttc_s: T_min of eq. 3, smallest safe time to collision (Table I)
    hard_brake_ttc_s: T_HB of eq. 4, largest time to collision at which the check demands hard brake
        (Table I)
    brake_ttc_s: T_B of eq. 4, largest time to collision at which the check demands brake (Table I)
    accelerate_ttc_s: T_A, time to collision above which the driver idm accelerates (Table I)
    minimum_gap_m: d_TVmin of eq. 3, smallest safe gap (Table I)
    printed_rule_1: rule 1 of the check paper as printed: it replaces a harder brake than eq. 4
        demands, too (ours)
    printed_rule_3: rule 3 of the check paper as printed: an unsafe lane change is reversed even if
        the way back is unsafe (ours)
    printed_idm: the paper's IDM rule as printed: accelerates above T_A without the gap condition
        (eq. 3) (ours)
    """

    check: str = "paper"
    minimum_ttc_s: float = setting(3.0, low=0, high=60)
    hard_brake_ttc_s: float = setting(2.0, low=0, high=60)
    brake_ttc_s: float = setting(3.0, low=0, high=60)
    accelerate_ttc_s: float = setting(8.0, low=0, high=60)
    minimum_gap_m: float = setting(15.0, low=0, high=250)
    printed_rule_1: bool = False
    printed_rule_3: bool = False
    printed_idm: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("hard_brake_ttc_s", "brake_ttc_s", "accelerate_ttc_s")


@dataclass(frozen=True)
class StrictConfig(Section):
    """Bounds of the check ``strict``: under it the ego hits no vehicle that keeps to these bounds.

    The check refuses a scenario whose vehicle types exceed these bounds.

    braking_m_s2: hardest braking of a vehicle ahead; at least SUMO's emergencyDecel of the traffic
        (ours)
    acceleration_m_s2: strongest acceleration of a vehicle behind; at least
        traffic.acceleration_max_m_s2 (ours)
    lateral_speed_m_s: largest lateral speed of a vehicle; at least SUMO's maxSpeedLat of the
        traffic (ours)
    follower_response_s: longest time until a vehicle behind brakes for the ego; at least one SUMO
        step (ours)
    follower_braking_m_s2: braking of a vehicle behind on which the check relies; at most SUMO's
        decel of the traffic (ours)
    clearance_m: gap between stopped vehicles that remains in the worst case (ours)
    """

    braking_m_s2: float = setting(4.0, low=0.1, high=20)
    acceleration_m_s2: float = setting(2.0, low=0, high=20)
    lateral_speed_m_s: float = setting(0.76, low=0, high=10)
    follower_response_s: float = setting(0.5, low=0, high=5)
    follower_braking_m_s2: float = setting(4.0, low=0.1, high=20)
    clearance_m: float = setting(0.5, low=0, high=50)
