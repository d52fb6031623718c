"""Worlds of an open road: the vehicles that enter and leave them, and the routes of the egos."""

from collections.abc import Sequence
from copy import copy

import numpy as np

from drl_av.config import Config
from drl_av.driving.affordances import Indicators
from drl_av.env.route_outcome import RouteOutcome
from drl_av.random_streams import Stream, generator, kind_of_traffic
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.population import ARRAYS, Population
from drl_av.twin.following import STEP_S
from drl_av.twin.traffic import Drawn, exchange, sizes_of
from drl_av.twin.worlds import STEP, FloatArray, IntArray, Net, World

NO_EVENTS = np.empty((0, 3), np.int64)


def leaving_and_entering(
    world: World, fleet: Fleet, scene: FloatArray
) -> tuple[IntArray, Population | None] | None:
    """Return what ``Fleet.update_open_road`` returns after a decision in a world."""
    return fleet.update_open_road(float(world.near[STEP] * STEP_S), *scene[:3, : len(fleet.ids)])


def exchange_vehicles(
    world: World, net: Net, fleet: Fleet, kept: IntArray, entering: Population | None
) -> None:
    """Remove the vehicles that have left an open road, and add those that enter it."""
    models = np.zeros(0 if entering is None else len(entering.ids), np.int64)
    sizes_m = sizes_of(fleet.scenario, fleet.config)
    exchange.fast(world, net, kept, ARRAYS(entering or fleet.population), models, sizes_m)


class OpenWorlds:
    """The traffic of the worlds of an open road, and the routes of their egos."""

    def __init__(self, scenario: Scenario, config: Config) -> None:
        self._scenario = scenario
        self.routes: dict[int, RouteOutcome] = {}
        """The outcome of each ego's route."""
        self.fleets: dict[int, Fleet] = {}
        """The vehicles of each world."""
        usual = Fleet(scenario, config)
        self.default_vehicle_count = usual.default_vehicle_count
        self.most_in_training = usual.most_in_training

    def misses_exit(self, row: int, now: Indicators) -> bool:
        """Return whether the ego of a world has passed its exit without taking it."""
        return self.routes[row].misses_exit(now)

    def draw(self, seed: int, vehicles: int, kinds: Sequence[Config]) -> tuple[Drawn, Fleet]:
        """Draw the traffic of an episode, as ``draw_traffic`` does on a loop."""
        config = kinds[kind_of_traffic(seed, len(kinds))]
        fleet = Fleet(self._scenario, config)
        fleet.draw(seed, vehicles)
        return Drawn(config, fleet.population, fleet.driver_models, NO_EVENTS), fleet

    def copied(self, row: int, count: int, seed: int | None, time_s: float) -> "OpenWorlds":
        """Return ``count`` copies of a world; what happens in copy i is drawn with ``seed`` + i.

        Without ``seed`` it happens as in the original.
        """
        worlds = copy(self)
        worlds.fleets = {
            number: self.fleets[row].copied(
                None if seed is None else generator(seed + number, Stream.FORKS), time_s
            )
            for number in range(count)
        }
        worlds.routes = {number: copy(self.routes[row]) for number in range(count)}
        return worlds

    def begin(self, row: int, start: Indicators) -> None:
        """Begin the route of the ego in a world, whose first indicators are ``start``."""
        self.routes[row] = RouteOutcome(self._scenario.road, start)

    def way(self, row: int, now: Indicators, over: bool) -> str:
        """Return the outcome of the ego's route in a world after a decision."""
        return self.routes[row].outcome(now, over)
