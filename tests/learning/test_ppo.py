"""Proximal policy optimization with masked actions."""

import numpy as np
import numpy.typing as npt
import pytest
import torch

from drl_av.config.ppo import PpoConfig
from drl_av.learning.ppo import ActorCritic, Outcome, Ppo, gae

BEST, REFUSED = 7, 3
SMALL = PpoConfig(
    decisions=16_000,
    worlds=16,
    batch_size=400,
    minibatch_size=100,
    hidden_1=8,
    hidden_2=8,
    learning_rate=0.01,
)


class Bandit:
    """Worlds in which action 7 earns 1, and action 3, which is refused, would earn 100."""

    def __init__(self, ends: str) -> None:
        self.observation = np.ones((16, 2), np.float32)
        self.permitted = np.ones((16, 12), np.bool_)
        self.permitted[:, REFUSED] = False
        self.asked: list[int] = []
        self._ends = ends

    def step(self, action: npt.NDArray[np.int64]) -> Outcome:
        self.asked += action.tolist()
        reward = np.select([action == BEST, action == REFUSED], [1.0, 100.0]).astype(np.float32)
        over, no = np.ones(16, np.bool_), np.zeros(16, np.bool_)
        if self._ends == "truncated":
            return Outcome(reward, no, over, self.observation)
        return Outcome(reward, over, no, self.observation[:0])


def trained(ends: str, seed: int = 1) -> tuple[Ppo, Bandit]:
    worlds = Bandit(ends)
    learner = Ppo(worlds, SMALL, seed)
    for _ in learner.learn():
        pass
    return learner, worlds


def test_the_best_permitted_action_is_learned_and_the_refused_one_never_tried() -> None:
    learner, worlds = trained("terminated")
    assert REFUSED not in worlds.asked
    assert len(worlds.asked) == SMALL.decisions
    chances = learner.model.log_probabilities(torch.ones(1, 2), torch.ones(1, 12, dtype=torch.bool))
    permitted = torch.from_numpy(worlds.permitted[:1])
    masked = learner.model.log_probabilities(torch.ones(1, 2), permitted).exp()
    assert masked[0, BEST] > 0.9
    assert masked[0, REFUSED] == 0.0
    assert chances.exp()[0, REFUSED] > 0.0  # the mask refuses it, not the network


def test_a_truncated_episode_counts_the_value_beyond_its_end_and_a_terminated_one_does_not() -> (
    None
):
    # the value is scaled: 1 a decision for ever is 10, once only it is 0.1
    values = {
        ends: float(trained(ends)[0].model.value(torch.ones(1, 2)).detach())
        for ends in ("terminated", "truncated")
    }
    assert values["terminated"] == pytest.approx(0.1, abs=0.1)
    assert values["truncated"] > 1.0


def test_the_same_seed_gives_the_same_weights_and_another_seed_others() -> None:
    one, again, other = (
        torch.cat(
            [weight.flatten() for weight in trained("terminated", seed)[0].model.parameters()]
        )
        for seed in (1, 1, 2)
    )
    assert torch.equal(one, again)
    assert not torch.equal(one, other)


def test_advantages_of_three_decisions_by_hand() -> None:
    # one world; discount 0.5 and trace decay 0.5, so a later error counts a quarter
    reward = torch.tensor([[1.0], [2.0], [3.0]])
    value = torch.tensor([[10.0], [20.0], [30.0]])
    # errors: 1 + 10 - 10 = 1; 2 + 15 - 20 = -3; 3 + 20 - 30 = -7
    goes_on = gae(reward, value, torch.zeros(3, 1), torch.tensor([40.0]), 0.5, 0.5)
    assert goes_on.flatten().tolist() == [1 - 0.25 * 4.75, -3 - 0.25 * 7, -7.0]
    # the second decision ends an episode: its error is 2 - 20, and nothing later counts in it
    ends = torch.tensor([[0.0], [1.0], [0.0]])
    over = gae(reward, value, ends, torch.tensor([40.0]), 0.5, 0.5)
    assert over.flatten().tolist() == [1 - 0.25 * 18, -18.0, -7.0]


def test_the_networks_have_the_named_sizes() -> None:
    model = ActorCritic(5, (4, 3))
    shapes = [tuple(weight.shape) for weight in model.actor.parameters()]
    assert shapes == [(4, 5), (4,), (3, 4), (3,), (12, 3), (12,)]
    assert [*model.critic.parameters()][-1].shape == (1,)
