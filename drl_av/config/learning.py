"""Settings of the trainings: Algorithm 1 of the paper, and PPO at scale in the twin."""

from dataclasses import dataclass

from drl_av.config.section import Section, setting

ALGORITHMS = ("double-dqn", "ppo")
REPLAYS = ("two-buffer", "prioritized", "uniform")


@dataclass(frozen=True)
class LearningConfig(Section):
    """The training by Algorithm 1 of the paper: double deep Q-learning with two replay buffers.

    algorithm: double-dqn in the environment, or ppo at scale with the settings of [ppo] (Alg. 1)
    seed: seed of all random numbers of a training (ours)
    episodes: N_e, episodes of a training (Sec. IV-C)
    discount: gamma, discount (Table I)
    learning_rate: step size of Adam; 0 learns nothing (Sec. IV-C)
    learning_rate_end_fraction: learning rate at the end of the last episode as a share of the
        first; it falls linearly, episode by episode (ours)
    hidden_units: units in each hidden layer (Sec. IV-C)
    epsilon_start: probability of a random action in the first episode (Sec. IV-C)
    epsilon_end: probability of a random action after its decrease (Sec. IV-C)
    epsilon_fraction: share of the episodes over which the probability of a random action decreases
        (Sec. IV-C)
    replay: kind of experience replay (Alg. 1)
    batch_size: transitions in a minibatch (ours)
    collision_fraction: share of a minibatch from the collision buffer (ours)
    safe_capacity: capacity of Buf_S, the safe buffer, in transitions (ours)
    collision_capacity: capacity of Buf_C, the collision buffer, in transitions (ours)
    priority_exponent: alpha, the priority exponent of prioritized replay (Schaul 2015, Table 3)
    importance_exponent_start: beta, the importance-sampling exponent of prioritized replay, in the
        first episode; it rises linearly to 1 (Schaul 2015, Table 3)
    priority_floor: constant that prioritized replay adds to the absolute TD error of a transition
        (ours)
    target_update_episodes: N_C, episodes between two updates of the target network (ours)
    gradient_steps: gradient steps per decision (Alg. 1)
    collisions_to_start: number of transitions that Buf_C must hold before learning starts (ours)
    mirrored: whether left and right are exchanged in half of each minibatch, and the driver uses
        the mean Q-value of the scene and its mirror image; a reward of yours must then be the same
        for both (ours)
    evaluate_every: episodes between evaluations (Sec. IV-C)
    evaluation_episodes: episodes of an evaluation (ours)
    checkpoint_every: episodes between checkpoints (ours)
    """

    algorithm: str = setting("double-dqn", choices=ALGORITHMS)
    seed: int = setting(0, low=0, high=2**32 - 1)
    episodes: int = setting(10_000, low=1, high=10_000_000)
    discount: float = setting(0.9, low=0, high=1)
    learning_rate: float = setting(1e-4, low=0, high=1)
    learning_rate_end_fraction: float = setting(1.0, low=0, high=1)
    hidden_units: int = setting(100, low=1, high=10_000)
    epsilon_start: float = setting(1.0, low=0, high=1)
    epsilon_end: float = setting(0.2, low=0, high=1)
    epsilon_fraction: float = setting(0.7, low=0.001, high=1)
    replay: str = setting("two-buffer", choices=REPLAYS)
    batch_size: int = setting(64, low=2, high=100_000)
    collision_fraction: float = setting(0.25, low=0, high=1)
    safe_capacity: int = setting(100_000, low=1, high=100_000_000)
    collision_capacity: int = setting(50_000, low=1, high=100_000_000)
    priority_exponent: float = setting(0.6, low=0, high=1)
    importance_exponent_start: float = setting(0.4, low=0, high=1)
    priority_floor: float = setting(1e-6, low=1e-12, high=1)
    target_update_episodes: int = setting(5, low=1, high=10_000)
    gradient_steps: int = setting(1, low=0, high=100)
    collisions_to_start: int = setting(0, low=0)
    mirrored: bool = False
    evaluate_every: int = setting(100, low=1)
    evaluation_episodes: int = setting(10, low=1, high=10_000)
    checkpoint_every: int = setting(50, low=1)


SPAN_M_S = 10.0
"""How much more speed for a second earns 1 in PPO at scale, before the costs."""


@dataclass(frozen=True)
class PpoConfig(Section):
    """Proximal policy optimization (PPO) with masked actions; the reward is speed less costs.

    decisions: decisions in all worlds together, rounded down to whole updates (ours)
    worlds: number of worlds that are driven at once (ours)
    batch_size: decisions in an update (ours)
    minibatch_size: decisions in a gradient step, a divisor of batch_size (ours)
    epochs: passes over the decisions of an update (ours)
    lane_units: units of a layer before the hidden ones that sees each lane alone, with the same
        weights; 0 for none (ours)
    hidden_1: units of the first hidden layer (ours)
    hidden_2: units of the second hidden layer (ours)
    learning_rate: first step size of Adam; it falls linearly to 0 (ours)
    discount: discount of a reward a second later (ours)
    gae_lambda: trace decay of the advantages (PPO)
    asymmetric_critic: whether the critic also sees what no driver sees: the whole road, how fast
        the others want to drive, and which kind of traffic it is (ours)
    entropy: weight of the entropy (ours)
    abort_cost: cost of an aborted lane change, where 10 m/s more for a second earn 1 (ours)
    reversal_cost: cost of braking after accelerating, or the reverse (ours)
    hard_brake_cost: cost of a decision to brake hard (ours)
    short_headway_cost: cost of a decision that ends with a headway below 1 s (ours)
    forced_brake_cost: cost of a decision in which a lane change makes the rear vehicle brake (ours)
    collision_cost: cost of a collision, or of a missed exit (ours)
    """

    decisions: int = setting(20_000_000, low=1, high=10**10)
    worlds: int = setting(256, low=1, high=10**5)
    batch_size: int = setting(16_384, low=1, high=10**7)
    minibatch_size: int = setting(1_024, low=2, high=10**7)
    epochs: int = setting(3, low=1, high=100)
    lane_units: int = setting(0, low=0, high=10_000)
    hidden_1: int = setting(192, low=1, high=10_000)
    hidden_2: int = setting(128, low=1, high=10_000)
    learning_rate: float = setting(5e-4, low=0, high=1)
    discount: float = setting(0.99, low=0, high=0.9999)
    gae_lambda: float = setting(0.95, low=0, high=1)
    asymmetric_critic: bool = False
    entropy: float = setting(0.002, low=0, high=10)
    abort_cost: float = setting(0.3, low=0, high=100)
    reversal_cost: float = setting(0.05, low=0, high=100)
    hard_brake_cost: float = setting(0.1, low=0, high=100)
    short_headway_cost: float = setting(0.1, low=0, high=100)
    forced_brake_cost: float = setting(0.5, low=0, high=100)
    collision_cost: float = setting(5.0, low=0, high=1000)
