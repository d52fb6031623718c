"""The vehicles at the start of an episode, with random, but safe positions and parameters."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import lru_cache
from operator import attrgetter
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drl_av.arrays import BoolArray, FloatArray
from drl_av.config import Config, TrafficConfig
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ConfigError, ScenarioError, pluralize
from drl_av.random_streams import Stream, generator
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO_ID
from drl_av.scenarios.road_description import PlacedVehicle, RoadDescription, require_ego

COMFORTABLE_BRAKING_M_S2 = 2.0
"""Braking with which each vehicle can stop behind the vehicle ahead at the start."""


class StartPositions(NamedTuple):
    """The start positions of vehicles along a ring; one row for each vehicle, the ego's first."""

    lane: npt.NDArray[np.intp]
    front_m: FloatArray
    """Position of the front bumper along the ring."""
    gap_m: FloatArray
    """Net gap to the vehicle ahead in the same lane."""
    leader: npt.NDArray[np.intp]
    """Row of the vehicle ahead in the same lane."""


def random_lanes(
    rng: np.random.Generator, n: int, road: Road, room: int, evenness: float
) -> npt.NDArray[np.intp]:
    """Draw the lane indices of ``n`` vehicles, shape (n,); the first is the lane of the ego.

    The ego is in each open lane with the same probability. For the other vehicles the probabilities
    of the lanes are drawn once, from a Dirichlet distribution with the parameter ``evenness``.
    ``room`` is the number of vehicles that fit on all open lanes together; no lane is overfilled.
    """
    open_lanes = np.flatnonzero(road.open_lanes)
    berths = np.full(len(open_lanes), room // len(open_lanes))
    shares = rng.dirichlet(np.full(len(open_lanes), evenness))
    draws, chosen, row = rng.random(n), np.empty(n, dtype=np.intp), 0
    while row < n:  # first for the ego, then until a lane is full
        chances = np.where(berths > 0, shares if row else 1.0, 0.0)
        if not chances.any():
            chances = (berths > 0).astype(float)
        limits = (chances / chances.sum()).cumsum()  # as rng.choice does, without its checks
        wanted = (limits / limits[-1]).searchsorted(draws[row : n if row else 1], side="right")
        for place, left in enumerate(berths):
            (fills,) = (wanted == place).nonzero()
            if 0 < left <= len(fills):
                wanted = wanted[: fills[left - 1] + 1]
        chosen[row : row + len(wanted)] = wanted
        berths -= np.bincount(wanted, minlength=len(berths))
        row += len(wanted)
    return open_lanes[chosen]


def ring_places(
    rng: np.random.Generator,
    lane: npt.NDArray[np.intp],
    ring_m: float,
    pitch_m: FloatArray,
    start_gap_m: float,
) -> StartPositions:
    """Draw the positions of vehicles in their lanes, along a ring of ``ring_m`` metres.

    ``pitch_m`` is the length of each vehicle plus ``start_gap_m``, the smallest gap.
    """
    n = len(lane)
    front_m, gap_m, leader = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.intp)
    for index in np.unique(lane):
        (members,) = (lane == index).nonzero()
        spare_m = rng.dirichlet(np.ones(len(members))) * (ring_m - pitch_m[members].sum())
        ends = np.cumsum(spare_m + pitch_m[members])
        front_m[members] = (rng.uniform(0, ring_m) + ends) % ring_m
        leader[members] = np.concatenate((members[1:], members[:1]))
        gap_m[members] = np.concatenate((spare_m[1:], spare_m[:1])) + start_gap_m
    return StartPositions(lane, front_m, gap_m, leader)


def safe_speeds(
    desired: FloatArray, headway: FloatArray, gap_m: FloatArray, leader: npt.NDArray[np.intp]
) -> FloatArray:
    """Return the largest safe start speed of each vehicle, m/s; all arrays have shape (n,).

    A vehicle does not exceed its desired speed, and keeps its headway. It can stop behind the
    vehicle ahead, in row ``leader``, if both brake with ``COMFORTABLE_BRAKING_M_S2``.
    """
    free_m = np.maximum(gap_m - STANDSTILL_GAP_M, 0.0)
    speed = np.minimum(desired, free_m / headway)
    for _ in range(len(speed)):
        reach = np.sqrt(speed[leader] ** 2 + 2 * COMFORTABLE_BRAKING_M_S2 * free_m)
        slower = np.minimum(speed, reach)
        if (slower == speed).all():
            break
        speed = slower
    return speed


