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
    entropy: float = setting(0.002, "ours", "weight of the entropy", low=0, high=10)
    abort_cost: float = setting(0.1, "ours", "cost of an aborted lane change", low=0, high=100)
    reversal_cost: float = setting(
        0.02, "ours", "cost of braking after accelerating, or the reverse", low=0, high=100
    )
    hard_brake_cost: float = setting(
        0.1, "ours", "cost of a decision to brake hard", low=0, high=100
    )
    short_headway_cost: float = setting(
        0.1, "ours", "cost of a decision that ends with a headway below 1 s", low=0, high=100
    )
    forced_brake_cost: float = setting(
        0.5,
        "ours",
        "cost of a decision in which the vehicle behind brakes beyond 2 m/s^2 during a lane change",
        low=0,
        high=100,
    )
    collision_cost: float = setting(5.0, "ours", "cost of a collision", low=0, high=1000)
