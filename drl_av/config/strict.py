"""Settings of the check ``strict``: what it takes the other vehicles to do at the most."""

from dataclasses import dataclass

from drl_av.settings import Section, setting


@dataclass(frozen=True)
class StrictConfig(Section):
    """Bounds on the other vehicles under which ``strict`` lets the ego hit nothing.

    The vehicle types of a scenario keep to them (``traffic/scenario_files.py``).
    """

    braking_m_s2: float = setting(
        4.0, "ours", "hardest braking of a vehicle ahead: its emergencyDecel", low=0.1, high=20
    )
    acceleration_m_s2: float = setting(
        2.0, "ours", "strongest acceleration of a vehicle behind: its accel", low=0, high=20
    )
    lateral_speed_m_s: float = setting(
        0.76, "ours", "fastest move sideways: its maxSpeedLat", low=0, high=10
    )
    follower_response_s: float = setting(
        0.5,
        "ours",
        "after which a vehicle behind brakes for the ego, a SUMO step",
        low=0,
        high=5,
    )
    follower_braking_m_s2: float = setting(
        4.0, "ours", "and as hard as this, if it must: its decel", low=0.1, high=20
    )
    clearance_m: float = setting(
        0.5, "ours", "what is left of every gap in the worst case", low=0, high=50
    )