SPREAD_M = 250.0
"""Vehicles start within this distance of the ego (Sec. IV-B)."""
DECISIONS_AT_ONCE = 256
"""Number of decisions whose random lane changes are drawn at once."""
STANDING_M_S = 0.1
"""Desired speed of standing vehicles. They creep, because SUMO's models do not react to vehicles
that SUMO has stopped."""


class DriverModel(IntEnum):
    """The kind of driver of a background vehicle."""

    SUMO = 0
    """SUMO's IDM and SL2015; also the value in the ego's row."""
    FINITE_STATE = 1
    LEVEL_0 = 2
    LEVEL_1 = 3
    HARD_BRAKING = 4
    """The finite-state machine, which brakes as hard as it can at random times."""
    LEVEL_2 = 5


@dataclass(frozen=True)
class Population:
    """The vehicles of an episode; each array has shape (1 + N,), with the ego at index 0."""

    ids: tuple[str, ...]
    lane: npt.NDArray[np.intp]
    front_m: FloatArray
    """Position of the front bumper along the road, in [0, ``Road.lap_m``)."""
    speed_m_s: FloatArray
    desired_speed_m_s: FloatArray
    headway_s: FloatArray
    acceleration_m_s2: FloatArray
    speed_gain: FloatArray
    """SUMO's lcSpeedGain, the eagerness to change lanes for speed."""
    is_truck: BoolArray

    def rows(self, wanted: Sequence[int]) -> "Population":
        """Return the population of the wanted rows, in their order."""
        kept = list(wanted)
        arrays = (array[kept] for array in ARRAYS(self))
        return Population(tuple(self.ids[row] for row in kept), *arrays)

    def joined(self, others: "Sequence[Population]") -> "Population":
        """Return the population with the rows of ``others`` after its own."""
        parts = self, *others
        arrays = map(np.concatenate, zip(*map(ARRAYS, parts), strict=True))
        return Population(tuple(name for part in parts for name in part.ids), *arrays)


ARRAYS = attrgetter(*(item.name for item in fields(Population)[1:]))
"""Returns the arrays of a population, in the order of its fields."""


def require_speed_limit(
    config: Config, description: RoadDescription, limits_vary: bool = False
) -> None:
    """Raise ConfigError if a setting permits a speed above the road's speed limit.

    It also raises ConfigError if the scenario starts the ego faster than ``ego.max_speed_m_s``. On
    a road with limits along it (``limits_vary``) the settings may be higher: the ego and SUMO keep
    the limits.
    """
    fastest = {"ego.max_speed_m_s": config.ego.max_speed_m_s}
    if not description.vehicles:
        fastest["traffic.desired_speed_max_m_s"] = config.traffic.desired_speed_max_m_s
        if config.traffic.truck_share:
            fastest["traffic.truck_speed_max_m_s"] = config.traffic.truck_speed_max_m_s
        if config.traffic.fast_share:
            fastest["traffic.fast_speed_m_s"] = config.traffic.fast_speed_m_s
    limit_m_s = description.speed_limit_m_s
    high = [f"{name} is {speed:g}" for name, speed in fastest.items() if speed > limit_m_s]
    if high and not limits_vary:
        raise ConfigError(
            f"{' and '.join(high)}, but the scenario's speed_limit_m_s is {limit_m_s:g}: lower "
            "each such setting, or write a scenario with a higher limit."
        )
    for vehicle in description.vehicles:
        if vehicle.id == EGO_ID and vehicle.speed_m_s > config.ego.max_speed_m_s:
            raise ConfigError(
                f"The scenario places the ego at {vehicle.speed_m_s:g} m/s, but it must not be "
                f"faster than ego.max_speed_m_s, {config.ego.max_speed_m_s:g}: place it slower, or "
                "raise the setting."
            )


def require_truck_width(config: Config, description: RoadDescription) -> None:
    """Raise ConfigError if trucks can occur and are wider than a lane."""
    width_m, lane_m = config.traffic.truck_width_m, description.lane_width_m
    if config.traffic.truck_share and width_m > lane_m:
        raise ConfigError(
            f"traffic.truck_width_m is {width_m:g}, but the scenario's lane_width_m is {lane_m:g}: "
            "lower the setting, or write a scenario with wider lanes."
        )


