"""The Q-network of Sec. IV-C of the paper: 27 inputs, two layers of 100 leaky ReLU, 12 outputs."""

from collections.abc import Sequence

import numpy as np

from drl_av.arrays import Float32Array
from drl_av.compiled import borrowing
from drl_av.driving.actions import ACTIONS
from drl_av.driving.affordances import INDICATORS

Layers = list[tuple[Float32Array, Float32Array]]
"""One pair (weight, bias) for each layer, of shapes (outputs, inputs) and (outputs,)."""

LEAK = 0.01
"""Slope of the leaky ReLU below zero."""


class QNetwork:
    """A fully connected network; all its weights and biases are views of one vector, ``flat``.

    A learner changes the vector in place, and the change takes effect in every driver at once.

    Args:
        rng: Draws the initial weights and biases, uniform in +- 1 / sqrt(inputs).
        observation_size: Number of inputs.
        action_size: Number of outputs.
        hidden: Number of units of each hidden layer.
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
        """The (weight, bias) of each layer, from the first to the last, as views of ``flat``."""
        return self.split(self.flat)

    def split(self, flat: Float32Array) -> Layers:
        """Return the (weight, bias) of each layer as views of ``flat``.

        The argument is a vector with the layout of the attribute ``flat``, such as a gradient.
        """
        layers, start = [], 0
        for inputs, outputs in zip(self.sizes[:-1], self.sizes[1:], strict=True):
            middle, end = start + inputs * outputs, start + (inputs + 1) * outputs
            layers.append((flat[start:middle].reshape(outputs, inputs), flat[middle:end]))
            start = end
        return layers

    def tensors(self) -> dict[str, Float32Array]:
        """Return views of the weights and biases; the keys are their names in a policy file."""
        named: dict[str, Float32Array] = {}
        for number, (weight, bias) in enumerate(self.layers):
            named |= {f"layers.{number}.weight": weight, f"layers.{number}.bias": bias}
        return named


def forward(layers: Layers, s: Float32Array) -> tuple[list[Float32Array], Float32Array]:
    """Run the network on observations; return the list of each layer's input, and Q(s, .).

    ``s`` has shape (rows, observation_size), and Q has shape (rows, action_size). For a single
    observation both lack the axis ``rows``. The Q-values of a single observation may differ in the
    last bits from those of the same observation in a batch, because BLAS sums in another order.
    """
    entered = [s]
    for weight, bias in layers[:-1]:
        z = entered[-1].dot(weight.T)
        activate(z.reshape(-1, len(bias)), bias)
        entered.append(z)
    weight, bias = layers[-1]
    q: Float32Array = entered[-1].dot(weight.T)
    q += bias
    return entered, q


def leaky_relu(x: np.floating, slope: np.floating) -> np.floating:
    """Return ``x``, multiplied by ``slope`` below zero."""
    return x if x > 0 else x * slope


@borrowing
def activate(z: Float32Array, bias: Float32Array) -> None:
    """Add the biases of a layer to ``z``, shape (rows, units), and apply the leaky ReLU, in place.

    Compiled, because each pass of numpy over a minibatch takes longer than its arithmetic.
    """
    slope = z.dtype.type(LEAK)
    for row in range(z.shape[0]):
        for unit in range(z.shape[1]):
            z[row, unit] = leaky_relu(z[row, unit] + bias[unit], slope)


@borrowing
def activate_backward(dz: Float32Array, activated: Float32Array) -> None:
    """Multiply ``dz`` by the slopes of the leaky ReLU where it made ``activated``, in place.

    Both have the shape (rows, units).
    """
    slope = dz.dtype.type(LEAK)
    for row in range(dz.shape[0]):
        for unit in range(dz.shape[1]):
            if not activated[row, unit] > 0:
                dz[row, unit] *= slope
