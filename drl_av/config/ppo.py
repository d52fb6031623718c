"""Settings of the training at scale, proximal policy optimization in the compiled twin."""

from dataclasses import dataclass

from drl_av.config.schema import Section, setting


@dataclass(frozen=True)
class PpoConfig(Section):
    """Proximal policy optimization (PPO) with masked actions; the reward is the ego's speed."""

    decisions: int = setting(
        10_000_000, "ours", "decisions of the training, in all worlds together", low=1, high=10**10
    )
    worlds: int = setting(
        256, "ours", "number of worlds that are driven at once", low=1, high=10**5
    )
    batch_size: int = setting(16_384, "ours", "decisions in an update", low=1, high=10**7)
    minibatch_size: int = setting(1_024, "ours", "decisions in a gradient step", low=1, high=10**7)
    epochs: int = setting(3, "ours", "passes over the decisions of an update", low=1, high=100)
    hidden_1: int = setting(192, "ours", "units of the first hidden layer", low=1, high=10_000)
    hidden_2: int = setting(128, "ours", "units of the second hidden layer", low=1, high=10_000)
    learning_rate: float = setting(
        5e-4, "ours", "first step size of Adam; it falls linearly to 0", low=0, high=1
    )
    discount: float = setting(0.99, "ours", "discount of a reward a second later", low=0, high=1)
    gae_lambda: float = setting(0.95, "PPO", "trace decay of the advantages", low=0, high=1)
    clip: float = setting(0.2, "PPO", "largest change of a probability ratio", low=0, high=10)
    entropy: float = setting(0.002, "ours", "weight of the entropy", low=0, high=10)
    value_weight: float = setting(0.5, "PPO", "weight of the critic's loss", low=0, high=100)
    max_gradient_norm: float = setting(0.5, "CleanRL", "largest gradient norm", low=0, high=1000)
    paper_share: float = setting(
        0.3, "ours", "chance that an episode has the check paper instead of strict", low=0, high=1
    )
    overtaking_share: float = setting(
        0.3,
        "ours",
        "chance that an episode has traffic overtaking instead of [traffic]",
        low=0,
        high=1,
    )
    middle_speed_m_s: float = setting(20.0, "ours", "speed that earns nothing", low=0, high=60)
    speed_scale_m_s: float = setting(10.0, "ours", "more speed that earns 1", low=0.1, high=60)
    abort_cost: float = setting(0.1, "ours", "cost of an aborted lane change", low=0, high=100)
    hard_brake_cost: float = setting(
        0.1, "ours", "cost of a decision to brake hard", low=0, high=100
    )
    collision_cost: float = setting(5.0, "ours", "cost of a collision", low=0, high=1000)
