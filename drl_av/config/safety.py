"""Settings of the safety checks."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting


@dataclass(frozen=True)
class SafetyConfig(Section):
    """The short-horizon safety check (eq. 2 and 3)."""

    check: str = setting(
        "paper", "Sec. III", "name of the safety check: permit_all, paper or strict"
    )
    minimum_ttc_s: float = setting(3.0, "Table I", "T_min of eq. 2", low=0, high=60)
    hard_brake_ttc_s: float = setting(
        2.0, "Table I", "T_HB of eq. 3, hard brake up to it", low=0, high=60
    )
    brake_ttc_s: float = setting(3.0, "Table I", "T_B of eq. 3, brake up to it", low=0, high=60)
    accelerate_ttc_s: float = setting(
        8.0, "Table I", "T_A, the driver idm accelerates above it", low=0, high=60
    )
    minimum_gap_m: float = setting(15.0, "Table I", "d_TVmin of eq. 2", low=0, high=250)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("hard_brake_ttc_s", "brake_ttc_s", "accelerate_ttc_s")


@dataclass(frozen=True)
class StrictConfig(Section):
    """Bounds on the other vehicles under which the ego hits no vehicle with the check ``strict``.

    The check refuses a scenario whose vehicle types exceed these bounds.
    """

    braking_m_s2: float = setting(
        4.0,
        "ours",
        "hardest braking of a vehicle ahead; at least its emergencyDecel",
        low=0.1,
        high=20,
    )
    acceleration_m_s2: float = setting(
        2.0,
        "ours",
        "strongest acceleration of a vehicle behind; at least its accel",
        low=0,
        high=20,
    )
    lateral_speed_m_s: float = setting(
        0.76, "ours", "largest lateral speed of a vehicle; at least its maxSpeedLat", low=0, high=10
    )
    follower_response_s: float = setting(
        0.5,
        "ours",
        "time until a vehicle behind brakes for the ego; at least a SUMO step",
        low=0,
        high=5,
    )
    follower_braking_m_s2: float = setting(
        4.0,
        "ours",
        "braking of a vehicle behind on which the check relies; at most its decel",
        low=0.1,
        high=20,
    )
    clearance_m: float = setting(0.5, "ours", "gap that remains in the worst case", low=0, high=50)
