"""Settings of the training at scale, proximal policy optimization in the compiled twin."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting


@dataclass(frozen=True)
class PpoConfig(Section):
    """Proximal policy optimization (PPO) with masked actions; the reward is the ego's speed.

    decisions: decisions of the training, in all worlds together (ours)
    worlds: number of worlds that are driven at once (ours)
    batch_size: decisions in an update (ours)
    minibatch_size: decisions in a gradient step (ours)
    epochs: passes over the decisions of an update (ours)
    hidden_1: units of the first hidden layer (ours)
    hidden_2: units of the second hidden layer (ours)
    learning_rate: first step size of Adam; it falls linearly to 0 (ours)
    discount: discount of a reward a second later (ours)
    gae_lambda: trace decay of the advantages (PPO)
    clip: largest change of a probability ratio (PPO)
    entropy: weight of the entropy (ours)
    value_weight: weight of the critic's loss (PPO)
    max_gradient_norm: largest gradient norm (CleanRL)
    paper_share: chance that an episode has the check paper instead of strict (ours)
    overtaking_share: chance that an episode has traffic overtaking instead of [traffic] (ours)
    middle_speed_m_s: speed that earns nothing (ours)
    speed_scale_m_s: more speed that earns 1 (ours)
    abort_cost: cost of an aborted lane change (ours)
    hard_brake_cost: cost of a decision to brake hard (ours)
    collision_cost: cost of a collision (ours)
    """

    decisions: int = setting(10_000_000, low=1, high=10**10)
    worlds: int = setting(256, low=1, high=10**5)
    batch_size: int = setting(16_384, low=1, high=10**7)
    minibatch_size: int = setting(1_024, low=1, high=10**7)
    epochs: int = setting(3, low=1, high=100)
    hidden_1: int = setting(192, low=1, high=10_000)
    hidden_2: int = setting(128, low=1, high=10_000)
    learning_rate: float = setting(5e-4, low=0, high=1)
    discount: float = setting(0.99, low=0, high=1)
    gae_lambda: float = setting(0.95, low=0, high=1)
    clip: float = setting(0.2, low=0, high=10)
    entropy: float = setting(0.002, low=0, high=10)
    value_weight: float = setting(0.5, low=0, high=100)
    max_gradient_norm: float = setting(0.5, low=0, high=1000)
    paper_share: float = setting(0.3, low=0, high=1)
    overtaking_share: float = setting(0.3, low=0, high=1)
    middle_speed_m_s: float = setting(20.0, low=0, high=60)
    speed_scale_m_s: float = setting(10.0, low=0.1, high=60)
    abort_cost: float = setting(0.1, low=0, high=100)
    hard_brake_cost: float = setting(0.1, low=0, high=100)
    collision_cost: float = setting(5.0, low=0, high=1000)
