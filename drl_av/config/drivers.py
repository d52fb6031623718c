"""Settings of the rule-based drivers of the ego and of the background traffic."""

from dataclasses import dataclass

from drl_av.config.section import Section, setting
from drl_av.config.traffic import STANDSTILL_GAP_M


@dataclass(frozen=True)
class DriverConfig(Section):
    """How smoothly the ego drives, whichever driver proposes its actions.

    hold_s: time for which the safety check must let the ego hold a higher speed behind the vehicle
        ahead, or it does not accelerate; it then also begins a lane change only if the check would
        let it go on a decision later; 0 leaves each driver as it is, and SUMO's own drivers ignore
        it (ours)
    """

    hold_s: float = setting(0.0, low=0, high=60)


@dataclass(frozen=True)
class MobilConfig(Section):
    """The ego's driver ``idm-mobil``: MOBIL's lane-change criteria, and the IDM that they use.

    politeness: p, politeness (Kesting 2007, Table 1)
    threshold_m_s2: delta a_th, threshold that the gain of a lane change must exceed (Kesting 2007,
        Table 1)
    safe_braking_m_s2: b_safe, hardest braking that a lane change may require of the new follower
        (Kesting 2007, Table 1)
    headway_s: T, time gap of the IDM; the mean headway of traffic calm (ours)
    standstill_gap_m: s_0, gap at standstill; SUMO's minGap (ours)
    acceleration_m_s2: a, acceleration of the IDM; the mean acceleration of traffic calm (ours)
    comfortable_braking_m_s2: b, comfortable braking (Kesting 2007, Table 1)
    """

    politeness: float = setting(0.2, low=0, high=1)
    threshold_m_s2: float = setting(0.1, low=0, high=10)
    safe_braking_m_s2: float = setting(4.0, low=0, high=10)
    headway_s: float = setting(1.1, low=0.1, high=10)
    standstill_gap_m: float = setting(STANDSTILL_GAP_M, low=0, high=20)
    acceleration_m_s2: float = setting(1.5, low=0.1, high=10)
    comfortable_braking_m_s2: float = setting(2.0, low=0.1, high=10)


@dataclass(frozen=True)
class FiniteStateConfig(Section):
    """The finite-state machine that drives background vehicles (states of Zhang et al. 2017).

    The values of its parameters are our own choice; those of Zhang et al. come from a numerical
    optimization.

    follow_headway_s: time gap below which the state changes from cruise to follow (ours)
    cruise_headway_s: time gap above which the state changes from follow to cruise (ours)
    slow_leader_m_s: a vehicle ahead is slow if it is slower than the desired speed by more than
        this (ours)
    worthwhile_gain_m_s: a lane is better if the vehicle ahead in it is faster by at least this
        (ours)
    lane_change_gap_m: gap ahead and behind that a lane change needs at equal speeds (ours)
    lane_change_time_s: additional gap that a lane change needs, per m/s of closing speed (ours)
    headway_s: time gap in the state follow (ours)
    standstill_gap_m: gap at standstill (ours)
    gap_gain_per_s2: acceleration per metre of gap above the desired gap (ours)
    speed_gain_per_s: acceleration per m/s of difference to the desired speed or to the vehicle
        ahead (ours)
    acceleration_m_s2: strongest acceleration, a_1 (Sec. IV-A)
    braking_m_s2: hardest braking, a_2 (Sec. IV-A)
    """

    follow_headway_s: float = setting(2.0, low=0.1, high=20)
    cruise_headway_s: float = setting(3.0, low=0.1, high=20)
    slow_leader_m_s: float = setting(1.0, low=0, high=30)
    worthwhile_gain_m_s: float = setting(1.0, low=0, high=30)
    lane_change_gap_m: float = setting(8.0, low=0, high=250)
    lane_change_time_s: float = setting(3.0, low=0, high=60)
    headway_s: float = setting(1.2, low=0.1, high=10)
    standstill_gap_m: float = setting(STANDSTILL_GAP_M, low=0, high=20)
    gap_gain_per_s2: float = setting(0.1, low=0, high=10)
    speed_gain_per_s: float = setting(0.6, low=0, high=10)
    acceleration_m_s2: float = setting(2.0, low=0.1, high=10)
    braking_m_s2: float = setting(4.0, low=0.1, high=10)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("follow_headway_s", "cruise_headway_s")


@dataclass(frozen=True)
class Level0Config(Section):
    """Limits by which a level-0 driver (Albaba and Yildiz 2020) classifies the vehicle ahead.

    The gap is close, nominal or far; the gap shrinks, is stable or grows.

    close_m: largest gap that counts as close (Albaba 2020)
    nominal_m: largest gap that counts as nominal; a larger gap counts as far (Albaba 2020)
    stable_m_s: largest absolute relative speed that counts as stable (ours)
    """

    close_m: float = setting(11.0, low=0, high=250)
    nominal_m: float = setting(27.0, low=0, high=250)
    stable_m_s: float = setting(0.5, low=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("close_m", "nominal_m")
