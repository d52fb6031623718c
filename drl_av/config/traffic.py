"""Settings of the background traffic, the vehicles around the ego, and its kinds by name."""

from dataclasses import dataclass, replace
from typing import Any

from drl_av.config.section import Section, setting, there_is_no
from drl_av.errors import ConfigError

STANDSTILL_GAP_M = 2.5
"""Gap to the vehicle ahead at standstill: SUMO's minGap, and the default of each driver model."""

BESIDE_PRESETS = "vehicles_min", "vehicles_max", "keep_stopping_distance"
"""The settings that may be set beside ``presets``."""

PAPER_SHARES: dict[str, Any] = {
    "finite_state_share": 0.25,
    "level_0_share": 0.25,
    "level_1_share": 0.25,
}
"""The shares of the drivers that Sec. IV-B names: by default a quarter each, which is ours."""
NUMBERS = "vehicles_min", "vehicles_max"
"""The settings that an evaluation does not use, which names its numbers of vehicles."""
NO_PAPER_DRIVERS: dict[str, Any] = dict.fromkeys(PAPER_SHARES, 0.0)
SUMO_ALONE = (
    "traffic: finite_state_share, the shares of the levels and hard_braking_share must be 0 on an "
    "open road, on which SUMO drives all other vehicles: set them to 0, or traffic.kind to calm, "
    "the default there, overtaking or naturalistic, or take a loop."
)
"""The refusal of drivers other than SUMO's on an open road."""


