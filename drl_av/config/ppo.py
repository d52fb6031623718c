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
    checks: safety checks under which equal parts of the worlds drive; none: safety.check (ours)
    epochs: passes over the decisions of an update (ours)
    hidden_1: units of the first hidden layer (ours)
    hidden_2: units of the second hidden layer (ours)
    learning_rate: first step size of Adam; it falls linearly to 0 (ours)
    discount: discount of a reward a second later (ours)
    gae_lambda: trace decay of the advantages (PPO)
    entropy: weight of the entropy (ours)
    abort_cost: cost of an aborted lane change, where 10 m/s more for a second earn 1 (ours)
    reversal_cost: cost of braking after accelerating, or the reverse (ours)
    hard_brake_cost: cost of a decision to brake hard (ours)
    short_headway_cost: cost of a decision that ends with a headway below 1 s (ours)
    forced_brake_cost: cost of a decision in which a lane change makes the rear vehicle brake (ours)
    collision_cost: cost of a collision (ours)
    """

    decisions: int = setting(20_000_000, low=1, high=10**10)
    worlds: int = setting(256, low=1, high=10**5)
    checks: tuple[str, ...] = ()
    batch_size: int = setting(16_384, low=1, high=10**7)
    minibatch_size: int = setting(1_024, low=1, high=10**7)
    epochs: int = setting(3, low=1, high=100)
    hidden_1: int = setting(192, low=1, high=10_000)
    hidden_2: int = setting(128, low=1, high=10_000)
    learning_rate: float = setting(5e-4, low=0, high=1)
    discount: float = setting(0.99, low=0, high=1)
    gae_lambda: float = setting(0.95, low=0, high=1)
    entropy: float = setting(0.002, low=0, high=10)
    abort_cost: float = setting(0.3, low=0, high=100)
    reversal_cost: float = setting(0.05, low=0, high=100)
    hard_brake_cost: float = setting(0.1, low=0, high=100)
    short_headway_cost: float = setting(0.1, low=0, high=100)
    forced_brake_cost: float = setting(0.5, low=0, high=100)
    collision_cost: float = setting(5.0, low=0, high=1000)
