"""The vehicles of an episode: those at the start, and those that enter and leave an open road."""

import math
from collections.abc import Collection, Iterator, Sequence
from copy import copy, deepcopy
from dataclasses import replace
from itertools import chain, islice, repeat

import numpy as np
import numpy.typing as npt

from drl_av.arrays import BoolArray, FloatArray, IntArray
from drl_av.config import Config
from drl_av.config.traffic import SUMO_ALONE
from drl_av.errors import ConfigError, ScenarioError
from drl_av.road.road import CENTERED_M, LANE_CHANGE_S
from drl_av.road.snapshot import EGO, EGO_ID
from drl_av.scenarios.custom_vehicle_types import draw_types
from drl_av.scenarios.folder import Scenario
from drl_av.scenarios.highways import require_reachable
from drl_av.scenarios.layout import OpenStart
from drl_av.simulation.inflow import (
    Inflow,
    Last,
    draw_open_population,
    last_vehicles,
    open_capacity,
    vehicles_of_flow,
)
from drl_av.simulation.population import (
    Population,
    capacity,
    draw_driver_models,
    draw_population,
    placed_population,
    random_lane_changes,
    require_speed_limit,
    require_truck_width,
    safe_speeds,
)


class Fleet:
    """The vehicles that are on the road now; index 0 of each array is the ego.

    Raises:
        ConfigError: the settings allow vehicles that are too fast or too wide for the road, or
            other drivers than SUMO's on an open road.
        ScenarioError: the ego cannot reach its exit with these settings, or the inflow corresponds
            to more vehicles than may start on the road.
    """

    population: Population
    """The vehicles at the start of the episode."""
    ids: tuple[str, ...]
    driver_models: npt.NDArray[np.intp]
    """The ``DriverModel`` of each vehicle."""
    type_ids: Sequence[str]
    """The id of the vehicle type of each vehicle."""
    length_m: FloatArray
    width_m: FloatArray
    rng: np.random.Generator
    """What draws the random lane changes of the episode."""
    chance: float
    """The probability that a vehicle requests one at a decision."""

    def __init__(self, scenario: Scenario, config: Config) -> None:
        require_speed_limit(config, scenario.description, bool(scenario.road.speed_limits))
        require_truck_width(config, scenario.description)
        self.scenario, self.config, self._start = scenario, config, scenario.layout.start
        self._road, self._size_of = scenario.road, scenario.vehicle_types.by_id
        if self._start is not None and sum(config.traffic.shares) > 0:
            raise ConfigError(SUMO_ALONE)
        if scenario.road.forbidden_lines and config.ego.lane_change_duration_s > LANE_CHANGE_S:
            raise ConfigError(
                f"ego.lane_change_duration_s is {config.ego.lane_change_duration_s:g}, but on a "
                f"road with lines that may not be crossed it must be at most {LANE_CHANGE_S:g}."
            )
        if self._start is not None and self.placed is None:
            require_reachable(scenario.road, self._start, config.ego)
            self._require_room(self._start)

    def _require_room(self, start: OpenStart) -> None:
        """Raise ScenarioError if the inflow means more vehicles than may start on an open road."""
        usual = vehicles_of_flow(start, self.config.traffic)
        if usual > self.capacity:
            flow_per_h = start.flow_per_h * self.capacity // usual
            raise ScenarioError(
                f"The scenario's flow_per_h, {start.flow_per_h:g}, means {usual} vehicles on its "
                f"road, but at most {self.capacity} may start there: write one with flow_per_h up "
                f"to {flow_per_h:g}, or a shorter road, or raise traffic.desired_speed_min_m_s."
            )

    @property
    def capacity(self) -> int:
        """Largest number of vehicles besides the ego that may start at random positions."""
        traffic = self.config.traffic
        length_m = traffic.longest_m(self.scenario.description.vehicle_length_m)
        if self._start is not None:
            return open_capacity(self._start, length_m, traffic.start_gap_m) - 1
        return capacity(self._road, length_m, traffic.start_gap_m) - 1

    @property
    def placed(self) -> int | None:
        """Number of vehicles besides the ego that the scenario places; None if it places none."""
        placed = self.scenario.description.vehicles
        return len(placed) - 1 if placed else None

    @property
    def default_vehicle_count(self) -> int | None:
        """Default number of vehicles besides the ego at the start, or None if there is no default.

        If the scenario places its vehicles, it is their number. Otherwise, a loop has no default,
        and on an open road it is the number that corresponds to the inflow. If an episode there has
        another number of vehicles, its inflow changes in proportion.
        """
        if self._start is None or self.placed is not None:
            return self.placed
        return vehicles_of_flow(self._start, self.config.traffic)

    @property
    def most_in_training(self) -> int | None:
        """Most other vehicles at the start of an episode of a training on an open road.

        It is twice the default number, as far as there is room, so that a driver learns in every
        density (ours). None on a loop, where the settings say how many, and where the scenario
        places its vehicles.
        """
        if self._start is None or self.placed is not None:
            return None
        return min(2 * vehicles_of_flow(self._start, self.config.traffic), self.capacity)

    def draw(self, seed: int, vehicles: int) -> None:
        """Draw the vehicles of an episode from its seed: the ego and ``vehicles`` others.

        If the scenario places its vehicles, these are used, and ``vehicles`` has no effect.

        Raises:
            ScenarioError: the vehicles do not fit on the road, or the placed ones lack the ego.
        """
        rng, description = np.random.default_rng(seed), self.scenario.description
        config, length_m, start = self.config, description.vehicle_length_m, self._start
        self._inflow, self._entered = None, list[Population]()
        self._types: Iterator[str] = chain(["ego"], repeat("traffic"))
        if description.vehicle_types:
            self._types = draw_types(seed, description.vehicle_types)
        self._timed_changes = [
            (time_s, vehicle.id, to)
            for vehicle in description.vehicles
            for time_s, to in vehicle.lane_changes
        ]
        if description.vehicles:
            self._describe(placed_population(description.vehicles, config.traffic))
        elif start is None:
            self._describe(draw_population(rng, vehicles, self._road, length_m, config))
        else:
            self._describe(draw_open_population(rng, vehicles, start, length_m, config))
            self._inflow = Inflow(rng.spawn(1)[0], vehicles, start, length_m, config)
        rate = config.traffic.random_lane_changes_per_s * config.simulation.decision_interval_s
        self.rng, self.chance = rng, rate
        if self._inflow is None:
            self._lane_changes = random_lane_changes(rng, len(self.ids), rate)
        self.driver_models = draw_driver_models(seed, len(self.ids), config.traffic)

    def _random_lane_changes(self) -> list[tuple[int, int]]:
        """Return random lane changes, like those of ``population``, of the present vehicles."""
        draws = self.rng.random((2, len(self.ids)))
        rows = np.flatnonzero(draws[0] < self.chance).tolist()
        return [(row, 1 if draws[1, row] < 0.5 else -1) for row in rows if row != EGO]

    @property
    def present(self) -> Population:
        """The vehicles that are on the road now, as they were when they started."""
        known = self.population.joined(self._entered)
        row_of = {name: row for row, name in enumerate(known.ids)}
        return known.rows([row_of[name] for name in self.ids])

    def copied(self, rng: np.random.Generator | None, time_s: float) -> "Fleet":
        """Return a copy of a fleet on an open road, without vehicle types of the user.

        What happens after ``time_s`` is drawn with ``rng``, or as in the original if it is None.
        """
        fleet = copy(self)
        fleet._entered, fleet._types = [*self._entered], repeat("traffic")
        fleet.rng = deepcopy(self.rng) if rng is None else rng
        if self._inflow is not None:
            inflow_rng = None if rng is None else rng.spawn(1)[0]
            fleet._inflow = self._inflow.copied(inflow_rng, time_s)
        return fleet

    def lane_changes(
        self, time_s: float, y_m: Sequence[float] | FloatArray
    ) -> list[tuple[int, int]]:
        """Return the lane changes of the next decision, as pairs (row, number of lanes).

        A row is the index of a vehicle in ``ids``. The number of lanes is positive to the left.
        The result holds random lane changes, and the scenario's lane changes that are due at
        ``time_s``, seconds since the reset. ``y_m`` is the lateral position of each vehicle,
        metres, the ego's first. Call this once for each decision: it draws random numbers, and
        returns each lane change of the scenario only once.
        """
        changes = self._random_lane_changes() if self._inflow else next(self._lane_changes)
        if changes and self._start is not None:
            changes = self._on_open_road(changes, y_m, self._start.lanes)
        changes = [(row, side) for row, side in changes if self._is_centered(y_m[row])]
        if not self._timed_changes:
            return changes
        due = [(name, to) for at_s, name, to in self._timed_changes if at_s <= time_s]
        self._timed_changes = [each for each in self._timed_changes if each[0] > time_s]
        ids, lane_of = self.ids, self._road.lane_of
        rows = [(ids.index(name), to) for name, to in due if name in ids]
        set_changes = [(row, to - lane_of(y_m[row])) for row, to in rows]
        return [*changes, *(each for each in set_changes if each[1])]

    def _is_centered(self, y_m: float) -> bool:
        """Return whether a vehicle may get a random request: not in the middle of a lane change.

        SUMO would continue the lane change into the next lane, even into a vehicle beside it.
        """
        return abs(y_m - self._road.center_m(self._road.lane_of(y_m))) <= CENTERED_M

    def _on_open_road(
        self,
        changes: list[tuple[int, int]],
        y_m: Sequence[float] | FloatArray,
        lanes: Collection[int],
    ) -> list[tuple[int, int]]:
        """Return the random lane changes, by row and side, that lead to one of ``lanes``."""
        if self._inflow is None:  # drawn for the vehicles at the start, some of which have left
            named = [(self.population.ids[row], side) for row, side in changes]
            changes = [(self.ids.index(name), side) for name, side in named if name in self.ids]
        lane_of = self._road.lane_of
        return [(row, side) for row, side in changes if lane_of(y_m[row]) + side in lanes]

    def update_open_road(
        self, time_s: float, s_m: FloatArray, y_m: FloatArray, speed_m_s: FloatArray
    ) -> tuple[IntArray, Population | None] | None:
        """Remove the vehicles that have left an open road, and add those that enter it now.

        ``time_s`` is the time since the reset; the arrays, shape (1 + N,), hold the state of each
        vehicle.

        Returns:
            The previous row indices of the vehicles that stay, and the vehicles that enter or None.
            The new rows are those that stay, in this order, and then those that enter. The result
            is None if no vehicle enters or leaves.
        """
        start, inflow = self._start, self._inflow
        if start is None:
            return None
        stays = s_m < start.span_m
        stays[EGO] = True
        kept, entering = stays.nonzero()[0], None
        if inflow is not None and inflow.is_due(time_s):
            last = np.empty(len(self._road.open_lanes), np.int64)
            bodies = self.length_m, self.width_m, self._road.lane_width_m
            last_vehicles.fast(kept, s_m, y_m, *bodies, last)
            behind = {
                lane: Last(float(s_m[row] - self.length_m[row] / 2), float(speed_m_s[row]))
                for lane, row in enumerate(last.tolist())
                if row >= 0
            }
            entering = inflow.entering(time_s, behind)
        if entering is None and len(kept) == len(s_m):
            return None
        rows = kept.tolist()
        self.ids = (*map(self.ids.__getitem__, rows),)
        self.type_ids = [*map(self.type_ids.__getitem__, rows)]
        self.length_m, self.width_m = self.length_m[kept], self.width_m[kept]
        if entering is not None:
            entering = self._enter(entering)
        self.driver_models = np.zeros(len(self.ids), dtype=np.intp)
        return kept, entering

    def _enter(self, entering: Population) -> Population:
        """Add vehicles behind the others; return them with what their types state."""
        types, entering = self._with_types(entering)
        length_m, width_m = self._sizes_m(types, entering.is_truck)
        entering = self._with_stated(entering, types, length_m)
        self.ids, self.type_ids = (*self.ids, *entering.ids), [*self.type_ids, *types]
        self.length_m = np.concatenate((self.length_m, length_m))
        self.width_m = np.concatenate((self.width_m, width_m))
        self._entered.append(entering)
        return entering

    def _describe(self, population: Population) -> None:
        """Set the vehicles at the start of an episode, their types and their sizes."""
        self.ids = population.ids
        self.type_ids, population = self._with_types(population)
        self.length_m, self.width_m = self._sizes_m(self.type_ids, population.is_truck)
        self.population = self._with_stated(population, self.type_ids, self.length_m)

    def _with_types(self, population: Population) -> tuple[list[str], Population]:
        """Draw the types of vehicles; those of the user's types are not trucks of ``traffic``."""
        types = [*islice(self._types, len(population.ids))]
        is_truck = population.is_truck & np.array([name == "traffic" for name in types])
        return types, replace(population, is_truck=is_truck)

    def _with_stated(
        self, population: Population, type_ids: Sequence[str], length_m: FloatArray
    ) -> Population:
        """Return a population whose vehicles have what the user's own types state for them.

        ``type_ids`` and ``length_m`` have one entry for each row. Each vehicle is then slow enough
        at the start for its own parameters and for the vehicle ahead.
        """
        own = {each.id: each.stated for each in self.scenario.description.vehicle_types}
        stated = [own.get(name, {}) for name in type_ids]
        if not any(stated):
            return population
        desired, headway = population.desired_speed_m_s.copy(), population.headway_s.copy()
        acceleration, gain = population.acceleration_m_s2.copy(), population.speed_gain.copy()
        for row, values in enumerate(stated):
            desired[row] = min(desired[row], values.get("top_speed_m_s", math.inf))
            headway[row] = values.get("headway_s", headway[row])
            acceleration[row] = values.get("acceleration_m_s2", acceleration[row])
            gain[row] = values.get("speed_gain", gain[row])
        rows = np.arange(len(desired))
        ahead_m = (population.front_m - population.front_m[:, None]) % self._road.lap_m
        ahead_m[(population.lane != population.lane[:, None]) | np.eye(len(rows), dtype=bool)] = (
            math.inf
        )
        leader = ahead_m.argmin(axis=1)
        gap_m = np.maximum(ahead_m[rows, leader] - length_m[leader], 0.0)
        speed = np.minimum(population.speed_m_s, safe_speeds(desired, headway, gap_m, leader))
        if population.ids[0] == EGO_ID:
            speed[0] = population.speed_m_s[0]
        return replace(
            population,
            speed_m_s=speed,
            desired_speed_m_s=desired,
            headway_s=headway,
            acceleration_m_s2=acceleration,
            speed_gain=gain,
        )

    def _sizes_m(
        self, type_ids: Sequence[str], is_truck: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lengths and the widths of vehicles, metres, each of shape (n,)."""
        types, traffic = [self._size_of[name] for name in type_ids], self.config.traffic
        length_m = np.where(is_truck, traffic.truck_length_m, [each.length_m for each in types])
        return length_m, np.where(is_truck, traffic.truck_width_m, [each.width_m for each in types])
