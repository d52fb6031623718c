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
from drl_av.simulation.population import Population
from drl_av.twin.commands import REQUEST_STEPS, request_change
from drl_av.twin.following import STEP_S
from drl_av.twin.traffic import Drawn, add_vehicles, keep_vehicles, sort_and_activate
from drl_av.twin.worlds import COUNT, EDGE_BEGIN, EDGE_LENGTH, FRONT_M, STEP, FloatArray, Net, World

NO_EVENTS = np.empty((0, 3), np.int64)


def request_random_changes(world: World, net: Net, fleet: Fleet, y_m: FloatArray) -> None:
    """Request the random lane changes of the next decision; ``y_m`` is each vehicle's."""
    for row, side in fleet.lane_changes(0.0, y_m):
        request_change(world, net, row, side, REQUEST_STEPS)


def leaving_and_entering(
    world: World, fleet: Fleet, scene: FloatArray
) -> tuple[Sequence[int], Sequence[Population]] | None:
    """Return what ``Fleet.update_open_road`` returns after a decision in a world."""
    state, time_s = scene[:3, : len(fleet.ids)].tolist(), float(world.near[STEP] * STEP_S)
    return fleet.update_open_road(time_s, *state)


def exchange_vehicles(
    world: World, net: Net, fleet: Fleet, kept: Sequence[int], entering: Sequence[Population]
) -> None:
    """Remove the vehicles that have left an open road, and add those that enter it.

    As in SUMO, those that have left drive on to the end of the road, in the rows behind the others.
    """
    end_m = net.edges_m[EDGE_BEGIN, -1] + net.edges_m[EDGE_LENGTH, -1]
    left = sorted({*range(world.near[COUNT])} - {*kept})
    left = [row for row in left if world.x[FRONT_M, row] < end_m]
    rows = [*kept, *left]
    if rows != [*range(world.near[COUNT])]:
        keep_vehicles(world, rows)
    if entering:
        models = np.zeros(len(entering), np.int64)
        together = entering[0].joined(entering[1:])
        add_vehicles(world, net, together, models, fleet.scenario, fleet.config)
    if left and entering:
        present = [*range(world.near[COUNT])]
        gone = slice(len(kept), len(rows))
        keep_vehicles(world, present[: gone.start] + present[gone.stop :] + present[gone])
    sort_and_activate(world, net)


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

    def draw(self, row: int, seed: int, vehicles: int, kinds: Sequence[Config]) -> Drawn:
        """Draw the traffic of an episode in a world, as ``draw_traffic`` does on a loop."""
        config = kinds[kind_of_traffic(seed, len(kinds))]
        fleet = self.fleets[row] = Fleet(self._scenario, config)
        fleet.draw(seed, vehicles)
        return Drawn(config, fleet.population, fleet.driver_models, NO_EVENTS)

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
