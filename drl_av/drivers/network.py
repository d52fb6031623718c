"""The Q-network: 27 indicators -> 100 -> 100 leaky ReLU -> the values of 12 actions (Sec. IV-C)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS

Float32Array = NDArray[np.float32]
Layers = list[tuple[Float32Array, Float32Array]]
"""Weight (outputs, inputs) and bias (outputs,) of each layer."""

LEAK = 0.01
"""Slope of the leaky ReLU below zero."""


class QNetwork:
    """Fully connected layers whose weights and biases are views of one vector, ``flat``.

    A learner steps the vector in place, and every driver of the network follows at once.

    Args:
        rng: Draws the first weights and biases, uniformly within 1 / sqrt(inputs) of 0.
        observation_size, action_size: Inputs and outputs.
        hidden: Units of each hidden layer.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        observation_size: int = len(INDICATORS),
        action_size: int = len(ACTIONS),
        hidden: Sequence[int] = (100, 100),
    ) -> None:
        self.sizes = (observation_size, *hidden, action_size)
        shapes = zip(self.sizes[:-1], self.sizes[1:], strict=True)
        self.flat = np.zeros(sum((inputs + 1) * outputs for inputs, outputs in shapes), np.float32)
        for weight, bias in self.layers:
            bound = weight.shape[1] ** -0.5
            for view in (weight, bias):
                view[...] = rng.uniform(-bound, bound, view.shape)

    @property
    def layers(self) -> Layers:
        """The network's weights and biases, as views of ``flat``."""
        return self.split(self.flat)

    def split(self, flat: Float32Array) -> Layers:
        """Views of any vector as long as ``flat``, such as its gradient, in the same shapes."""
        layers, start = [], 0
        for inputs, outputs in zip(self.sizes[:-1], self.sizes[1:], strict=True):
            middle, end = start + inputs * outputs, start + (inputs + 1) * outputs
            layers.append((flat[start:middle].reshape(outputs, inputs), flat[middle:end]))
            start = end
        return layers

    def tensors(self) -> dict[str, Float32Array]:
        """The views by the names that a policy file gives them."""
        named: dict[str, Float32Array] = {}
        for number, (weight, bias) in enumerate(self.layers):
            named |= {f"layers.{number}.weight": weight, f"layers.{number}.bias": bias}
        return named


def forward(layers: Layers, s: Float32Array) -> tuple[list[Float32Array], Float32Array]:
    """What enters each layer, and Q(s, .).

    Shapes: (rows, observation_size) -> (rows, action_size), or one observation without the axis
    of rows. One observation's values may differ from those of its row in a batch in the last bits,
    because BLAS sums in another order.
    """
    entered = [s]
    for weight, bias in layers[:-1]:
        z = entered[-1].dot(weight.T)
        z += bias
        entered.append(np.maximum(z, z * LEAK, out=z))
    weight, bias = layers[-1]
    q: Float32Array = entered[-1].dot(weight.T)
    q += bias
    return entered, q