@dataclass(frozen=True)
class TrafficConfig(Section):
    """The background traffic: the number of vehicles, and the ranges of their random parameters.

    vehicles_min: fewest vehicles besides the ego on a loop (Sec. IV-B)
    vehicles_max: N_T, most vehicles besides the ego on a loop (Sec. IV-B)
    presets: kinds of traffic of which each episode draws one; only the numbers of vehicles and
        keep_stopping_distance may then be set (ours)
    desired_speed_min_m_s: lowest desired speed (ours)
    desired_speed_max_m_s: highest desired speed (ours)
    headway_min_s: shortest headway of SUMO's IDM (ours)
    headway_max_s: longest headway of SUMO's IDM (ours)
    acceleration_min_m_s2: smallest acceleration of SUMO's IDM (ours)
    acceleration_max_m_s2: largest acceleration of SUMO's IDM (ours)
    speed_gain_min: smallest lcSpeedGain of SUMO, the eagerness to change lanes for speed (ours)
    speed_gain_max: largest lcSpeedGain of SUMO; 0: all lane changes are random (ours)
    random_lane_changes_per_s: rate at which a vehicle requests a random lane change (ours)
    lane_evenness: parameter of the Dirichlet distribution that draws the share of each lane; a
        large value makes the shares nearly equal (ours)
    start_gap_m: smallest gap, bumper to bumper, between vehicles of a lane at the start (ours)
    finite_state_share: chance that a finite-state machine drives a vehicle (Sec. IV-B; a quarter is
        ours)
    level_0_share: chance that a vehicle is a level-0 driver (Sec. IV-B; a quarter is ours)
    level_1_share: chance that a vehicle is a level-1 driver (Sec. IV-B; a quarter is ours)
    level_2_share: chance that a vehicle is a level-2 driver (Sec. IV-B)
    keep_stopping_distance: whether vehicles that SUMO drives stay slow enough to stop behind the
        one ahead, which IDM alone does not ensure; beside finite-state and level-k drivers they do
        so in any case (ours)
    overtake_right: whether SUMO's drivers may pass a vehicle on the right above 60 km/h (SUMO)
    standing_share: chance that a vehicle almost stands: its desired speed is 0.1 m/s (ours)
    crawling_share: chance that a vehicle crawls, with a low desired speed (ours)
    crawling_speed_max_m_s: highest desired speed of a crawling vehicle (ours)
    fast_share: chance that a vehicle is fast and overtakes often (ours)
    fast_speed_m_s: desired speed of a fast vehicle (ours)
    fast_speed_gain: lcSpeedGain of a fast vehicle (ours)
    hard_braking_share: chance that a finite-state machine drives a vehicle and brakes hard at
        random times (ours)
    hard_brakes_per_s: rate at which a hard-braking vehicle begins to brake hard (ours)
    hard_brake_s: duration of one hard braking, whole seconds (ours)
    truck_share: chance that a vehicle is a truck (ours)
    truck_length_m: length of a truck (ours)
    truck_width_m: width of a truck (ours)
    truck_speed_min_m_s: lowest desired speed of a truck (ours)
    truck_speed_max_m_s: highest desired speed of a truck (ours)
    truck_acceleration_m_s2: acceleration of a truck (ours)
    """

    vehicles_min: int = setting(1, low=0, high=1000)
    vehicles_max: int = setting(30, low=0, high=1000)
    presets: tuple[str, ...] = ()
    desired_speed_min_m_s: float = setting(20.0, low=0, high=60)
    desired_speed_max_m_s: float = setting(32.0, low=0.1, high=60)
    headway_min_s: float = setting(0.8, low=0.5, high=10)
    headway_max_s: float = setting(1.4, low=0.5, high=10)
    acceleration_min_m_s2: float = setting(1.0, low=0.1, high=10)
    acceleration_max_m_s2: float = setting(2.0, low=0.1, high=10)
    speed_gain_min: float = setting(0.0, low=0, high=100)
    speed_gain_max: float = setting(0.0, low=0, high=100)
    random_lane_changes_per_s: float = setting(0.002, low=0, high=1)
    lane_evenness: float = setting(2.0, low=0.01, high=1000)
    start_gap_m: float = setting(8.0, low=STANDSTILL_GAP_M, high=100)
    finite_state_share: float = setting(PAPER_SHARES["finite_state_share"], low=0, high=1)
    level_0_share: float = setting(PAPER_SHARES["level_0_share"], low=0, high=1)
    level_1_share: float = setting(PAPER_SHARES["level_1_share"], low=0, high=1)
    level_2_share: float = setting(0.0, low=0, high=1)
    keep_stopping_distance: bool = True
    overtake_right: bool = False
    standing_share: float = setting(0.0, low=0, high=1)
    crawling_share: float = setting(0.0, low=0, high=1)
    crawling_speed_max_m_s: float = setting(8.0, low=0.1, high=60)
    fast_share: float = setting(0.0, low=0, high=1)
    fast_speed_m_s: float = setting(38.0, low=0.1, high=60)
    fast_speed_gain: float = setting(5.0, low=0, high=100)
    hard_braking_share: float = setting(0.0, low=0, high=1)
    hard_brakes_per_s: float = setting(0.02, low=0, high=1)
    hard_brake_s: int = setting(3, low=1, high=60)

    truck_share: float = setting(0.0, low=0, high=1)
    truck_length_m: float = setting(12.0, low=1, high=25)
    truck_width_m: float = setting(2.5, low=0.5, high=5)
    truck_speed_min_m_s: float = setting(22.0, low=0, high=60)
    truck_speed_max_m_s: float = setting(27.0, low=0.1, high=60)
    truck_acceleration_m_s2: float = setting(0.7, low=0.1, high=10)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("vehicles_min", "vehicles_max")
        self.ordered("truck_speed_min_m_s", "truck_speed_max_m_s")
        self.ordered("desired_speed_min_m_s", "desired_speed_max_m_s")
        self.ordered("headway_min_s", "headway_max_s")
        self.ordered("acceleration_min_m_s2", "acceleration_max_m_s2")
        self.ordered("speed_gain_min", "speed_gain_max")
        if self.presets:
            self._leave_the_rest_to_presets()
        if sum(self.shares) > 1 + 1e-9:
            raise ConfigError(
                "traffic: finite_state_share + level_0_share + level_1_share + hard_braking_share "
                f"+ level_2_share is {sum(self.shares):g}, but must be at most 1, as the rest is "
                'SUMO\'s IDM: lower one, or begin with kind = "calm", in which all of them are 0.'
            )
        if sum(self.unusual_shares) > 1 + 1e-9:
            raise ConfigError(
                "traffic: standing_share + crawling_share + fast_share is "
                f"{sum(self.unusual_shares):g}, but must be at most 1."
            )

    def _leave_the_rest_to_presets(self) -> None:
        """Set the paper's shares to 0; raise ConfigError if a setting beside ``presets`` is set."""
        beside = TrafficConfig(**{name: getattr(self, name) for name in BESIDE_PRESETS})
        if replace(self, presets=()) not in (beside, replace(beside, **NO_PAPER_DRIVERS)):
            raise ConfigError(
                "traffic: presets draws the other settings of the section in each episode, so "
                f"only {', '.join(BESIDE_PRESETS)} can be set beside it: remove the others."
            )
        for name, share in NO_PAPER_DRIVERS.items():
            object.__setattr__(self, name, share)

    def longest_m(self, length_m: float) -> float:
        """Return the length of the longest vehicle, metres; a car has ``length_m``."""
        return max(length_m, self.truck_length_m) if self.truck_share else length_m

    @property
    def shares(self) -> tuple[float, ...]:
        """The shares (0 to 1) of the vehicles that our driver models drive; SUMO drives the rest.

        In this order: finite-state, level-0, level-1, hard-braking and level-2 vehicles.
        """
        levels = self.level_0_share, self.level_1_share
        return self.finite_state_share, *levels, self.hard_braking_share, self.level_2_share

    @property
    def unusual_shares(self) -> tuple[float, float, float]:
        """The shares (0 to 1) of standing, crawling and fast vehicles in the background traffic."""
        return self.standing_share, self.crawling_share, self.fast_share


