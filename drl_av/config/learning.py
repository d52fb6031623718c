"""Settings of Algorithm 1."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting
from drl_av.errors import ConfigError

REPLAYS = ("two-buffer", "prioritized", "uniform")


@dataclass(frozen=True)
class LearningConfig(Section):
    """Algorithm 1."""

    seed: int = setting(0, "ours", "seed of everything random in a training", low=0, high=2**32)
    episodes: int = setting(10_000, "Sec. IV-C", "N_e", low=1, high=10_000_000)
    discount: float = setting(0.9, "Table I", "gamma", low=0, high=1)
    learning_rate: float = setting(1e-4, "Sec. IV-C", "Adam's; 0 learns nothing", low=0, high=1)
    learning_rate_end_fraction: float = setting(
        1.0, "ours", "share of it left in the last episode, approached linearly", low=0, high=1
    )
    hidden_units: int = setting(100, "Sec. IV-C", "units in each hidden layer", low=1, high=10_000)
    epsilon_start: float = setting(1.0, "Sec. IV-C", "exploration at first", low=0, high=1)
    epsilon_end: float = setting(0.2, "Sec. IV-C", "exploration at last", low=0, high=1)
    epsilon_fraction: float = setting(
        0.7, "Sec. IV-C", "share of the episodes over which it falls", low=0.001, high=1
    )
    networks: int = setting(
        1, "ours", "networks that learn apart, and decide by their mean", low=1, high=100
    )
    networks_take_turns: bool = setting(
        False, "ours", "a gradient step is that of one network, in turn, instead of one of each"
    )
    replay: str = setting("two-buffer", "Alg. 1", "experience replay", choices=REPLAYS)
    batch_size: int = setting(64, "ours", "rows in a minibatch", low=2, high=100_000)
    collision_fraction: float = setting(
        0.25, "ours", "share of the minibatch from the collision buffer", low=0, high=1
    )
    safe_capacity: int = setting(100_000, "ours", "rows of Buf_S", low=1, high=100_000_000)
    collision_capacity: int = setting(50_000, "ours", "rows of Buf_C", low=1, high=100_000_000)
    priority_exponent: float = setting(
        0.6, "Schaul 2015, Table 3", "alpha of prioritized replay", low=0, high=1
    )
    importance_exponent_start: float = setting(
        0.4, "Schaul 2015, Table 3", "beta at first; rises linearly to 1", low=0, high=1
    )
    priority_floor: float = setting(
        1e-6, "ours", "what is added to each |TD error|", low=1e-12, high=1
    )
    target_update_episodes: int = setting(5, "ours", "N_C", low=1, high=10_000)
    gradient_steps: int = setting(1, "Alg. 1", "gradient steps a decision", low=0, high=100)
    collisions_to_start: int = setting(
        0, "ours", "rows of Buf_C to have before an episode, to learn in it", low=0
    )
    traffic_by_episode: bool = setting(
        False, "ours", "traffic depends on the seed and the episode's number, not on the learning"
    )
    mirrored: bool = setting(
        False, "ours", "learns and decides in a mirror too, left and right swapped"
    )
    counterfactuals: int = setting(
        0, "ours", "other actions drawn a decision, whose outcome is remembered too", low=0, high=12
    )
    speed_weight: float = setting(
        0.0, "ours", "weight of v_x / ego.max_speed_m_s beside the reward", low=0, high=10
    )
    unsafe_penalty: float = setting(
        0.0,
        "ours",
        "how much less an unsafe proposal is worth than what is executed in its place; 0: it ends "
        "in r_col (Alg. 1)",
        low=0,
        high=1000,
    )
    lane_change_margin: float = setting(
        0.0,
        "ours",
        "what a lane change has to be worth above keeping the lane; in driving, not in Alg. 1",
        low=0,
        high=1000,
    )
    evaluate_every: int = setting(100, "Sec. IV-C", "episodes between evaluations", low=1)
    evaluation_episodes: int = setting(10, "ours", "episodes in an evaluation", low=1, high=10_000)
    checkpoint_every: int = setting(50, "ours", "episodes between checkpoints", low=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unsafe_penalty and self.collisions_to_start and self.replay != "two-buffer":
            raise ConfigError(
                f"learning.collisions_to_start cannot be counted in {self.replay} replay where "
                "learning.unsafe_penalty lets unsafe proposals go on: set one of them to 0, or "
                'learning.replay to "two-buffer".'
            )
