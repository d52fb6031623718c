"""Several networks that learn apart and decide together: the mean of what they estimate (ours).

What is wrong in one of them is seldom wrong in all, so that a driver depends less on chance
(bootstrapped ensembles after Osband et al. 2016; the mean as in Averaged-DQN, Anschel et al. 2017).
"""

from collections.abc import Sequence

import numpy as np

from drl_av.learning.buffers import Float32Array
from drl_av.learning.qnetwork import GreedyPolicy, Layers, QNetwork


class MeanPolicy(GreedyPolicy):
    """argmax_a of the mean of several policies' values; follows their networks' every change."""

    def __init__(self, policies: Sequence[GreedyPolicy]) -> None:
        self._policies = policies

    def values(self, s_t: Float32Array) -> Float32Array:
        """The mean of the estimates: (observation_size,) -> (action_size,)."""
        values = self._policies[0].values(s_t)
        for policy in self._policies[1:]:
            values += policy.values(s_t)
        values /= np.float32(len(self._policies))
        return values


def merged(networks: Sequence[QNetwork]) -> QNetwork:
    """One network whose values are the mean of theirs: their hidden units side by side.

    The networks have the same sizes; one alone is returned as it is.
    """
    if len(networks) == 1:
        return networks[0]
    inputs, *hidden, outputs = networks[0].sizes
    whole = _blank((inputs, *(units * len(networks) for units in hidden), outputs))
    for number, network in enumerate(networks):
        own = network.split(network.flat.numpy())
        for place, (weight, bias) in zip(_places(whole, number, len(networks)), own, strict=True):
            place[0][...] = weight
            place[1][...] += bias
    weight, bias = whole.split(whole.flat.numpy())[-1]
    weight /= np.float32(len(networks))
    bias /= np.float32(len(networks))
    return whole


def divided(whole: QNetwork, count: int) -> list[QNetwork]:
    """Networks whose mean ``whole`` is, where ``merged`` made it of so many."""
    if count == 1:
        return [whole]
    inputs, *hidden, outputs = whole.sizes
    networks = [
        _blank((inputs, *(units // count for units in hidden), outputs)) for _ in range(count)
    ]
    for number, network in enumerate(networks):
        own = network.split(network.flat.numpy())
        for place, (weight, bias) in zip(_places(whole, number, count), own, strict=True):
            weight[...] = place[0]
            bias[...] = place[1]
        own[-1][0][...] *= np.float32(count)
    return networks


def _blank(sizes: Sequence[int]) -> QNetwork:
    network = QNetwork(np.random.default_rng(0), sizes[0], sizes[-1], sizes[1:-1])
    network.flat.zero_()
    return network


def _places(whole: QNetwork, number: int, count: int) -> Layers:
    """Views of what one of so many networks has of the whole; all share the last bias."""
    layers = whole.split(whole.flat.numpy())
    places = []
    for i, (weight, bias) in enumerate(layers):
        outputs, inputs = (
            slice(None) if shared else slice(number * size // count, (number + 1) * size // count)
            for shared, size in zip((i == len(layers) - 1, i == 0), weight.shape, strict=True)
        )
        places.append((weight[outputs, inputs], bias[outputs]))
    return places
