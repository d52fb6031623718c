"""The arrays of many worlds of the twin: the worlds decide, and their scenes are read."""

import os
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.arrays import FloatArray, IntArray
from drl_av.config import Config
from drl_av.driving.affordances import Indicators, ground_of
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.transition import RouteOutcome
from drl_av.env.twin_episodes import decide_all, empty_episodes, look_all, task_of
from drl_av.random_streams import Stream, generator, kind_of_traffic
from drl_av.road.snapshot import EGO_ID, Snapshot
from drl_av.road.sweep import NO_CONTACT
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.population import ARRAYS, Population
from drl_av.twin.commands import REQUEST_STEPS, request_change
from drl_av.twin.following import STEP_S
from drl_av.twin.traffic import draw_events, exchange, place_vehicles, sizes_of
from drl_av.twin.worlds import COUNT, STEP, Net, World, empty_worlds

NO_EVENTS = np.empty((0, 3), np.int64)


class Begun(NamedTuple):
    """The start of an episode of a world."""

    generator: np.random.Generator
    """What draws the next seed."""
    seed: int
    fleet: Fleet
    """Its vehicles, on an open road with the inflow."""
    events: IntArray
    """What happens at random on a loop, as in ``draw_events``."""


class WorldArrays:
    """The worlds of a config, whose episodes the vector environment begins.

    Raises:
        ConfigError: the twin cannot do what the settings ask.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        self._scenario = load_scenario(find_scenario(config.simulation.scenario))
        self.road = self._scenario.road
        self.task = task_of(self._scenario, config)
        self._fleets = [Fleet(self._scenario, kind) for kind in config.per_traffic_preset]

    def _make_worlds(self, count: int, threads: int) -> None:
        """Make what there is once a world, besides the arrays."""
        self.num_envs = count
        self.seeds = np.full(count, -1)
        """The traffic seed of each world's episode."""
        self.vehicles = np.zeros(count, np.int64)
        """The vehicles besides the ego in each world."""
        self.kept: dict[int, IntArray] = {}
        """The former rows of the vehicles that stay, by world, where some have entered or left."""
        self.fleets: dict[int, Fleet] = {}
        """The vehicles of each world, on an open road."""
        self.routes: dict[int, RouteOutcome] = {}
        """What finds the outcome of each ego's route, on an open road."""
        self.ways = np.full(count, "", dtype=object)
        """The outcome of each ego's route."""
        self.collided_with = np.full(count, "", dtype=object)
        """The name of the vehicle with which each ego has collided in its episode, or ""."""
        self._make_pool(max(1, min(threads, count, os.cpu_count() or 1)))

    def _make_arrays(self, vehicles: int, events: int) -> None:
        """Make the arrays of all worlds for so many vehicles and events in one."""
        worlds, steps = self.num_envs, self.config.simulation.steps_per_decision
        self.worlds = empty_worlds(worlds, vehicles, self.task.net.lanes)
        self.episodes = empty_episodes(worlds, vehicles, steps, events)

    def scene(self, row: int) -> Scene:
        """Return the present scene of a world, which a driver or a check can read."""
        ids, episodes = self._ids(row), self.episodes
        now_s = float(self.worlds.near[row, STEP] * STEP_S)
        snapshot = Snapshot(now_s, ids, *episodes.scene[row, :, : len(ids)].copy())
        found = self._indicators(row)
        origin, target = episodes.lanes[row].tolist()
        change = LaneChange(origin, target, float(episodes.heading_rad[row]))
        return Scene(snapshot, found, None if origin == target else change, self.road)

    def _indicators(self, row: int) -> Indicators:
        """Return the indicators of the present scene of a world."""
        task, values, codes = self.task, self.episodes.values[row], self.episodes.codes[row]
        ground = ground_of(task.road), task.range_m, task.road.speed_limits
        return Indicators(values.copy(), codes.copy(), *ground)

    def _ids(self, row: int) -> tuple[str, ...]:
        """Return the names of the vehicles in a world."""
        if not self.road.is_loop:
            return self.fleets[row].ids
        return EGO_ID, *(f"vehicle{number}" for number in range(1, self.worlds.near[row, COUNT]))

    def fleet_of(self, seed: int) -> Fleet:
        """Return the vehicles of the kind of traffic of an episode, by its traffic seed."""
        return kind_of_traffic(seed, self._fleets)

    def _draw(self, seed: int, vehicles: int) -> tuple[Fleet, IntArray]:
        """Draw the fleet and the events of an episode, as ``Begun`` has them.

        Raises ScenarioError if the vehicles do not fit on the road.
        """
        fleet = copy(self.fleet_of(seed))
        fleet.draw(seed, vehicles)
        if not self.road.is_loop:
            return fleet, NO_EVENTS
        return fleet, draw_events(seed, fleet, self.config.simulation.decisions_per_episode)

    def _place(self, row: int, begun: Begun) -> None:
        """Place the vehicles of an episode in a world."""
        fleet = begun.fleet
        self.vehicles[row] = len(fleet.ids) - 1
        if not self.road.is_loop:
            self.fleets[row] = fleet
        of_it = fleet.population, fleet.driver_models, self._scenario, fleet.config
        place_vehicles(self.world(row), self.task.net, *of_it)
        self._set_events(row, begun.events)

    def _set_events(self, row: int, events: IntArray) -> None:
        """Set the random events of a world that are to come."""
        self.make_room(0, len(events))
        self.episodes.events[row, : len(events)] = events
        self.episodes.next_event[row] = 0, len(events)

    def make_room(self, vehicles: int, events: int) -> None:
        """Enlarge the arrays if they have no room for so many vehicles and events in a world."""
        room = self.worlds.x.shape[2], self.episodes.events.shape[1]
        if vehicles <= room[0] and events <= room[1]:
            return
        old_worlds, old_episodes = self.worlds, self.episodes
        self._make_arrays(max(vehicles, room[0]), max(events, room[1]))
        old: tuple[Any, ...] = (*old_worlds, *old_episodes)
        new: tuple[Any, ...] = (*self.worlds, *self.episodes)
        for before, after in zip(old, new, strict=True):
            after[tuple(map(slice, before.shape))] = before

    def world(self, row: int) -> World:
        """Return the arrays of one world."""
        x, z, notes, near = self.worlds
        return World(x[row], z[row], notes[row], near[row])

    def _decide(self, rows: npt.NDArray[np.intp], proposed: IntArray) -> None:
        """Execute the decisions of the worlds ``rows``, on an open road with its inflow."""
        net, fleets, on_open_road = self.task.net, self.fleets, not self.road.is_loop
        for row in rows.tolist() if on_open_road else ():
            for vehicle, side in fleets[row].lane_changes(0.0, self.episodes.scene[row, 1]):
                request_change(self.world(row), net, vehicle, side, REQUEST_STEPS)
        self._decide_all(rows, proposed)
        self.collided_with = self._struck(rows)
        if not on_open_road:
            return
        self.kept.clear()
        for row in rows.tolist():
            exchanged = leaving_and_entering(self.world(row), fleets[row], self.episodes.scene[row])
            if exchanged is not None:
                self.make_room(
                    int(self.worlds.near[row, COUNT])
                    + len(exchanged[1].ids if exchanged[1] else ()),
                    0,
                )
                exchange_vehicles(self.world(row), net, fleets[row], *exchanged)
                self.vehicles[row] = len(fleets[row].ids) - 1
                self.kept[row] = exchanged[0]
        look_all(self.worlds, self.episodes, self.task, np.array([*self.kept], np.int64))

    def _take_traffic(self, of: "WorldArrays", row: int, seed: int | None) -> None:
        """Let a world of ``of``, on an open road, go on in each world.

        What happens in world i is drawn with ``seed`` + i; without ``seed`` it happens as there.
        """
        now_s = float(of.worlds.near[row, STEP] * STEP_S)
        for i in range(self.num_envs):
            drawn = None if seed is None else generator(seed + i, Stream.FORKS)
            self.fleets[i] = of.fleets[row].copied(drawn, now_s)
            self.routes[i] = copy(of.routes[row])

    def _struck(self, rows: npt.NDArray[np.intp]) -> npt.NDArray[Any]:
        """Return ``collided_with`` after a decision of ``rows``, before any vehicle leaves."""
        kind, other = self.episodes.collision.T
        names, hits = self.collided_with.copy(), (kind != NO_CONTACT) & (other > 0)
        names[rows] = ""
        for row in rows[hits[rows]].tolist():
            names[row] = self._ids(row)[other[row]]
        return names

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy has: all but the threads, of which it makes its own."""
        return vars(self) | {"_pool": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._make_pool(self._chunks)

    def _make_pool(self, threads: int) -> None:
        """Make the threads among which the worlds are divided."""
        self._chunks = threads
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def _decide_all(self, rows: npt.NDArray[np.intp], proposed: IntArray) -> None:
        """Execute the decisions of the worlds ``rows``, divided over the threads."""
        given = self.worlds, self.episodes, self.task
        if self._pool is None or len(rows) < 2 * self._chunks:
            decide_all.fast(*given, rows.astype(np.int64), proposed)
            return
        parts = np.array_split(rows.astype(np.int64), self._chunks)
        jobs = [self._pool.submit(decide_all.fast, *given, part, proposed) for part in parts]
        for job in jobs:
            job.result()


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