TRAFFIC_PRESETS: dict[str, dict[str, Any]] = {
    "calm": NO_PAPER_DRIVERS,  # lane changes are random only; no driver overtakes
    "paper": {},  # IDM, finite-state, level-0 and level-1 drivers, a quarter of each
    # SUMO's drivers change lanes to get ahead, with SUMO's default lcSpeedGain
    "overtaking": NO_PAPER_DRIVERS | {"speed_gain_min": 1.0, "speed_gain_max": 1.0},
    # speeds, gaps and lane changes similar to those measured on US highways, and trucks; "fitted"
    # to speed, time gap and range of the SPMD and IVBSS studies, with
    # verification/traffic_moments.py, without regard to the ego's results
    "naturalistic": NO_PAPER_DRIVERS
    | {
        "desired_speed_min_m_s": 34.0,  # fitted; 35.5 on I-24, CorridorCalibration 3b
        "desired_speed_max_m_s": 40.0,  # the road's speed limit
        "headway_min_s": 0.5,  # SUMO's step; IDM keeps more near its desired speed
        "headway_max_s": 0.87,  # fitted
        # Kusari, arXiv:2109.11620: 1.19 +- 0.26, two standard deviations to each side
        "acceleration_min_m_s2": 0.67,
        "acceleration_max_m_s2": 1.71,
        "speed_gain_min": 0.6,  # fitted to highD's 0.12 lane changes a vehicle-km
        "speed_gain_max": 0.6,
        "random_lane_changes_per_s": 0.0,  # every lane change is for speed
        "overtake_right": True,  # usual on US highways, where the other values were measured
        "truck_share": 0.1,  # 10 to 20 % of the vehicles on highways
        # ours: about 60 mph, a limit for trucks in the United States
        "truck_speed_min_m_s": 25.0,
        "truck_speed_max_m_s": 28.0,
        "truck_acceleration_m_s2": 0.67,  # ours: as the weakest car
    },
    # standing, crawling, hard-braking and fast vehicles (ours); by the defaults of the rest,
    # crawling is below 30 km/h, fast is 8 m/s above the ego's highest speed, and a hard braking,
    # once in 50 s, is at strict's bound, from 30 m/s down to 18
    "hazards": NO_PAPER_DRIVERS
    | {
        "speed_gain_min": 1.0,
        "speed_gain_max": 1.0,
        "standing_share": 0.01,  # 0.4 of 40 vehicles
        "crawling_share": 0.02,
        "fast_share": 0.1,
        "hard_braking_share": 0.15,
        "random_lane_changes_per_s": 0.01,  # five times that of calm, to both sides
    },
}
"""The kinds of traffic by name: the settings of [traffic] that each changes, and their sources."""
SINGLE_PRESETS = tuple(TRAFFIC_PRESETS)
"""The kinds of traffic except ``all``, for which each episode draws one of these."""
TRAFFIC_PRESETS["all"] = {"presets": SINGLE_PRESETS}


def traffic_preset(name: object, traffic: TrafficConfig) -> TrafficConfig:
    """Return the settings of the kind of traffic ``name``.

    ``vehicles_min`` and ``vehicles_max`` are those of ``traffic``, and so is
    ``keep_stopping_distance`` if ``traffic`` has presets.

    Raises:
        ConfigError: there is no such kind; the message suggests the nearest name.
    """
    if not isinstance(name, str) or name not in TRAFFIC_PRESETS:
        raise ConfigError(there_is_no("kind of traffic", name, "kinds", TRAFFIC_PRESETS))
    stays = BESIDE_PRESETS if traffic.presets else BESIDE_PRESETS[:2]
    return TrafficConfig(**{key: getattr(traffic, key) for key in stays} | TRAFFIC_PRESETS[name])
