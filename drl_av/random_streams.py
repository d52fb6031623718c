"""The random streams of an episode: each purpose has its own, so none changes the others (ours)."""

from collections.abc import Sequence
from enum import IntEnum
from typing import TypeVar

import numpy as np

Kind = TypeVar("Kind")


class Stream(IntEnum):
    """The purposes of random numbers in an episode, beside the population of the traffic."""

    NUMBER_OF_VEHICLES = 1
    RANDOM_DRIVER = 2
    KINDS_OF_DRIVERS = 3
    HARD_BRAKING = 4
    KIND_OF_TRAFFIC = 5
    OWN_VEHICLE_TYPES = 6
    FORKS = 7
    PLANS = 8


def kind_of_traffic(seed: int, kinds: Sequence[Kind]) -> Kind:
    """Draw the one of some kinds of traffic that the episode with this traffic seed has."""
    if len(kinds) == 1:
        return kinds[0]
    return kinds[int(generator(seed, Stream.KIND_OF_TRAFFIC).integers(len(kinds)))]


def generator(seed: int, stream: Stream) -> np.random.Generator:
    """Return the random generator of a stream in the episode with this traffic seed."""
    return np.random.default_rng([seed, stream])
