"""The vehicles of an open road: those at the start of an episode, and those that enter it later."""

import math
from collections.abc import Mapping
from copy import copy, deepcopy
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing
from drl_av.config import Config, TrafficConfig
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ScenarioError, pluralize
from drl_av.road.road import allowed_speed, lane_of
from drl_av.scenarios.layout import OpenStart
from drl_av.scenarios.road_description import MOST_VEHICLES
from drl_av.simulation.population import (
    COMFORTABLE_BRAKING_M_S2,
    Population,
    draw_drivers,
    draw_trucks,
    ring_places,
    with_drivers,
)

START_STEP_S = 1.0
"""A vehicle starts slow enough to begin to brake for a speed limit this much later, seconds."""
SUPPLY = 64
"""Number of entering vehicles whose parameters are drawn at once."""


def flow_speed(start: OpenStart, traffic: TrafficConfig) -> float:
    """Return the mean speed of the traffic on an open road, m/s (an assumption).

    It relates the flow in a lane to the density: flow = speed x density. Vehicles follow the
    slowest one of their lane. The speed on each part of the road is therefore the lowest desired
    speed, but at least 1 m/s, or the speed limit of this part if that is lower. The mean is the
    length of the road divided by the travel time.
    """
    wanted_m_s = max(traffic.desired_speed_min_m_s, 1.0)
    if not start.speed_limits:
        return wanted_m_s
    return start.span_m / start.travel_s(0.0, start.span_m, wanted_m_s)


def vehicles_of_flow(start: OpenStart, traffic: TrafficConfig) -> int:
    """Return the number of vehicles besides the ego that corresponds to an open road's inflow."""
    per_m = start.flow_per_h / 3600 / flow_speed(start, traffic)
    return round(per_m * start.span_m * len(start.lanes))


def draw_open_population(
    rng: np.random.Generator, vehicles: int, start: OpenStart, length_m: float, config: Config
) -> Population:
    """Draw the ego and ``vehicles`` others on an open road, with random parameters.

    The vehicles are spread evenly over the lanes, at random positions. Cars are ``length_m`` long.

    Raises:
        ScenarioError: there are more vehicles than may start on the road.
    """
    n, traffic = vehicles + 1, config.traffic
    room = open_capacity(start, traffic.longest_m(length_m), traffic.start_gap_m)
    if n > room:
        raise ScenarioError(
            f"This road takes {pluralize(max(room - 1, 0), 'vehicle')} besides the ego on its "
            f"{pluralize(len(start.lanes), 'lane')}, not {vehicles}: ask for fewer."
        )
    streams = rng.spawn(2)
    is_truck = draw_trucks(streams[1], n, traffic)
    lane = np.array(start.lanes)[rng.permutation(n) % len(start.lanes)]
    if start.ego_lane is not None:
        lane[0] = start.ego_lane
    pitch_m = np.where(is_truck, traffic.truck_length_m, length_m) + traffic.start_gap_m
    first_m = traffic.longest_m(length_m)  # so that the rear of each vehicle is on the road too
    ring_m = start.span_m - first_m
    places = ring_places(rng, lane, ring_m, pitch_m, traffic.start_gap_m)
    from_ego_m = places.front_m - places.front_m[0]
    front_m = (from_ego_m + start.ego_front_m - first_m) % ring_m + first_m
    places = places._replace(front_m=front_m)
    population = with_drivers(rng, streams, places, is_truck, config)
    for row, at_m in enumerate(front_m.tolist() if start.speed_limits else ()):
        allowed = allowed_speed(start.speed_limits, at_m, START_STEP_S)
        population.speed_m_s[row] = min(population.speed_m_s[row], allowed)
    if start.ego_speed_m_s is not None:
        population.speed_m_s[0] = min(start.ego_speed_m_s, config.ego.max_speed_m_s)
    return population


