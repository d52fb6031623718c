"""Settings of Algorithm 1."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting
from drl_av.errors import ConfigError

REPLAYS = ("two-buffer", "prioritized", "uniform")


@dataclass(frozen=True)
class LearningConfig(Section):
    """Algorithm 1."""

    seed: int = setting(0, "ours", "seed of everything random in a training", low=0, high=2**32)
    episodes: int = setting(
        10_000, "Sec. IV-C", "N_e, episodes of a training", low=1, high=10_000_000
    )
    discount: float = setting(0.9, "Table I", "gamma, discount", low=0, high=1)
    learning_rate: float = setting(
        1e-4, "Sec. IV-C", "step size of Adam; 0 learns nothing", low=0, high=1
    )
    learning_rate_end_fraction: float = setting(
        1.0, "ours", "share of the learning rate in the last episode; falls linearly", low=0, high=1
    )
    hidden_units: int = setting(100, "Sec. IV-C", "units in each hidden layer", low=1, high=10_000)
    epsilon_start: float = setting(
        1.0, "Sec. IV-C", "probability of a random action in the first episode", low=0, high=1
    )
    epsilon_end: float = setting(
        0.2, "Sec. IV-C", "probability of a random action after its decrease", low=0, high=1
    )
    epsilon_fraction: float = setting(
        0.7,
        "Sec. IV-C",
        "share of the episodes over which the probability of a random action decreases",
        low=0.001,
        high=1,
    )
    networks: int = setting(
        1,
        "ours",
        "number of networks; each learns from its own batches; their mean value decides",
        low=1,
        high=100,
    )
    round_robin: bool = setting(
        False, "ours", "whether the networks take turns: each gradient step trains one of them"
    )
    replay: str = setting("two-buffer", "Alg. 1", "kind of experience replay", choices=REPLAYS)
    batch_size: int = setting(64, "ours", "rows in a minibatch", low=2, high=100_000)
    collision_fraction: float = setting(
        0.25, "ours", "share of a minibatch from the collision buffer", low=0, high=1
    )
    safe_capacity: int = setting(
        100_000, "ours", "capacity of Buf_S, the safe buffer, rows", low=1, high=100_000_000
    )
    collision_capacity: int = setting(
        50_000, "ours", "capacity of Buf_C, the collision buffer, rows", low=1, high=100_000_000
    )
    priority_exponent: float = setting(
        0.6, "Schaul 2015, Table 3", "alpha of prioritized replay", low=0, high=1
    )
    importance_exponent_start: float = setting(
        0.4, "Schaul 2015, Table 3", "beta in the first episode; rises linearly to 1", low=0, high=1
    )
    priority_floor: float = setting(
        1e-6, "ours", "added to the absolute TD error of each row", low=1e-12, high=1
    )
    target_update_episodes: int = setting(
        5, "ours", "N_C, episodes between two updates of the target network", low=1, high=10_000
    )
    gradient_steps: int = setting(1, "Alg. 1", "gradient steps per decision", low=0, high=100)
    collisions_to_start: int = setting(
        0, "ours", "number of rows that Buf_C must hold before learning starts", low=0
    )
    traffic_by_episode: bool = setting(
        False, "ours", "whether the traffic depends on the seed and the episode number only"
    )
    mirrored: bool = setting(
        False, "ours", "whether the driver also uses the mirrored scene, left and right exchanged"
    )
    counterfactuals: int = setting(
        0, "ours", "other actions per decision whose computed outcome is stored", low=0, high=12
    )
    speed_weight: float = setting(
        0.0,
        "ours",
        "weight of v_x / ego.max_speed_m_s, learned in addition to the reward",
        low=0,
        high=10,
    )
    unsafe_penalty: float = setting(
        0.0,
        "ours",
        "value that an unsafe proposal loses against the action executed in its place; 0: the "
        "proposal is terminal with r_col (Alg. 1)",
        low=0,
        high=1000,
    )
    lane_change_margin: float = setting(
        0.0,
        "ours",
        "advantage over keeping the lane that a lane change needs to start; not in Alg. 1",
        low=0,
        high=1000,
    )
    evaluate_every: int = setting(100, "Sec. IV-C", "episodes between evaluations", low=1)
    evaluation_episodes: int = setting(10, "ours", "episodes of an evaluation", low=1, high=10_000)
    checkpoint_every: int = setting(50, "ours", "episodes between checkpoints", low=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unsafe_penalty and self.collisions_to_start and self.replay != "two-buffer":
            raise ConfigError(
                f"learning.collisions_to_start cannot be counted in {self.replay} replay where "
                "learning.unsafe_penalty makes unsafe proposals not terminal: set one to 0, or "
                'learning.replay to "two-buffer".'
            )
