"""The start of an episode: its seed, its traffic and its number of vehicles."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.arrays import IntArray
from drl_av.config import Config, SimulationConfig
from drl_av.config.presets import as_config
from drl_av.config.section import did_you_mean
from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.driving.actions import ACTIONS
from drl_av.env.twin_simulation import TwinSimulation
from drl_av.errors import ConfigError, pluralize, warn
from drl_av.random_streams import Stream, generator
from drl_av.scenarios.folder import Scenario, with_scenario
from drl_av.scenarios.layout import Layout
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.simulation import Simulation
from drl_av.simulation.sumo_options import option_words, require_usual_driving

DECISIONS = SimulationConfig().decisions_per_episode
"""The default number of decisions in an episode, N_s of the paper."""
TRAINING_SEED_RANGE = (1_000_000, 2**31)
"""Range [low, high) of the traffic seeds that a reset draws; evaluations use smaller seeds."""


def settings_on(
    config: Config | Mapping[str, Any] | str | Path | None, scenario: str | Path | None
) -> Config:
    """Return the settings of an environment on the road ``scenario``, by default on their own.

    A warning says that the settings name another road than ``scenario``.

    Raises:
        ConfigError: a setting is wrong, or ``scenario`` is neither a text nor a Path.
    """
    given, usual = as_config(config), SimulationConfig().scenario
    settings, named = with_scenario(given, scenario), with_scenario(given).simulation.scenario
    if settings.simulation.scenario != named != usual:
        warn(
            f"The environment is on the road {settings.simulation.scenario}, not on {named} of its "
            "settings: name one of them.",
            stacklevel=3,
        )
    return settings


def traffic_seed(seed: int | None, options: Mapping[str, Any], rng: np.random.Generator) -> int:
    """Return the seed of an episode's traffic.

    It is ``seed`` if this is at least 1,000,000, or if ``options`` contains ``vehicles``. Otherwise
    ``rng``, which gymnasium has seeded with ``seed``, draws it from ``TRAINING_SEED_RANGE``.
    Libraries pass small seeds to their first reset, which must not select an episode of the
    evaluation.
    """
    if seed is not None and (seed >= TRAINING_SEED_RANGE[0] or "vehicles" in options):
        return seed
    return int(rng.integers(*TRAINING_SEED_RANGE))


def most_decisions(config: Config, layout: Layout) -> int:
    """Return the largest number of decisions in an episode (ours).

    It is ``decisions_per_episode``. If that is not below its default, N_s, and the ego has an exit,
    it is at least twice the number of decisions that the way takes at the ego's largest speed, or
    at lower speed limits. If it is below, and the way takes more, a warning says so.
    """
    timing, start = config.simulation, layout.start
    most = timing.decisions_per_episode
    if start is None or layout.road.exit_m == math.inf:
        return most
    way_s = start.travel_s(start.ego_front_m, layout.road.end_m, config.ego.max_speed_m_s)
    needed = way_s / timing.decision_interval_s
    if most >= DECISIONS:
        return max(most, math.ceil(2 * needed))
    if needed > most:
        warn(
            f"The ego may miss its exit: its way takes {math.ceil(needed)} decisions, but an "
            f"episode has {most}: set simulation.decisions_per_episode to {DECISIONS}, with which "
            "an episode is as long as the way needs."
        )
    return most


def reset_options(options: Any, *further: str) -> dict[str, Any]:
    """Return the options of a reset as a new dictionary.

    Raises:
        ConfigError: they are no dictionary, or have an option other than ``vehicles`` and
            ``further``.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise ConfigError(
            f"reset has the options {options!r}, but they must be a dictionary such as "
            "{'vehicles': 30}."
        )
    for name in options:
        if name not in ("vehicles", *further):
            known = "vehicles", *further
            raise ConfigError(
                f"reset has no option {name!r}{did_you_mean(name, known)}; its options are: "
                f"{', '.join(known)}."
            )
    return dict(options)


def rows_to_reset(mask: Any, worlds: int, begun: bool) -> npt.NDArray[np.intp]:
    """Return the worlds that the option ``reset_mask`` of a vector environment names.

    Raises:
        ConfigError: it is not bool of shape (worlds,), or leaves out a world that never ``begun``.
    """
    if mask is None:
        return np.arange(worlds)
    wanted = _as_array(mask)
    if wanted.dtype != np.bool_ or wanted.shape != (worlds,):
        raise ConfigError(
            f"reset_mask must be an array of {worlds} times True or False, one for each world."
        )
    if not begun and not wanted.all():
        raise ConfigError("The first reset begins all worlds: leave reset_mask out.")
    return np.flatnonzero(wanted)


