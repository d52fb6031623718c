"""The Q-network: 27 indicators -> 100 -> 100 leaky ReLU -> the values of 12 actions."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from drl_av.learning.buffers import Float32Array

Layers = list[tuple[Float32Array, Float32Array]]

LEAK = 0.01
_LEAK = np.float32(LEAK)


class QNetwork(nn.Module):
    """Fully connected layers whose parameters are views of one vector, ``flat``.

    The vector is what the learner steps and copies; ``state_dict`` names its parts.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        observation_size: int = 27,
        action_size: int = 12,
        hidden: Sequence[int] = (100, 100),
    ) -> None:
        super().__init__()
        self.sizes = (observation_size, *hidden, action_size)
        shapes = list(zip(self.sizes[:-1], self.sizes[1:], strict=True))
        self.flat = torch.zeros(sum((inputs + 1) * outputs for inputs, outputs in shapes))
        self.layers = nn.ModuleList()
        views = self.split(self.flat.numpy())
        for (weight, bias), (inputs, outputs) in zip(views, shapes, strict=True):
            bound = inputs**-0.5
            for view in (weight, bias):
                view[...] = rng.uniform(-bound, bound, view.shape)
            linear = nn.Linear(inputs, outputs, device="meta")
            linear.weight = nn.Parameter(torch.from_numpy(weight))
            linear.bias = nn.Parameter(torch.from_numpy(bias))
            self.layers.append(linear)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles keep the parameters views of their own vector."""
        return _rebuilt, (self.sizes, self.flat.numpy())

    def split(self, flat: Float32Array) -> Layers:
        """Views of a vector as long as ``flat``: (outputs, inputs) weight, (outputs,) bias."""
        layers, start = [], 0
        for inputs, outputs in zip(self.sizes[:-1], self.sizes[1:], strict=True):
            middle, end = start + inputs * outputs, start + (inputs + 1) * outputs
            layers.append((flat[start:middle].reshape(outputs, inputs), flat[middle:end]))
            start = end
        return layers

    def forward(self, s: Tensor) -> Tensor:
        """Q(s, .): (rows, observation_size) -> (rows, action_size).

        For whoever uses the network in torch; training and driving do the same in numpy.
        """
        *hidden, last = self.layers
        for layer in hidden:
            s = nn.functional.leaky_relu(layer(s), LEAK)
        values: Tensor = last(s)
        return values


def _rebuilt(sizes: tuple[int, ...], flat: Float32Array) -> QNetwork:
    network = QNetwork(np.random.default_rng(0), sizes[0], sizes[-1], sizes[1:-1])
    network.flat.copy_(torch.from_numpy(flat))
    return network


class GreedyPolicy:
    """argmax_a Q(s, a) for one observation, in numpy on memory shared with the network.

    It follows every later change of the network's parameters made in place, as the learner's
    are, and is three times as fast as the module at one row.
    """

    def __init__(self, network: QNetwork) -> None:
        views = network.split(network.flat.numpy())
        self._hidden, self._last = views[:-1], views[-1]

    def values(self, s_t: Float32Array) -> Float32Array:
        """Q(s_t, .): (observation_size,) -> (action_size,)."""
        for weight, bias in self._hidden:
            s_t = weight.dot(s_t)
            s_t += bias
            np.maximum(s_t, s_t * _LEAK, out=s_t)
        weight, bias = self._last
        values: Float32Array = weight.dot(s_t)
        values += bias
        return values

    def __call__(self, s_t: Float32Array) -> int:
        """The action of the greatest value; the first of several equal ones."""
        return int(self.values(s_t).argmax())
