"""An episode: its seed, traffic and number of vehicles at a reset, and how the ego's route ends."""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from drl_av.config import Config, SimulationConfig, TrafficConfig
from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.driving.scene import Scene
from drl_av.env.twin_simulation import TwinSimulation
from drl_av.errors import ConfigError, DrlAvWarning
from drl_av.random_streams import Stream, generator, kind_of_traffic
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO
from drl_av.scenarios.folder import Scenario
from drl_av.scenarios.layout import Layout
from drl_av.simulation.simulation import Simulation

DECISIONS = SimulationConfig().decisions_per_episode
"""The default number of decisions in an episode, N_s of the paper."""
TRAINING_SEED_RANGE = (1_000_000, 2**31)
"""Range [low, high) of the traffic seeds that a reset draws; evaluations use smaller seeds."""


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
    it is at least the number of decisions that the way takes at half the ego's largest speed. If it
    is below, and the way takes more at the largest speed, a warning says so.
    """
    timing, start = config.simulation, layout.start
    most = timing.decisions_per_episode
    if start is None or layout.road.exit_m == math.inf:
        return most
    way_m = layout.road.end_m - start.ego_front_m
    fast_m = config.ego.max_speed_m_s * timing.decision_interval_s
    if most >= DECISIONS:
        return max(most, math.ceil(2 * way_m / fast_m))
    if way_m > most * fast_m:
        warnings.warn(
            f"The ego cannot take its exit: its way has {way_m:.0f} m, but in {most} decisions it "
            f"drives at most {most * fast_m:.0f} m: set simulation.decisions_per_episode to "
            f"{DECISIONS}, with which an episode is as long as the way needs.",
            DrlAvWarning,
            stacklevel=2,
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
            raise ConfigError(f"reset has no option {name!r}; its option is: vehicles.")
    return dict(options)


def number_of_vehicles(
    options: Mapping[str, Any],
    seed: int,
    traffic: TrafficConfig,
    placed: int | None,
    default: int | None = None,
) -> int:
    """Return the number of vehicles besides the ego.

    It is ``placed``, or else that of ``options``, or else ``default``, or else drawn with ``seed``.

    Args:
        options: The options of the reset.
        seed: The seed of the traffic.
        traffic: The settings with the range from which the number is drawn.
        placed: The number of vehicles whose positions the scenario fixes; None if it fixes none.
        default: The number of vehicles that the inflow of an open road sustains; None on a loop.

    Raises:
        ConfigError: the number of vehicles is not allowed.
    """
    if placed is not None:
        if options.get("vehicles", placed) != placed:
            raise ConfigError(
                f"vehicles is {options['vehicles']!r}, but the scenario places exactly {placed} "
                f"vehicle{'s' * (placed != 1)}: leave the option out."
            )
        return placed
    if "vehicles" not in options and default is not None:
        return default
    if "vehicles" not in options:
        draw_number = generator(seed, Stream.NUMBER_OF_VEHICLES)
        return int(draw_number.integers(traffic.vehicles_min, traffic.vehicles_max + 1))
    vehicles = options["vehicles"]
    if isinstance(vehicles, bool) or not isinstance(vehicles, int | np.integer) or vehicles < 0:
        raise ConfigError(f"vehicles is {vehicles!r}, but must be a whole number from 0 on.")
    return int(vehicles)


class TrafficSetup(NamedTuple):
    """The traffic of one kind."""

    simulation: Simulation | TwinSimulation
    drivers: TrafficDrivers


def traffic_setups(
    config: Config, scenario: Scenario, gui: bool, sumo_options: str | Sequence[str]
) -> list[TrafficSetup]:
    """Return the traffic of each kind that an episode may have; often there is only one.

    Raises the errors of ``Simulation`` or ``TwinSimulation``.
    """
    found = []
    for each in config.per_traffic_preset:
        drivers = TrafficDrivers(each, scenario.road, scenario.vehicle_types)
        world = TwinSimulation if each.simulation.world == "twin" else Simulation
        found.append(TrafficSetup(world(scenario, each, gui, sumo_options), drivers))
    return found


def drawn_traffic(
    setups: Sequence[TrafficSetup], seed: int, before: Simulation | TwinSimulation
) -> TrafficSetup:
    """Draw the traffic of an episode from its seed, and return it.

    ``before`` is the simulation of the previous episode. If the episode has another simulation,
    ``before`` is closed, and the new one calls the same ``after_step``.
    """
    if len(setups) == 1:
        return setups[0]
    drawn = setups[kind_of_traffic(seed, len(setups))]
    if drawn.simulation is not before:
        before.close()
        drawn.simulation.after_step = before.after_step
    return drawn


EXIT_TAKEN, EXIT_MISSED = "exit taken", "exit missed"
MERGED, NOT_MERGED = "merged", "not merged"
COMPLETE = (EXIT_TAKEN, MERGED)
"""The outcomes of a route that the ego has completed."""


class RouteOutcome:
    """The outcome of the ego's route in one episode.

    The route leads to the ego's exit. On a road without an exit, it leads out of the lane in which
    the ego starts, if that lane ends. Otherwise the ego has no route, and the outcome is always "".
    """

    def __init__(self, road: Road, start: Scene) -> None:
        self._road, self._has_exit = road, road.exit_m < math.inf
        self._end_m, self._exit_lane = road.exit_m, road.exit_lane
        if not self._has_exit and start.affordances.mandatory.lanes != 0:
            self._end_m = road.lane_end_m(start.affordances.lane, front_m(start))
        self._outcome = ""

    def outcome(self, scene: Scene, over: bool) -> str:
        """Return the outcome of the route after a decision, or "" while it is not decided.

        The outcome is "exit taken" or "exit missed" on a road with an exit, otherwise "merged" or
        "not merged". It stays the same once it is decided. ``over`` says whether the episode ends
        with ``scene``, by a collision or otherwise. If the outcome is still open then, it becomes
        "exit missed" or "not merged".
        """
        if self._end_m < math.inf and not self._outcome:
            failed = EXIT_MISSED if self._has_exit else NOT_MERGED
            self._outcome = self._passed(scene) or failed * over
        return self._outcome

    def misses_exit(self, scene: Scene) -> bool:
        """Return whether the ego has passed its exit without taking it."""
        return self._has_exit and self._road.misses_exit(scene.affordances.lane, front_m(scene))

    def _passed(self, scene: Scene) -> str:
        """Return the outcome that follows from the ego's position alone; "" if none does."""
        if front_m(scene) < self._end_m:
            return ""
        if not self._has_exit:
            return MERGED
        return EXIT_TAKEN if scene.affordances.lane <= self._exit_lane else EXIT_MISSED


def front_m(scene: Scene) -> float:
    """Return the position of the ego's front bumper along the road, m."""
    snapshot = scene.snapshot
    return float(snapshot.s_m[EGO] + snapshot.length_m[EGO] / 2)
