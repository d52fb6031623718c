"""Settings of the drivers by rule, the ego's and the traffic's."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting


@dataclass(frozen=True)
class MobilConfig(Section):
    """The lane-change criteria of ``idm-mobil``, and the IDM they are worked out with."""

    politeness: float = setting(0.2, "Kesting 2007, Table 1", "p", low=0, high=1)
    threshold_m_s2: float = setting(0.1, "Kesting 2007, Table 1", "delta a_th", low=0, high=10)
    safe_braking_m_s2: float = setting(4.0, "Kesting 2007, Table 1", "b_safe", low=0, high=10)
    headway_s: float = setting(1.1, "ours", "T, the mean of the traffic's", low=0.1, high=10)
    standstill_gap_m: float = setting(2.5, "ours", "s_0, SUMO's minGap", low=0, high=20)
    acceleration_m_s2: float = setting(
        1.5, "ours", "a, the mean of the traffic's", low=0.1, high=10
    )
    comfortable_braking_m_s2: float = setting(2.0, "Kesting 2007, Table 1", "b", low=0.1, high=10)


@dataclass(frozen=True)
class FiniteStateConfig(Section):
    """When the finite-state machine (states of Zhang et al. 2017) changes state, and its control.

    The numbers are ours; that paper tunes its own by stochastic optimization.
    """

    follow_headway_s: float = setting(
        2.0, "ours", "cruise -> follow below this time gap", low=0.1, high=20
    )
    cruise_headway_s: float = setting(
        3.0, "ours", "follow -> cruise above this time gap", low=0.1, high=20
    )
    slow_leader_m_s: float = setting(
        1.0, "ours", "a vehicle ahead this much below the desired speed is slow", low=0, high=30
    )
    worthwhile_gain_m_s: float = setting(
        1.0, "ours", "a lane whose vehicle ahead is this much faster is better", low=0, high=30
    )
    lane_change_gap_m: float = setting(
        8.0, "ours", "gap in the other lane needed at equal speeds", low=0, high=250
    )
    lane_change_time_s: float = setting(
        3.0, "ours", "and this much more of it for each m/s of closing speed", low=0, high=60
    )
    headway_s: float = setting(1.2, "ours", "time gap kept in follow", low=0.1, high=10)
    standstill_gap_m: float = setting(2.5, "ours", "gap kept at a standstill", low=0, high=20)
    gap_gain_per_s2: float = setting(
        0.1, "ours", "acceleration for each metre of gap to spare", low=0, high=10
    )
    speed_gain_per_s: float = setting(
        0.6, "ours", "acceleration for each m/s of relative speed", low=0, high=10
    )
    acceleration_m_s2: float = setting(2.0, "Sec. IV-A", "most, a_1", low=0.1, high=10)
    braking_m_s2: float = setting(4.0, "Sec. IV-A", "hardest, a_2", low=0.1, high=10)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("follow_headway_s", "cruise_headway_s")


@dataclass(frozen=True)
class Level0Config(Section):
    """How coarsely a level-0 driver sees the vehicle ahead (Albaba and Yildiz 2020)."""

    close_m: float = setting(11.0, "Albaba 2020", "gaps up to this are close", low=0, high=250)
    nominal_m: float = setting(
        27.0, "Albaba 2020", "gaps up to this are nominal, beyond it far", low=0, high=250
    )
    stable_m_s: float = setting(
        0.5, "ours", "relative speeds up to this are neither approaching nor moving away", low=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("close_m", "nominal_m")
