"""Kinds of traffic: named presets of the section [traffic], with the source of each number."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from drl_av.config.schema import did_you_mean
from drl_av.config.traffic import TrafficConfig
from drl_av.errors import ConfigError


class TrafficPreset(NamedTuple):
    """A kind of traffic: its meaning, and the settings of [traffic] that it changes."""

    meaning: str
    settings: Mapping[str, tuple[Any, str]]
    """Maps the name of each changed setting to a pair: its value, and the source of this value."""


_A_QUARTER = 0.25, "Sec. IV-B names these drivers; a quarter of each is ours"
_BY_SUMO = 1.0, "SUMO's default lcSpeedGain"
_KUSARI = "Kusari, arXiv:2109.11620: 1.19 +- 0.26, two standard deviations to each side"
_TRUCK_LIMIT = "ours: about 60 mph, a limit for trucks in the United States"
_FITTED = "fitted to speed, time gap and range of the SPMD and IVBSS studies"
"""Fitted with ``verification/traffic_moments.py``, without regard to the ego's results."""

TRAFFIC_PRESETS: dict[str, TrafficPreset] = {
    "calm": TrafficPreset("lane changes are random only; no driver overtakes", {}),
    "paper": TrafficPreset(
        "IDM, finite-state, level-0 and level-1 drivers, a quarter of each",
        {
            "finite_state_share": _A_QUARTER,
            "level_0_share": _A_QUARTER,
            "level_1_share": _A_QUARTER,
        },
    ),
    "overtaking": TrafficPreset(
        "SUMO's drivers change lanes to get ahead",
        {"speed_gain_min": _BY_SUMO, "speed_gain_max": _BY_SUMO},
    ),
    "naturalistic": TrafficPreset(
        "speeds, gaps and lane changes similar to those measured on US highways, and trucks",
        {
            "desired_speed_min_m_s": (34.0, f"{_FITTED}; 35.5 on I-24, CorridorCalibration 3b"),
            "desired_speed_max_m_s": (40.0, "the road's speed limit"),
            "headway_min_s": (0.5, "SUMO's step; IDM keeps more near its desired speed"),
            "headway_max_s": (0.87, _FITTED),
            "acceleration_min_m_s2": (0.67, _KUSARI),
            "acceleration_max_m_s2": (1.71, _KUSARI),
            "speed_gain_min": (0.6, "fitted to highD's 0.12 lane changes a vehicle-km"),
            "speed_gain_max": (0.6, "the same"),
            "random_lane_changes_per_s": (0.0, "every lane change is for speed"),
            "overtake_right": (True, "usual on US highways, where the other values were measured"),
            "keep_stopping_distance": (True, "ours"),
            "truck_share": (0.1, "10 to 20 % of the vehicles on highways"),
            "truck_length_m": (12.0, "ours"),
            "truck_width_m": (2.5, "ours"),
            "truck_speed_min_m_s": (25.0, _TRUCK_LIMIT),
            "truck_speed_max_m_s": (28.0, _TRUCK_LIMIT),
            "truck_acceleration_m_s2": (0.67, "ours: as the weakest car"),
        },
    ),
    "hazards": TrafficPreset(
        "standing, crawling, hard-braking and fast vehicles, and lane changes into one lane from "
        "both sides",
        {
            "speed_gain_min": _BY_SUMO,
            "speed_gain_max": _BY_SUMO,
            "standing_share": (0.01, "ours: 0.4 of 40 vehicles"),
            "crawling_share": (0.02, "ours"),
            "crawling_speed_max_m_s": (8.0, "ours: below 30 km/h"),
            "fast_share": (0.1, "ours"),
            "fast_speed_m_s": (38.0, "ours: 8 m/s above the ego's highest speed"),
            "fast_speed_gain": (5.0, "ours"),
            "hard_braking_share": (0.15, "ours"),
            "hard_brakes_per_s": (0.02, "ours: once in 50 s"),
            "hard_brake_s": (3, "ours: at strict's bound, from 30 m/s down to 18"),
            "keep_stopping_distance": (True, "ours"),
            "random_lane_changes_per_s": (0.01, "ours: five times that of calm, to both sides"),
        },
    ),
}
SINGLE_PRESETS = tuple(TRAFFIC_PRESETS)
"""The kinds of traffic except ``all``, for which each episode draws one of these."""
TRAFFIC_PRESETS["all"] = TrafficPreset(
    "each episode draws one of the other kinds", {"presets": (SINGLE_PRESETS, "ours")}
)


def traffic_preset(name: object, traffic: TrafficConfig) -> TrafficConfig:
    """Return the settings of the kind of traffic ``name``.

    ``vehicles_min`` and ``vehicles_max`` are those of ``traffic``.

    Raises:
        ConfigError: there is no such kind; the message suggests the nearest name.
    """
    if not isinstance(name, str) or name not in TRAFFIC_PRESETS:
        raise ConfigError(
            f"There is no kind of traffic {name!r}{did_you_mean(name, TRAFFIC_PRESETS)}; "
            f"the kinds are: {', '.join(TRAFFIC_PRESETS)}."
        )
    found = TRAFFIC_PRESETS[name].settings
    return TrafficConfig(
        vehicles_min=traffic.vehicles_min,
        vehicles_max=traffic.vehicles_max,
        **{key: value for key, (value, _) in found.items()},
    )
