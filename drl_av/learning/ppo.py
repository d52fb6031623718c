"""Proximal policy optimization with masked actions, in thousands of worlds at once (ours).

The algorithm is that of Schulman et al. 2017 (arXiv:1707.06347), with the advantages of Schulman
et al. 2016 (GAE, arXiv:1506.02438) and the masks of Huang and Ontanon 2022 (arXiv:2006.14171): an
action that the safety check would replace has probability 0.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch.nn import functional

from drl_av.config.ppo import PpoConfig
from drl_av.drivers.network import LEAK
from drl_av.driving.actions import ACTIONS

VALUE_SCALE = 10.0
"""The critic's value is this number times the mean of the rewards to come, weighted by the discount
so that its size does not depend on the discount."""
REFUSED = -1e9
"""The logit of an action that the mask does not permit."""


class Outcome(NamedTuple):
    """The result of one decision in each of W worlds."""

    reward: npt.NDArray[np.float32]
    """Shape (W,)."""
    terminated: npt.NDArray[np.bool_]
    """Shape (W,); whether the ego collided."""
    truncated: npt.NDArray[np.bool_]
    """Shape (W,); whether the episode ended for another reason."""
    final: npt.NDArray[np.float32]
    """Shape (truncated worlds, S): the last observation of each truncated episode."""


class ManyWorlds(Protocol):
    """W worlds that take one decision each; an episode that ends is followed by a new one.

    ``observation`` and ``permitted`` describe the present scenes, also those of new episodes.
    """

    observation: npt.NDArray[np.float32]
    """Shape (W, S)."""
    permitted: npt.NDArray[np.bool_]
    """Shape (W, 12); whether the action is permitted. Each row has at least one True."""

    def step(self, action: npt.NDArray[np.int64]) -> Outcome:
        """Execute one action in each world, shape (W,)."""


class ActorCritic(nn.Module):
    """Two networks of leaky ReLU: the actor has a logit for each action, the critic the value."""

    def __init__(self, observation_size: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.actor = network((observation_size, *hidden, len(ACTIONS)), last_gain=0.01)
        self.critic = network((observation_size, *hidden, 1), last_gain=1.0)

    def log_probabilities(self, observation: Tensor, permitted: Tensor) -> Tensor:
        """Return the logarithm of each action's probability, shape (rows, 12)."""
        logits = self.actor(observation).masked_fill(~permitted, REFUSED)
        return functional.log_softmax(logits, dim=-1)

    def value(self, observation: Tensor) -> Tensor:
        """Return the expected discounted return, shape (rows,)."""
        value: Tensor = self.critic(observation).squeeze(-1)
        return value


def network(sizes: tuple[int, ...], last_gain: float) -> nn.Sequential:
    """Return a network of fully connected layers with orthogonal weights."""
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(sizes):
        linear = nn.Linear(inputs, outputs)
        is_last = len(layers) == 2 * (len(sizes) - 2)
        nn.init.orthogonal_(linear.weight, last_gain if is_last else 2**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear] if is_last else [linear, nn.LeakyReLU(LEAK)]
    return nn.Sequential(*layers)


class Batch(NamedTuple):
    """T decisions in W worlds; tensors of shape (T, W, ...), or (T * W, ...) when flattened."""

    observation: Tensor
    permitted: Tensor
    action: Tensor
    log_probability: Tensor
    advantage: Tensor
    value: Tensor
    """The target of the critic."""

    def rows(self, index: Tensor) -> "Batch":
        """Return the rows of a flattened batch."""
        return Batch(*(tensor[index] for tensor in self))


class Progress(NamedTuple):
    """What one update has learned from."""

    decisions: int
    """Decisions so far, in all worlds together."""
    mean_reward: float
    """Mean reward of a decision."""
    collisions: int
    """Episodes that ended with a collision."""
    entropy: float
    """Mean entropy of the policy, nats."""


