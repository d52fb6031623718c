"""The random streams of an episode: each purpose has its own, so none changes the others (ours)."""

from enum import IntEnum

import numpy as np


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


def kind_of_traffic(seed: int, kinds: int) -> int:
    """Draw which of ``kinds`` kinds of traffic the episode with this traffic seed has."""
    return int(generator(seed, Stream.KIND_OF_TRAFFIC).integers(kinds)) if kinds > 1 else 0


def generator(seed: int, stream: Stream) -> np.random.Generator:
    """Return the random generator of a stream in the episode with this traffic seed."""
    return np.random.default_rng([seed, stream])
