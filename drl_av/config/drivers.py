"""Settings of the rule-based drivers of the ego and of the traffic."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting
from drl_av.config.traffic import STANDSTILL_GAP_M


@dataclass(frozen=True)
class MobilConfig(Section):
    """MOBIL's lane-change criteria in ``idm-mobil``, and the IDM that evaluates them."""

    politeness: float = setting(0.2, "Kesting 2007, Table 1", "p, politeness", low=0, high=1)
    threshold_m_s2: float = setting(
        0.1,
        "Kesting 2007, Table 1",
        "delta a_th, the gain that a lane change must exceed",
        low=0,
        high=10,
    )
    safe_braking_m_s2: float = setting(
        4.0, "Kesting 2007, Table 1", "b_safe, hardest braking of the new follower", low=0, high=10
    )
    headway_s: float = setting(
        1.1, "ours", "T, time gap; the mean of the traffic's", low=0.1, high=10
    )
    standstill_gap_m: float = setting(
        STANDSTILL_GAP_M, "ours", "s_0, gap at standstill; SUMO's minGap", low=0, high=20
    )
    acceleration_m_s2: float = setting(
        1.5, "ours", "a, acceleration; the mean of the traffic's", low=0.1, high=10
    )
    comfortable_braking_m_s2: float = setting(
        2.0, "Kesting 2007, Table 1", "b, comfortable braking", low=0.1, high=10
    )


@dataclass(frozen=True)
class FiniteStateConfig(Section):
    """State changes and control of the finite-state machine (states of Zhang et al. 2017).

    The numbers are ours; Zhang et al. optimize theirs numerically.
    """

    follow_headway_s: float = setting(
        2.0, "ours", "cruise -> follow below this time gap", low=0.1, high=20
    )
    cruise_headway_s: float = setting(
        3.0, "ours", "follow -> cruise above this time gap", low=0.1, high=20
    )
    slow_leader_m_s: float = setting(
        1.0,
        "ours",
        "a vehicle ahead is slow if it drives this much below the desired speed",
        low=0,
        high=30,
    )
    worthwhile_gain_m_s: float = setting(
        1.0, "ours", "a lane is better if its vehicle ahead is this much faster", low=0, high=30
    )
    lane_change_gap_m: float = setting(
        8.0, "ours", "gap that a lane change needs at equal speeds", low=0, high=250
    )
    lane_change_time_s: float = setting(
        3.0,
        "ours",
        "additional gap that a lane change needs, per m/s of closing speed",
        low=0,
        high=60,
    )
    headway_s: float = setting(1.2, "ours", "time gap in the state follow", low=0.1, high=10)
    standstill_gap_m: float = setting(STANDSTILL_GAP_M, "ours", "gap at standstill", low=0, high=20)
    gap_gain_per_s2: float = setting(
        0.1, "ours", "acceleration per metre of gap above the wanted gap", low=0, high=10
    )
    speed_gain_per_s: float = setting(
        0.6, "ours", "acceleration per m/s of relative speed", low=0, high=10
    )
    acceleration_m_s2: float = setting(
        2.0, "Sec. IV-A", "strongest acceleration, a_1", low=0.1, high=10
    )
    braking_m_s2: float = setting(4.0, "Sec. IV-A", "hardest braking, a_2", low=0.1, high=10)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("follow_headway_s", "cruise_headway_s")


@dataclass(frozen=True)
class Level0Config(Section):
    """How a level-0 driver classifies the vehicle ahead (Albaba and Yildiz 2020)."""

    close_m: float = setting(11.0, "Albaba 2020", "gaps up to this are close", low=0, high=250)
    nominal_m: float = setting(
        27.0, "Albaba 2020", "gaps up to this are nominal, beyond it far", low=0, high=250
    )
    stable_m_s: float = setting(0.5, "ours", "relative speeds up to this count as stable", low=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("close_m", "nominal_m")