class Ppo:
    """The learner: collects decisions in its worlds and improves its policy, update by update.

    With the same settings, worlds and machine, the weights are the same to the bit.
    """

    def __init__(self, worlds: ManyWorlds, settings: PpoConfig, seed: int) -> None:
        torch.set_num_threads(1)
        torch.manual_seed(seed)
        self._worlds, self.settings = worlds, settings
        count, size = worlds.observation.shape
        self.model = ActorCritic(size, (settings.hidden_1, settings.hidden_2))
        self._optimizer = torch.optim.Adam(self.model.parameters(), eps=1e-5, fused=True)
        self._steps = settings.batch_size // count
        self.updates = settings.decisions // (self._steps * count)

    def learn(self) -> Iterator[Progress]:
        """Train to the end; yield after each update."""
        for update in range(self.updates):
            for group in self._optimizer.param_groups:
                group["lr"] = self.settings.learning_rate * (1.0 - update / self.updates)
            batch, reward, collisions = self._collect()
            entropy = self._improve(batch)
            decisions = (update + 1) * len(batch.action)
            yield Progress(decisions, reward, collisions, entropy)

    @torch.no_grad()
    def _collect(self) -> tuple[Batch, float, int]:
        """Drive with the present policy; return the flattened batch."""
        count, size = self._worlds.observation.shape
        shape = (self._steps, count)
        scale = VALUE_SCALE * (1.0 - self.settings.discount)
        observations = torch.empty(*shape, size)
        permitted = torch.empty(*shape, len(ACTIONS), dtype=torch.bool)
        actions = torch.empty(shape, dtype=torch.int64)
        chosen, rewards, ended = torch.empty(shape), torch.empty(shape), torch.empty(shape)
        mean_reward, collisions = 0.0, 0
        for t in range(self._steps):
            observations[t] = torch.from_numpy(self._worlds.observation)
            permitted[t] = torch.from_numpy(self._worlds.permitted)
            log_probabilities = self.model.log_probabilities(observations[t], permitted[t])
            noise = torch.empty_like(log_probabilities).exponential_().log()
            actions[t] = (log_probabilities - noise).argmax(-1)  # a Gumbel-max sample
            chosen[t] = log_probabilities.gather(-1, actions[t, :, None]).squeeze(-1)
            outcome = self._worlds.step(actions[t].numpy())
            rewards[t] = torch.from_numpy(outcome.reward) * scale
            ended[t] = torch.from_numpy(outcome.terminated | outcome.truncated)
            if len(outcome.final):
                after = self.model.value(torch.from_numpy(outcome.final))
                rewards[t, torch.from_numpy(outcome.truncated)] += self.settings.discount * after
            mean_reward += float(outcome.reward.mean()) / self._steps
            collisions += int(outcome.terminated.sum())
        values = torch.stack([*map(self.model.value, observations)])
        next_value = self.model.value(torch.from_numpy(self._worlds.observation))
        advantages = gae(
            rewards, values, ended, next_value, self.settings.discount, self.settings.gae_lambda
        )
        batch = Batch(observations, permitted, actions, chosen, advantages, advantages + values)
        return Batch(*(tensor.flatten(0, 1) for tensor in batch)), mean_reward, collisions

    def _improve(self, batch: Batch) -> float:
        """Make the gradient steps of one update; return the mean entropy of the last epoch."""
        entropy, minibatch = 0.0, self.settings.minibatch_size
        for _ in range(self.settings.epochs):
            order = torch.randperm(len(batch.action))
            entropies = [self._descend(batch.rows(part)) for part in torch.split(order, minibatch)]
            entropy = float(np.mean(entropies))
        return entropy

    def _descend(self, batch: Batch) -> float:
        """Make one gradient step; return the mean entropy."""
        settings = self.settings
        log_probabilities = self.model.log_probabilities(batch.observation, batch.permitted)
        chosen = log_probabilities.gather(-1, batch.action[:, None]).squeeze(-1)
        entropy = -(log_probabilities.exp() * log_probabilities).sum(-1).mean()
        advantage = (batch.advantage - batch.advantage.mean()) / (batch.advantage.std() + 1e-8)
        ratio = (chosen - batch.log_probability).exp()
        clipped = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
        policy_loss = -torch.minimum(ratio * advantage, clipped * advantage).mean()
        value_loss = functional.mse_loss(self.model.value(batch.observation), batch.value)
        loss = policy_loss - settings.entropy * entropy + settings.value_weight * value_loss
        self._optimizer.zero_grad()
        torch.autograd.backward(loss)
        for part in (self.model.actor, self.model.critic):
            nn.utils.clip_grad_norm_(part.parameters(), settings.max_gradient_norm)
        self._optimizer.step()
        return float(entropy.detach())


def gae(
    reward: Tensor,
    value: Tensor,
    ended: Tensor,
    next_value: Tensor,
    discount: float,
    trace_decay: float,
) -> Tensor:
    """Return the generalized advantage estimates, shape (T, W).

    The first three arguments have shape (T, W); ``ended`` is 1 where the decision ended an episode,
    else 0. ``next_value``, shape (W,), is the value after the last decision.
    """
    advantage, result = torch.zeros_like(next_value), torch.empty_like(reward)
    for t in reversed(range(len(reward))):
        goes_on = 1.0 - ended[t]
        delta = reward[t] + discount * next_value * goes_on - value[t]
        advantage = delta + discount * trace_decay * goes_on * advantage
        result[t], next_value = advantage, value[t]
    return result
