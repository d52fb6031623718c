"""Settings of the drivers by rule."""

from dataclasses import dataclass

from drl_av.settings import Section, setting


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
