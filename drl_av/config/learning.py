"""Settings of the training."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting
from drl_av.errors import ConfigError

ALGORITHMS = ("double-dqn", "ppo")
REPLAYS = ("two-buffer", "prioritized", "uniform")


@dataclass(frozen=True)
class LearningConfig(Section):
    """The training by Algorithm 1 of the paper: double deep Q-learning with two replay buffers."""

    algorithm: str = setting(
        "double-dqn",
        "Alg. 1",
        "double-dqn in the environment, or ppo at scale with the settings of [ppo]",
        choices=ALGORITHMS,
    )
    seed: int = setting(0, "ours", "seed of all random numbers of a training", low=0, high=2**32)
    episodes: int = setting(
        10_000, "Sec. IV-C", "N_e, episodes of a training", low=1, high=10_000_000
    )
    discount: float = setting(0.9, "Table I", "gamma, discount", low=0, high=1)
    learning_rate: float = setting(
        1e-4, "Sec. IV-C", "step size of Adam; 0 learns nothing", low=0, high=1
    )
    learning_rate_end_fraction: float = setting(
        1.0,
        "ours",
        "learning rate in the last episode as a share of the first; it falls linearly",
        low=0,
        high=1,
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
        "number of Q-networks; each learns from its own minibatches; the driver uses their mean",
        low=1,
        high=100,
    )
    round_robin: bool = setting(
        False, "ours", "whether each gradient step trains only one of the networks, in turn"
    )
    replay: str = setting("two-buffer", "Alg. 1", "kind of experience replay", choices=REPLAYS)
    batch_size: int = setting(64, "ours", "transitions in a minibatch", low=2, high=100_000)
    collision_fraction: float = setting(
        0.25, "ours", "share of a minibatch from the collision buffer", low=0, high=1
    )
    safe_capacity: int = setting(
        100_000,
        "ours",
        "capacity of Buf_S, the safe buffer, in transitions",
        low=1,
        high=100_000_000,
    )
    collision_capacity: int = setting(
        50_000,
        "ours",
        "capacity of Buf_C, the collision buffer, in transitions",
        low=1,
        high=100_000_000,
    )
    priority_exponent: float = setting(
        0.6,
        "Schaul 2015, Table 3",
        "alpha, the priority exponent of prioritized replay",
        low=0,
        high=1,
    )
    importance_exponent_start: float = setting(
        0.4,
        "Schaul 2015, Table 3",
        "beta, the importance-sampling exponent of prioritized replay, in the first episode; it "
        "rises linearly to 1",
        low=0,
        high=1,
    )
    priority_floor: float = setting(
        1e-6,
        "ours",
        "constant that prioritized replay adds to the absolute TD error of a transition",
        low=1e-12,
        high=1,
    )
    target_update_episodes: int = setting(
        5, "ours", "N_C, episodes between two updates of the target network", low=1, high=10_000
    )
    gradient_steps: int = setting(1, "Alg. 1", "gradient steps per decision", low=0, high=100)
    collisions_to_start: int = setting(
        0, "ours", "number of transitions that Buf_C must hold before learning starts", low=0
    )
    traffic_by_episode: bool = setting(
        False,
        "ours",
        "whether the traffic of an episode depends on the seed and the episode number only",
    )
    mirrored: bool = setting(
        False,
        "ours",
        "whether left and right are exchanged in half of each minibatch, and the driver uses the "
        "mean Q-value of the scene and its mirror image",
    )
    counterfactuals: int = setting(
        0,
        "ours",
        "number of actions not taken, per decision, whose computed outcomes are stored",
        low=0,
        high=12,
    )
    speed_weight: float = setting(
        0.0,
        "ours",
        "weight of the bonus v_x / ego.max_speed_m_s that the training adds to the reward",
        low=0,
        high=10,
    )
    unsafe_penalty: float = setting(
        0.0,
        "ours",
        "penalty of a proposal that the safety check replaces: it is stored with the next state of "
        "the executed action, and with its reward minus this penalty; 0 stores the proposal as a "
        "collision, with the reward r_col and no next state (Alg. 1)",
        low=0,
        high=1000,
    )
    lane_change_margin: float = setting(
        0.0,
        "ours",
        "Q-value by which a lane change must exceed keeping the lane to start; not in Alg. 1",
        low=0,
        high=1000,
    )
    permitted_only: bool = setting(
        False,
        "ours",
        "whether the trained driver proposes only actions that the safety check permits, and "
        "begins no lane change away from its way, and none that forces a vehicle behind to brake "
        "harder than mobil.comfortable_braking_m_s2, while 250 m are left for each that its way "
        "demands; the training explores all actions",
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
