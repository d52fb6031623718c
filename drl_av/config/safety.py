"""Settings of the safety checks."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting


@dataclass(frozen=True)
class SafetyConfig(Section):
    """The safety check; the gap condition (eq. 3) and the safe action (eq. 4) of ``paper``."""

    check: str = setting(
        "paper", "Sec. III", "name of the safety check: permit_all, paper or strict"
    )
    minimum_ttc_s: float = setting(
        3.0, "Table I", "T_min of eq. 3, smallest safe time to collision", low=0, high=60
    )
    hard_brake_ttc_s: float = setting(
        2.0,
        "Table I",
        "T_HB of eq. 4, largest time to collision at which the check demands hard brake",
        low=0,
        high=60,
    )
    brake_ttc_s: float = setting(
        3.0,
        "Table I",
        "T_B of eq. 4, largest time to collision at which the check demands brake",
        low=0,
        high=60,
    )
    accelerate_ttc_s: float = setting(
        8.0,
        "Table I",
        "T_A, time to collision above which the driver idm accelerates",
        low=0,
        high=60,
    )
    minimum_gap_m: float = setting(
        15.0, "Table I", "d_TVmin of eq. 3, smallest safe gap", low=0, high=250
    )
    printed_rule_1: bool = setting(
        False,
        "ours",
        "rule 1 of the check paper as printed: it replaces a harder brake than eq. 4 demands, too",
    )
    printed_rule_3: bool = setting(
        False,
        "ours",
        "rule 3 of the check paper as printed: an unsafe lane change is reversed even if the way "
        "back is unsafe",
    )
    printed_idm: bool = setting(
        False,
        "ours",
        "the paper's IDM rule as printed: accelerates above T_A without the gap condition (eq. 3)",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("hard_brake_ttc_s", "brake_ttc_s", "accelerate_ttc_s")


@dataclass(frozen=True)
class StrictConfig(Section):
    """Bounds of the check ``strict``: under it the ego hits no vehicle that keeps to these bounds.

    The check refuses a scenario whose vehicle types exceed these bounds.
    """

    braking_m_s2: float = setting(
        4.0,
        "ours",
        "hardest braking of a vehicle ahead; at least SUMO's emergencyDecel of the traffic",
        low=0.1,
        high=20,
    )
    acceleration_m_s2: float = setting(
        2.0,
        "ours",
        "strongest acceleration of a vehicle behind; at least traffic.acceleration_max_m_s2",
        low=0,
        high=20,
    )
    lateral_speed_m_s: float = setting(
        0.76,
        "ours",
        "largest lateral speed of a vehicle; at least SUMO's maxSpeedLat of the traffic",
        low=0,
        high=10,
    )
    follower_response_s: float = setting(
        0.5,
        "ours",
        "longest time until a vehicle behind brakes for the ego; at least one SUMO step",
        low=0,
        high=5,
    )
    follower_braking_m_s2: float = setting(
        4.0,
        "ours",
        "braking of a vehicle behind on which the check relies; at most SUMO's decel of the "
        "traffic",
        low=0.1,
        high=20,
    )
    clearance_m: float = setting(
        0.5, "ours", "gap between stopped vehicles that remains in the worst case", low=0, high=50
    )