def open_capacity(start: OpenStart, length_m: float, start_gap_m: float) -> int:
    """Return the largest number of vehicles, the ego included, that may start on an open road.

    The vehicles are dealt evenly to the lanes. An ego that must start in one of these lanes may
    then be one more in it. ``length_m`` is the length of the longest vehicle.
    """
    each_lane = int((start.span_m - length_m) // (length_m + start_gap_m))
    each_lane -= start.ego_lane in start.lanes
    return min(len(start.lanes) * max(each_lane, 0), MOST_VEHICLES)


class Last(NamedTuple):
    """The last vehicle in a lane, behind which the next vehicle enters."""

    rear_m: float
    """Position of its rear bumper; inf if there is no vehicle in the lane."""
    speed_m_s: float


class Driver(NamedTuple):
    """How a vehicle that will enter is driven, as in a ``Population``, in the order there."""

    desired_speed_m_s: float
    headway_s: float
    acceleration_m_s2: float
    speed_gain: float
    is_truck: bool


@borrowing
def last_vehicles(
    rows: IntArray,
    s_m: FloatArray,
    y_m: FloatArray,
    length_m: FloatArray,
    width_m: FloatArray,
    lane_width_m: float,
    last: IntArray,
) -> None:
    """Fill ``last``, shape (lanes,), with the row of the last vehicle in each lane, or -1.

    A body may be in two lanes. ``rows`` are the vehicles that count; the other arrays, shape
    (1 + N,), hold the position, the lateral one, the length and the width of each vehicle.
    """
    last[:] = -1
    for row in rows:
        rear_m, half_m = s_m[row] - length_m[row] / 2, width_m[row] / 2
        for y in (y_m[row] - half_m, y_m[row] + half_m):
            lane = lane_of(y, lane_width_m)
            if 0 <= lane < len(last):
                other = last[lane]
                if other < 0 or rear_m < s_m[other] - length_m[other] / 2:
                    last[lane] = row


class Inflow:
    """The vehicles that enter an open road during an episode, drawn from its seed.

    In each lane the time between two entries has a shifted exponential distribution. Its mean is
    chosen so that the number of vehicles on the road stays about constant. If there is no
    room at the time of an entry, the vehicle waits and enters as soon as there is.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        vehicles: int,
        start: OpenStart,
        length_m: float,
        config: Config,
    ) -> None:
        traffic = config.traffic
        self._rng, self._config = rng, config
        self._length_m, self._lanes = length_m, start.lanes
        self._limit_m_s = allowed_speed(start.speed_limits, 0.0, START_STEP_S)
        speed_m_s = flow_speed(start, traffic)
        self._shortest_s = (traffic.longest_m(length_m) + traffic.start_gap_m) / speed_m_s
        per_s = vehicles / start.span_m / len(start.lanes) * speed_m_s
        self._mean_s = 1 / per_s if per_s else np.inf
        self._entered = vehicles
        self._supply = list[Driver]()
        self._waiting: dict[int, Driver] = {}
        self._due_s = {lane: rng.random() * self._headway_s() for lane in start.lanes}

    def _headway_s(self) -> float:
        """Draw the time between two entries in a lane, seconds."""
        spare_s = max(self._mean_s - self._shortest_s, 0.0)
        return self._shortest_s + (
            self._rng.exponential() * spare_s if spare_s < np.inf else spare_s
        )

    def is_due(self, time_s: float) -> bool:
        """Return whether a vehicle enters at ``time_s`` if there is room for it."""
        return min(self._due_s.values()) <= time_s

    def entering(self, time_s: float, last: Mapping[int, Last]) -> Population | None:
        """Return the vehicles that enter at ``time_s``, or None.

        ``last`` holds the last vehicle of each lane, by lane index; a lane without vehicles is
        missing.
        """
        due = (lane for lane in self._lanes if self._due_s[lane] <= time_s)
        placed = (self._placed(lane, last.get(lane, Last(np.inf, 0.0))) for lane in due)
        entering = [one for one in placed if one is not None]
        if not entering:
            return None
        lane, front_m, speed, drivers = zip(*entering, strict=True)
        first = self._entered + 1
        self._entered += len(entering)
        return Population(
            tuple(f"vehicle{number}" for number in range(first, self._entered + 1)),
            *map(np.array, (lane, front_m, speed, *zip(*drivers, strict=True))),
        )

    def _placed(self, lane: int, last: Last) -> tuple[int, float, float, Driver] | None:
        """Let the next vehicle of a lane enter, or return None if there is no room for it.

        Returns:
            The lane, the position of its front, its speed and its driver.
        """
        driver = self._waiting.get(lane)
        if driver is None:
            self._supply = self._supply or self._drawn()
            driver = self._waiting[lane] = self._supply.pop()
        front_m = self._config.traffic.truck_length_m if driver.is_truck else self._length_m
        gap_m = last.rear_m - front_m
        if gap_m < self._config.traffic.start_gap_m:
            return None
        wanted = min(driver.desired_speed_m_s, self._limit_m_s)
        speed = safe_speed(wanted, driver.headway_s, gap_m, last.speed_m_s)
        if speed < min(last.speed_m_s, wanted) - 1e-9:
            return None
        del self._waiting[lane]
        self._due_s[lane] += self._headway_s()
        return lane, front_m, speed, driver

    def copied(self, rng: np.random.Generator | None, time_s: float) -> "Inflow":
        """Return a copy, whose vehicles after ``time_s`` are drawn with ``rng`` if it is given."""
        inflow = copy(self)
        inflow._waiting, inflow._due_s = dict(self._waiting), dict(self._due_s)
        inflow._supply = [*self._supply]
        inflow._rng = deepcopy(self._rng) if rng is None else rng
        if rng is not None:
            inflow._waiting, inflow._supply = {}, []
            for lane, due_s in self._due_s.items():
                if due_s > time_s:
                    inflow._due_s[lane] = time_s + rng.random() * inflow._headway_s()
        return inflow

    def _drawn(self) -> list[Driver]:
        """Draw ``SUPPLY`` drivers, of which the last one comes first."""
        drawn = draw_drivers(self._rng, SUPPLY, self._config)
        columns = (getattr(drawn, name)[::-1].tolist() for name in Driver._fields)
        return [*map(Driver, *columns)]


def safe_speed(desired: float, headway_s: float, gap_m: float, speed_ahead: float) -> float:
    """Return the largest safe start speed of one vehicle, m/s, as ``safe_speeds`` does.

    ``speed_ahead`` is the speed of the vehicle ahead, m/s; without one ``gap_m`` is inf.
    """
    free_m = max(gap_m - STANDSTILL_GAP_M, 0.0)
    reach = math.sqrt(speed_ahead * speed_ahead + 2 * COMFORTABLE_BRAKING_M_S2 * free_m)
    return min(desired, free_m / headway_s, reach)
