"""Which episode a reset starts: the seed of its traffic and its number of vehicles."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from drl_av.config import TrafficConfig
from drl_av.errors import ConfigError

TRAINING_SEEDS = (1_000_000, 2**31)
"""Traffic seeds that a reset draws from unless it names one; those below are evaluation's."""


def traffic_seed(seed: int | None, options: Mapping[str, Any], rng: np.random.Generator) -> int:
    """The seed given where it names an episode, else one of training's.

    A small seed without a number of vehicles is what clients pass to their first reset, to seed
    all that is random, as they have seeded ``rng``.
    """
    if seed is not None and (seed >= TRAINING_SEEDS[0] or "vehicles" in options):
        return seed
    return int(rng.integers(*TRAINING_SEEDS))


def number_of_vehicles(
    options: Mapping[str, Any], seed: int, traffic: TrafficConfig, placed: int | None
) -> int:
    """Vehicles beside the ego: those asked for, else drawn with the seed of the traffic.

    Args:
        placed: how many the scenario places exactly; None where it places none.

    Raises:
        ConfigError: an unknown option, or a number of vehicles that is none.
    """
    unknown = set(options) - {"vehicles"}
    if unknown:
        raise ConfigError(f"reset has no option {unknown.pop()!r}; its option is: vehicles.")
    if placed is not None:
        if options.get("vehicles", placed) != placed:
            raise ConfigError(
                f"vehicles is {options['vehicles']!r}, but the scenario places {placed} "
                "vehicles exactly: leave the option out."
            )
        return placed
    if "vehicles" not in options:
        draw_number = np.random.default_rng([seed, 1])
        return int(draw_number.integers(traffic.vehicles_min, traffic.vehicles_max + 1))
    vehicles = options["vehicles"]
    if isinstance(vehicles, bool) or not isinstance(vehicles, int | np.integer) or vehicles < 0:
        raise ConfigError(f"vehicles is {vehicles!r}, but must be a whole number from 0 on.")
    return int(vehicles)