def capacity(road: Road, length_m: float, start_gap_m: float) -> int:
    """Return the largest number of vehicles, the ego included, that can start on a loop.

    ``length_m`` is the length of the longest vehicle, ``start_gap_m`` the smallest net gap.
    """
    ring_m = min(road.lap_m, 2 * SPREAD_M)
    return sum(road.open_lanes) * int(ring_m // (length_m + start_gap_m))


def draw_population(
    rng: np.random.Generator, vehicles: int, road: Road, length_m: float, config: Config
) -> Population:
    """Draw the ego and ``vehicles`` others within 250 m of it, with random parameters.

    Cars are ``length_m`` long. Trucks and unusual vehicles are drawn from separate random streams,
    so that they do not change the other vehicles.

    Raises:
        ScenarioError: the vehicles do not fit on the open lanes.
    """
    n, traffic = vehicles + 1, config.traffic
    room = capacity(road, traffic.longest_m(length_m), traffic.start_gap_m)
    if n > room:
        raise ScenarioError(
            f"This road has room for {pluralize(max(room - 1, 0), 'vehicle')} besides the ego on "
            f"its {pluralize(sum(road.open_lanes), 'open lane')}, not for {vehicles}: ask for fewer"
            " or make the loop longer."
        )
    is_mixed = traffic.truck_share > 0 or any(traffic.unusual_shares)
    streams = rng.spawn(2) if is_mixed else (rng, rng)  # else no driver draws from them
    is_truck = draw_trucks(streams[1], n, traffic)
    lane = random_lanes(rng, n, road, room, traffic.lane_evenness)
    pitch_m = np.where(is_truck, traffic.truck_length_m, length_m) + traffic.start_gap_m
    ring_m = min(road.lap_m, 2 * SPREAD_M)
    places = ring_places(rng, lane, ring_m, pitch_m, traffic.start_gap_m)
    around_ego = (places.front_m - places.front_m[0] + ring_m / 2) % ring_m - ring_m / 2
    start_m = rng.uniform(0, road.lap_m)
    places = places._replace(front_m=(start_m + around_ego) % road.lap_m)
    return with_drivers(rng, streams, places, is_truck, config)


def draw_trucks(rng: np.random.Generator, n: int, traffic: TrafficConfig) -> BoolArray:
    """Draw which of ``n`` vehicles are trucks, shape (n,); row 0, the ego, is always False."""
    if not traffic.truck_share:
        return np.zeros(n, dtype=np.bool_)
    is_truck = rng.random(n) < traffic.truck_share
    is_truck[0] = False
    return is_truck


def with_drivers(
    rng: np.random.Generator,
    streams: Sequence[np.random.Generator],
    places: StartPositions,
    is_truck: BoolArray,
    config: Config,
) -> Population:
    """Return the population at these positions, with random parameters of each driver.

    ``streams`` are the random streams of the unusual vehicles and of the trucks; ``rng`` draws all
    other parameters.
    """
    n, (unusual, trucks), traffic = len(is_truck), streams, config.traffic
    desired = rng.uniform(traffic.desired_speed_min_m_s, traffic.desired_speed_max_m_s, n)
    desired[0] = config.ego.max_speed_m_s
    headway = rng.uniform(traffic.headway_min_s, traffic.headway_max_s, n)
    acceleration = rng.uniform(traffic.acceleration_min_m_s2, traffic.acceleration_max_m_s2, n)
    speed_gain = rng.uniform(traffic.speed_gain_min, traffic.speed_gain_max, n)
    if traffic.truck_share:
        truck_speeds = trucks.uniform(traffic.truck_speed_min_m_s, traffic.truck_speed_max_m_s, n)
        desired[is_truck] = truck_speeds[is_truck]
        acceleration[is_truck] = traffic.truck_acceleration_m_s2
    _make_some_unusual(unusual, desired, speed_gain, traffic)
    return Population(
        ids=_vehicle_ids(n),
        lane=places.lane,
        front_m=places.front_m,
        speed_m_s=safe_speeds(desired, headway, places.gap_m, places.leader),
        desired_speed_m_s=desired,
        headway_s=headway,
        acceleration_m_s2=acceleration,
        speed_gain=speed_gain,
        is_truck=is_truck,
    )


def draw_drivers(rng: np.random.Generator, n: int, config: Config) -> Population:
    """Draw ``n`` drivers besides the ego's, with random parameters and without positions."""
    zeros, streams = np.zeros(n + 1, np.intp), rng.spawn(2)  # there is a row for the ego
    nowhere = StartPositions(zeros, np.zeros(n + 1), np.full(n + 1, np.inf), zeros)
    is_truck = draw_trucks(streams[1], n + 1, config.traffic)
    return with_drivers(rng, streams, nowhere, is_truck, config).rows(range(1, n + 1))


@lru_cache
def _vehicle_ids(n: int) -> tuple[str, ...]:
    return EGO_ID, *(f"vehicle{i}" for i in range(1, n))


def _make_some_unusual(
    rng: np.random.Generator,
    desired_m_s: FloatArray,
    speed_gain: FloatArray,
    traffic: TrafficConfig,
) -> None:
    """Make some vehicles besides the ego stand, crawl or overtake fast, in place."""
    if not any(traffic.unusual_shares):
        return
    draws, places = rng.random((2, len(desired_m_s)))
    which = np.searchsorted(np.cumsum(traffic.unusual_shares), draws, side="right")
    which[0] = len(traffic.unusual_shares)
    standing, crawling, fast = (which == row for row in range(len(traffic.unusual_shares)))
    desired_m_s[standing] = STANDING_M_S
    crawling_m_s = STANDING_M_S + places * (traffic.crawling_speed_max_m_s - STANDING_M_S)
    desired_m_s[crawling] = crawling_m_s[crawling]
    desired_m_s[fast] = traffic.fast_speed_m_s
    speed_gain[fast] = traffic.fast_speed_gain


def placed_population(placed: tuple[PlacedVehicle, ...], traffic: TrafficConfig) -> Population:
    """Return the vehicles that a scenario places exactly, with the mean parameters of ``traffic``.

    The ego has the first row.

    Raises:
        ScenarioError: the ego is not among them.
    """
    require_ego(placed)
    rows = sorted(placed, key=lambda vehicle: vehicle.id != EGO_ID)
    n = len(rows)
    return Population(
        ids=tuple(vehicle.id for vehicle in rows),
        lane=np.array([vehicle.lane for vehicle in rows]),
        front_m=np.array([vehicle.position_m for vehicle in rows]),
        speed_m_s=np.array([vehicle.speed_m_s for vehicle in rows]),
        desired_speed_m_s=np.array([vehicle.desired_speed_m_s for vehicle in rows]),
        headway_s=np.full(n, (traffic.headway_min_s + traffic.headway_max_s) / 2),
        acceleration_m_s2=np.full(
            n, (traffic.acceleration_min_m_s2 + traffic.acceleration_max_m_s2) / 2
        ),
        speed_gain=np.full(n, (traffic.speed_gain_min + traffic.speed_gain_max) / 2),
        is_truck=np.zeros(n, dtype=np.bool_),
    )


def draw_driver_models(seed: int, n: int, traffic: TrafficConfig) -> npt.NDArray[np.intp]:
    """Draw the kind of driver of each row by the shares, shape (n,); the ego's is ``SUMO``.

    The kinds have a separate random stream, so they do not change the other parameters.
    """
    limits = np.cumsum(traffic.shares)
    if not limits[-1]:
        return np.full(n, DriverModel.SUMO, dtype=np.intp)
    draws = generator(seed, Stream.KINDS_OF_DRIVERS).random(n)
    drawn = (np.searchsorted(limits, draws, side="right") + 1) % len(DriverModel)
    drawn[0] = DriverModel.SUMO
    return drawn


def random_lane_changes(
    rng: np.random.Generator, n: int, chance: float
) -> Iterator[list[tuple[int, int]]]:
    """Yield for each decision, endlessly, the random lane changes as pairs (row, side).

    The side is +1 for left and -1 for right. ``chance`` is the probability that a vehicle changes
    lanes at a decision; the ego, row 0, never does.
    """
    while True:
        draws = rng.random((DECISIONS_AT_ONCE, 2, n))
        changes: list[list[tuple[int, int]]] = [[] for _ in range(DECISIONS_AT_ONCE)]
        for decision, row in np.argwhere(draws[:, 0] < chance).tolist():
            if row != 0:
                changes[decision].append((row, 1 if draws[decision, 1, row] < 0.5 else -1))
        yield from changes