def seeds_of_worlds(seed: Any, worlds: int) -> list[int | None]:
    """Return the seed of each world: ``seed`` + i, or those that ``seed`` lists.

    Raises:
        ConfigError: ``seed`` is no whole number below 2^63, and does not list one or None for each
            world.
    """
    if seed is None:
        return [None] * worlds
    seeds = [int(seed) + row for row in range(worlds)] if is_whole(seed) else seed
    is_list = isinstance(seeds, Sequence) or (isinstance(seeds, np.ndarray) and seeds.ndim == 1)
    listed = is_list and len(seeds) == worlds
    if not listed or not all(one is None or (is_whole(one) and one < 2**63) for one in seeds):
        raise ConfigError(
            f"seed is {seed!r}, but must be a whole number or one for each of the {worlds} worlds, "
            "each world's below 2^63."
        )
    return [None if one is None else int(one) for one in seeds]


def actions_of_worlds(actions: Any, worlds: int) -> IntArray:
    """Return one action for each world; raise ConfigError unless these are such numbers."""
    given = _as_array(actions)
    right = given.shape == (worlds,) and given.dtype.kind in "iu"
    if not right or given.min() < 0 or given.max() >= len(ACTIONS):
        raise ConfigError(
            f"The actions must be {worlds} whole numbers from 0 to {len(ACTIONS) - 1}."
        )
    return given.astype(np.int64)


def _as_array(values: Any) -> npt.NDArray[Any]:
    """Return an array of the values, an empty one if no array can hold them."""
    try:
        return np.asarray(values)
    except ValueError:  # a ragged sequence
        return np.empty(0)


def is_whole(value: Any) -> bool:
    """Whether a value is a whole number, and not True or False."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def require_numbers(**given: tuple[Any, int, int | None]) -> None:
    """Raise ConfigError unless each value is a whole number from a lowest one to below an end."""
    for name, (value, low, end) in given.items():
        if not is_whole(value) or value < low or (end is not None and value >= end):
            most = "on" if end is None else f"to {end - 1}"
            raise ConfigError(f"{name} is {value!r}, but must be a whole number from {low} {most}.")


def number_of_vehicles(options: Mapping[str, Any], seed: int, fleet: Fleet) -> int:
    """Return the number of vehicles besides the ego, by the options of the reset.

    It is the number that the scenario of the fleet places, or else that of ``options``, or else the
    number that the inflow of an open road sustains, or else drawn with ``seed``, that of the
    traffic, from the range of the settings.

    Raises:
        ConfigError: the number of vehicles is not allowed.
    """
    if (placed := fleet.placed) is not None:
        if options.get("vehicles", placed) != placed:
            raise ConfigError(
                f"vehicles is {options['vehicles']!r}, but the scenario places exactly {placed} "
                f"vehicle{'s' * (placed != 1)}: leave the option out."
            )
        return placed
    if "vehicles" in options:
        require_numbers(vehicles=(options["vehicles"], 0, None))
        return int(options["vehicles"])
    if (usual := fleet.default_vehicle_count) is not None:
        return usual
    traffic, draw_number = fleet.config.traffic, generator(seed, Stream.NUMBER_OF_VEHICLES)
    return int(draw_number.integers(traffic.vehicles_min, traffic.vehicles_max + 1))


def require_range(fleets: Sequence[Fleet]) -> None:
    """Raise ConfigError if ``traffic.vehicles_max`` vehicles do not fit on the loop of the fleets.

    The number of vehicles at the start on an open road, which they have by default, always fits.
    """
    if fleets[0].default_vehicle_count is not None:
        return
    most = min(fleet.capacity for fleet in fleets)
    wanted = fleets[0].config.traffic.vehicles_max
    if wanted > most:
        raise ConfigError(
            f"traffic.vehicles_max is {wanted}, but this road takes "
            f"{pluralize(most, 'vehicle')} besides the ego: ask for fewer or make the loop longer."
        )


class TrafficSetup(NamedTuple):
    """The traffic of one kind."""

    simulation: Simulation | TwinSimulation
    drivers: TrafficDrivers


def traffic_setups(
    config: Config, scenario: Scenario, gui: bool, sumo_options: str | Sequence[str]
) -> list[TrafficSetup]:
    """Return the traffic of each kind that an episode may have; often there is only one.

    Raises the errors of ``Simulation`` or ``TwinSimulation``, and of ``require_usual_driving``.
    """
    if config.safety.check == "strict":
        require_usual_driving(option_words(sumo_options))
    found = []
    for each in config.per_traffic_preset:
        drivers = TrafficDrivers(each, scenario.road, scenario.vehicle_types)
        world = TwinSimulation if each.simulation.world == "twin" else Simulation
        found.append(TrafficSetup(world(scenario, each, gui, sumo_options), drivers))
    return found
