"""Every number of the paper and of our own choices, as frozen dataclasses that read and write TOML.

Each setting names its source: a table or equation of the paper ("Table I", "eq. 2", "Sec. IV-B"),
or "ours" where the paper is silent. Units stand in the names; bounds are inclusive.
"""

import math
import tomllib
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import tomli_w

from drl_av.errors import ConfigError
from drl_av.settings import Section, did_you_mean, setting

SAFETY_CHECKS = ("permit_all", "paper")
DESIRED_VALUES = ("traffic", "fixed")
REPLAYS = ("two-buffer", "uniform")


@dataclass(frozen=True)
class SimulationConfig(Section):
    """Where and how SUMO steps."""

    scenario: str = setting("circular_three_lane", "ours", "scenario folder, or a shipped name")
    step_length_s: float = setting(
        0.5, "ours", "length of a SUMO step; divides one second", low=0.01, high=1.0
    )
    decision_interval_s: float = setting(
        1.0, "Table I", "sampling time: one decision a second", low=1.0, high=1.0
    )
    decisions_per_episode: int = setting(200, "Sec. IV-C", "N_s", low=1, high=100_000)
    lateral_resolution_m: float = setting(
        3.8, "ours", "strip width of SUMO's sublane model; one strip a lane", low=0.1, high=10.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        steps = self.decision_interval_s / self.step_length_s
        if not math.isclose(steps, round(steps), abs_tol=1e-9):
            raise ConfigError(
                f"simulation.step_length_s is {self.step_length_s}, but must divide the "
                f"{self.decision_interval_s:g} s between decisions: try 1, 0.5, 0.25, 0.2 or 0.1."
            )

    @property
    def steps_per_decision(self) -> int:
        """Number of SUMO steps in one decision."""
        return round(self.decision_interval_s / self.step_length_s)


@dataclass(frozen=True)
class TrafficConfig(Section):
    """The vehicles around the ego; each draws its own character from these ranges."""

    vehicles_min: int = setting(1, "Sec. IV-B", "fewest vehicles in an episode", low=0, high=1000)
    vehicles_max: int = setting(30, "Sec. IV-B", "N_T, most vehicles", low=0, high=1000)
    desired_speed_min_m_s: float = setting(20.0, "ours", "slowest desired speed", low=0, high=60)
    desired_speed_max_m_s: float = setting(32.0, "ours", "fastest desired speed", low=0.1, high=60)
    headway_min_s: float = setting(0.8, "ours", "shortest IDM headway", low=0.5, high=10)
    headway_max_s: float = setting(1.4, "ours", "longest IDM headway", low=0.5, high=10)
    acceleration_min_m_s2: float = setting(1.0, "ours", "weakest IDM accel", low=0.1, high=10)
    acceleration_max_m_s2: float = setting(2.0, "ours", "strongest IDM accel", low=0.1, high=10)
    speed_gain_min: float = setting(0.0, "ours", "least lane-change eagerness", low=0, high=100)
    speed_gain_max: float = setting(2.0, "ours", "most lane-change eagerness", low=0, high=100)
    random_lane_changes_per_s: float = setting(
        0.005, "ours", "rate at which a vehicle asks for a random lane change", low=0, high=1
    )
    lane_evenness: float = setting(
        2.0, "ours", "how evenly the lanes are used; large is even", low=0.01, high=1000
    )
    start_gap_m: float = setting(
        8.0, "ours", "smallest net gap between vehicles at the start", low=2.5, high=100
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("vehicles_min", "vehicles_max")
        self.ordered("desired_speed_min_m_s", "desired_speed_max_m_s")
        self.ordered("headway_min_s", "headway_max_s")
        self.ordered("acceleration_min_m_s2", "acceleration_max_m_s2")
        self.ordered("speed_gain_min", "speed_gain_max")


@dataclass(frozen=True)
class EgoConfig(Section):
    """What the ego can do."""

    max_speed_m_s: float = setting(30.0, "ours", "highest speed of the ego", low=1, high=60)
    accelerate_m_s2: float = setting(2.0, "Sec. IV-A", "a_1", low=0.1, high=10)
    brake_m_s2: float = setting(2.0, "Sec. IV-A", "a_1, braking", low=0.1, high=10)
    hard_brake_m_s2: float = setting(4.0, "Sec. IV-A", "a_2, braking", low=0.1, high=10)
    lane_change_duration_s: float = setting(5.0, "Table I", "T_LC", low=1, high=20)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("brake_m_s2", "hard_brake_m_s2")


@dataclass(frozen=True)
class SafetyConfig(Section):
    """The short-horizon safety check (eq. 2 and 3)."""

    check: str = setting("paper", "Sec. III", "which safety check", choices=SAFETY_CHECKS)
    minimum_ttc_s: float = setting(3.0, "Table I", "T_min", low=0, high=60)
    hard_brake_ttc_s: float = setting(2.0, "Table I", "T_HB", low=0, high=60)
    brake_ttc_s: float = setting(3.0, "Table I", "T_B", low=0, high=60)
    accelerate_ttc_s: float = setting(8.0, "Table I", "T_A", low=0, high=60)
    minimum_gap_m: float = setting(15.0, "Table I", "d_TVmin", low=0, high=250)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.ordered("hard_brake_ttc_s", "brake_ttc_s", "accelerate_ttc_s")


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
class RewardConfig(Section):
    """The reward (eq. 6 to 8) and where its desired values come from."""

    desired: str = setting(
        "traffic",
        "Sec. IV-C",
        "desired values: follow the traffic, or stay fixed",
        choices=DESIRED_VALUES,
    )
    desired_speed_m_s: float = setting(30.0, "Sec. IV-C", "v_des on a free road", low=1, high=60)
    desired_lateral_m: float = setting(3.8, "Sec. IV-C", "y_des when fixed", low=0, high=50)
    collision_reward: float = setting(-3.0, "ours", "r_col", low=-1000, high=0)
    safe_headway_s: float = setting(1.3, "Sec. IV-C", "headway behind d_safe", low=0.1, high=10)
    catch_up_time_s: float = setting(
        3.0, "ours", "time in which a gap ahead may be closed", low=1, high=60
    )
    worthwhile_gain_m_s: float = setting(
        1.5, "ours", "speed another lane must offer above the own one", low=0, high=30
    )


@dataclass(frozen=True)
class ObservationConfig(Section):
    """Constants that scale the 27 indicators to about [-1, 1]."""

    range_m: float = setting(250.0, "Sec. IV-B", "how far the ego sees", low=10, high=2000)
    gap_scale_m: float = setting(100.0, "ours", "gap that is observed as 1", low=1, high=2000)
    speed_scale_m_s: float = setting(10.0, "ours", "relative velocity seen as 1", low=0.1, high=60)
    lateral_scale_m: float = setting(3.8, "ours", "lateral offset observed as 1", low=0.1, high=50)
    lateral_speed_scale_m_s: float = setting(
        0.76, "ours", "lateral velocity observed as 1", low=0.01, high=10
    )


@dataclass(frozen=True)
class LearningConfig(Section):
    """Algorithm 1."""

    seed: int = setting(0, "ours", "seed of everything random in a training", low=0, high=2**32)
    episodes: int = setting(10_000, "Sec. IV-C", "N_e", low=1, high=10_000_000)
    discount: float = setting(0.9, "Table I", "gamma", low=0, high=1)
    learning_rate: float = setting(1e-4, "Sec. IV-C", "Adam's step size", low=1e-8, high=1)
    learning_rate_end_fraction: float = setting(
        1.0, "ours", "share of it left in the last episode, approached linearly", low=0, high=1
    )
    hidden_units: int = setting(100, "Sec. IV-C", "units in each hidden layer", low=1, high=10_000)
    epsilon_start: float = setting(1.0, "Sec. IV-C", "exploration at first", low=0, high=1)
    epsilon_end: float = setting(0.2, "Sec. IV-C", "exploration at last", low=0, high=1)
    epsilon_fraction: float = setting(
        0.7, "Sec. IV-C", "share of the episodes over which it falls", low=0.001, high=1
    )
    replay: str = setting("two-buffer", "Alg. 1", "experience replay", choices=REPLAYS)
    batch_size: int = setting(64, "ours", "rows in a minibatch", low=2, high=100_000)
    collision_fraction: float = setting(
        0.25, "ours", "share of the minibatch from the collision buffer", low=0, high=1
    )
    safe_capacity: int = setting(100_000, "ours", "rows of Buf_S", low=1, high=100_000_000)
    collision_capacity: int = setting(50_000, "ours", "rows of Buf_C", low=1, high=100_000_000)
    target_update_episodes: int = setting(5, "ours", "N_C", low=1, high=10_000)
    gradient_steps: int = setting(1, "Alg. 1", "gradient steps a decision", low=0, high=100)
    mirrored: bool = setting(
        False, "ours", "half of each minibatch seen in a mirror, left and right swapped"
    )
    evaluate_every: int = setting(100, "Sec. IV-C", "episodes between evaluations", low=1)
    evaluation_episodes: int = setting(10, "ours", "episodes in an evaluation", low=1, high=10_000)
    checkpoint_every: int = setting(50, "ours", "episodes between checkpoints", low=1)


_SECTIONS: dict[str, type[Section]] = {
    "simulation": SimulationConfig,
    "traffic": TrafficConfig,
    "ego": EgoConfig,
    "safety": SafetyConfig,
    "mobil": MobilConfig,
    "reward": RewardConfig,
    "observation": ObservationConfig,
    "learning": LearningConfig,
}


@dataclass(frozen=True)
class Config:
    """All settings of a run, one section a room; immutable, compared by value."""

    simulation: SimulationConfig = SimulationConfig()
    traffic: TrafficConfig = TrafficConfig()
    ego: EgoConfig = EgoConfig()
    safety: SafetyConfig = SafetyConfig()
    mobil: MobilConfig = MobilConfig()
    reward: RewardConfig = RewardConfig()
    observation: ObservationConfig = ObservationConfig()
    learning: LearningConfig = LearningConfig()

    def updated(self, section: str, **settings: Any) -> "Config":
        """This config with some settings of one section replaced; raises ConfigError."""
        return replace(self, **{section: replace(getattr(self, section), **settings)})

    def to_toml(self) -> str:
        """All settings as TOML text; ``from_toml`` reads it back to an equal config."""
        return tomli_w.dumps(asdict(self))


def from_toml(text: str, base: Config | None = None, name: str = "config") -> Config:
    """Lay the settings of a TOML text over ``base`` (default: the paper's).

    Raises:
        ConfigError: the text is no TOML, or a section or key is unknown, mistyped or out of bounds.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{name} is not valid TOML: {error}.") from error
    config = base if base is not None else Config()
    for section, settings in document.items():
        if section not in _SECTIONS:
            raise ConfigError(
                f"{name} has no section [{section}]{did_you_mean(section, _SECTIONS)}; "
                f"the sections are: {', '.join(_SECTIONS)}."
            )
        if not isinstance(settings, dict):
            raise ConfigError(f"{name}: {section} must be a section, written [{section}].")
        known = [item.name for item in fields(_SECTIONS[section])]  # type: ignore[arg-type]
        for key in settings:
            if key not in known:
                raise ConfigError(
                    f"{name}: [{section}] has no key {key!r}{did_you_mean(key, known)}; "
                    f"its keys are: {', '.join(known)}."
                )
        config = config.updated(section, **settings)
    return config


def load_config(path: str | Path | None, base: Config | None = None) -> Config:
    """Read a TOML file over ``base``, or the base alone; raises ConfigError, naming the file."""
    if path is None:
        return base or Config()
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError, TypeError) as error:
        raise ConfigError(f"The config file {path} cannot be read: {error}.") from error
    try:
        return from_toml(text, base, str(path))
    except ConfigError as error:
        raise ConfigError(
            str(error) if str(path) in str(error) else f"In {path}: {error}"
        ) from error
