"""The vehicles at the start of an episode: positions and parameters, drawn at random."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from drl_av.config import Config, EgoConfig, TrafficConfig
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.errors import ConfigError, ScenarioError
from drl_av.traffic.description import PlacedVehicle, ScenarioDescription
from drl_av.traffic.road import FloatArray, Road

EGO_ID = "ego"
SPREAD_M = 250.0
"""Vehicles start within this distance of the ego (Sec. IV-B)."""
DECISIONS_AT_ONCE = 256
COMFORTABLE_BRAKING_M_S2 = 2.0
STANDING_M_S = 0.1
"""Speed of standing vehicles; SUMO's models react to them, but not to vehicles that SUMO stops."""


class Kind(IntEnum):
    """The driver of a background vehicle."""

    SUMO = 0
    """SUMO's IDM and SL2015; also the value in the ego's row."""
    FINITE_STATE = 1
    LEVEL_0 = 2
    LEVEL_1 = 3
    HARD_BRAKING = 4
    """The finite-state machine, which sometimes brakes as hard as it can."""


@dataclass(frozen=True)
class Population:
    """The vehicles at the start of an episode; all arrays have 1 + N rows, the ego's first."""

    ids: tuple[str, ...]
    lane: npt.NDArray[np.intp]
    front_m: FloatArray
    """Position of the front bumper along the loop, [0, circumference)."""
    speed_m_s: FloatArray
    desired_speed_m_s: FloatArray
    headway_s: FloatArray
    acceleration_m_s2: FloatArray
    speed_gain: FloatArray
    """Lane-change eagerness, SUMO's lcSpeedGain."""
    is_truck: npt.NDArray[np.bool_]


def require_speed_limit(config: Config, description: ScenarioDescription) -> None:
    """Raise ConfigError if a setting permits a speed above the road's speed limit."""
    fastest = {"ego.max_speed_m_s": config.ego.max_speed_m_s}
    if not description.vehicles:
        fastest["traffic.desired_speed_max_m_s"] = config.traffic.desired_speed_max_m_s
        if config.traffic.truck_share:
            fastest["traffic.truck_speed_max_m_s"] = config.traffic.truck_speed_max_m_s
        if config.traffic.fast_share:
            fastest["traffic.fast_speed_m_s"] = config.traffic.fast_speed_m_s
    for name, speed in fastest.items():
        if speed > description.speed_limit_m_s:
            raise ConfigError(
                f"{name} is {speed:g}, but the scenario's speed_limit_m_s is "
                f"{description.speed_limit_m_s:g}: lower the setting, or write a scenario with a "
                "higher limit."
            )


def require_truck_width(config: Config, description: ScenarioDescription) -> None:
    """Raise ConfigError where trucks are wider than a lane."""
    width_m, lane_m = config.traffic.truck_width_m, description.lane_width_m
    if config.traffic.truck_share and width_m > lane_m:
        raise ConfigError(
            f"traffic.truck_width_m is {width_m:g}, but the scenario's lane_width_m is {lane_m:g}: "
            "lower the setting, or write a scenario with wider lanes."
        )


def capacity(road: Road, length_m: float, start_gap_m: float) -> int:
    """Largest number of vehicles, including the ego, that can start on the road."""
    ring_m = min(road.lap_m, 2 * SPREAD_M)
    return sum(road.open_lanes) * int(ring_m // (length_m + start_gap_m))


def draw_population(
    rng: np.random.Generator,
    vehicles: int,
    road: Road,
    length_m: float,
    traffic: TrafficConfig,
    ego: EgoConfig,
) -> Population:
    """Draw the ego and ``vehicles`` other vehicles within 250 m, each with its own parameters.

    Cars have ``length_m``. Trucks and unusual vehicles are drawn from streams of their own, so that
    the others stay as they are.

    Raises:
        ScenarioError: the vehicles do not fit on the open lanes.
    """
    n = vehicles + 1
    room = capacity(road, traffic.longest_m(length_m), traffic.start_gap_m)
    if n > room:
        raise ScenarioError(
            f"{vehicles} vehicles do not fit on this road: its {sum(road.open_lanes)} open lanes "
            f"take {max(room - 1, 0)} besides the ego; ask for fewer or make the loop longer."
        )
    unusual, trucks = rng.spawn(2)
    is_truck = trucks.random(n) < traffic.truck_share
    is_truck[0] = False
    lane = _lanes(rng, n, road, room, traffic.lane_evenness)
    pitch_m = np.where(is_truck, traffic.truck_length_m, length_m) + traffic.start_gap_m
    front_m, gap_m, leader = _places(rng, lane, road, pitch_m, traffic.start_gap_m)
    desired = rng.uniform(traffic.desired_speed_min_m_s, traffic.desired_speed_max_m_s, n)
    desired[0] = ego.max_speed_m_s
    headway = rng.uniform(traffic.headway_min_s, traffic.headway_max_s, n)
    acceleration = rng.uniform(traffic.acceleration_min_m_s2, traffic.acceleration_max_m_s2, n)
    speed_gain = rng.uniform(traffic.speed_gain_min, traffic.speed_gain_max, n)
    truck_speeds = trucks.uniform(traffic.truck_speed_min_m_s, traffic.truck_speed_max_m_s, n)
    desired[is_truck] = truck_speeds[is_truck]
    acceleration[is_truck] = traffic.truck_acceleration_m_s2
    _make_some_unusual(unusual, desired, speed_gain, traffic)
    return Population(
        ids=(EGO_ID, *(f"vehicle{i}" for i in range(1, n))),
        lane=lane,
        front_m=front_m,
        speed_m_s=_safe_speeds(desired, headway, gap_m, leader),
        desired_speed_m_s=desired,
        headway_s=headway,
        acceleration_m_s2=acceleration,
        speed_gain=speed_gain,
        is_truck=is_truck,
    )


def _make_some_unusual(
    rng: np.random.Generator,
    desired_m_s: FloatArray,
    speed_gain: FloatArray,
    traffic: TrafficConfig,
) -> None:
    """Make some vehicles but the ego stand, crawl or overtake fast, by the config's shares."""
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
    """The vehicles that a scenario places exactly, with the mean parameters of the config.

    Raises:
        ScenarioError: the ego is not among them.
    """
    if EGO_ID not in [vehicle.id for vehicle in placed]:
        raise ScenarioError(
            f"The scenario places {len(placed)} vehicles but not the ego: "
            'place one with the id "ego" too.'
        )
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


def draw_kinds(seed: int, n: int, traffic: TrafficConfig) -> npt.NDArray[np.intp]:
    """The kind of driver of each row, shape (n,), drawn by the shares; ``Kind.SUMO`` for the ego.

    They use a separate random stream, so the shares do not change the vehicles' other parameters.
    """
    limits = np.cumsum(traffic.shares)
    draws = np.random.default_rng([seed, 3]).random(n)
    drawn = (np.searchsorted(limits, draws, side="right") + 1) % len(Kind)
    drawn[0] = Kind.SUMO
    return drawn


def random_lane_changes(
    rng: np.random.Generator, n: int, chance: float
) -> Iterator[list[tuple[int, int]]]:
    """The random lane changes of each decision, as pairs of row and side; an endless iterator.

    Sides are left +1 and right -1. The ego, row 0, has no random lane changes.
    """
    while True:
        draws = rng.random((DECISIONS_AT_ONCE, 2, n))
        traffic_commands: list[list[tuple[int, int]]] = [[] for _ in range(DECISIONS_AT_ONCE)]
        for decision, row in np.argwhere(draws[:, 0] < chance).tolist():
            if row != 0:
                traffic_commands[decision].append((row, 1 if draws[decision, 1, row] < 0.5 else -1))
        yield from traffic_commands


def _lanes(
    rng: np.random.Generator, n: int, road: Road, room: int, evenness: float
) -> npt.NDArray[np.intp]:
    """The lane of each row: equal chances for the ego, random shares of this episode for others."""
    open_lanes = np.flatnonzero(road.open_lanes)
    berths = np.full(len(open_lanes), room // len(open_lanes))
    shares = rng.dirichlet(np.full(len(open_lanes), evenness))
    chosen = np.empty(n, dtype=np.intp)
    for row in range(n):
        chances = np.where(berths > 0, shares if row else 1.0, 0.0)
        if not chances.any():
            chances = (berths > 0).astype(float)
        limits = (chances / chances.sum()).cumsum()  # rng.choice draws so too, but checks first
        chosen[row] = (limits / limits[-1]).searchsorted(rng.random(), side="right")
        berths[chosen[row]] -= 1
    return open_lanes[chosen]


def _places(
    rng: np.random.Generator,
    lane: npt.NDArray[np.intp],
    road: Road,
    pitch_m: FloatArray,
    start_gap_m: float,
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.intp]]:
    """Positions of the front bumpers, net gaps to the vehicle ahead, and that vehicle's row."""
    n = len(lane)
    ring_m = min(road.lap_m, 2 * SPREAD_M)
    front_m, gap_m, leader = np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.intp)
    for index in np.unique(lane):
        members = np.flatnonzero(lane == index)
        spare_m = rng.dirichlet(np.ones(len(members))) * (ring_m - pitch_m[members].sum())
        ends = np.cumsum(spare_m + pitch_m[members])
        front_m[members] = (rng.uniform(0, ring_m) + ends) % ring_m
        leader[members] = np.roll(members, -1)
        gap_m[members] = np.roll(spare_m, -1) + start_gap_m
    around_ego = (front_m - front_m[0] + ring_m / 2) % ring_m - ring_m / 2
    start_m = rng.uniform(0, road.lap_m)
    return (start_m + around_ego) % road.lap_m, gap_m, leader


def _safe_speeds(
    desired: FloatArray, headway: FloatArray, gap_m: FloatArray, leader: npt.NDArray[np.intp]
) -> FloatArray:
    free_m = np.maximum(gap_m - STANDSTILL_GAP_M, 0.0)
    speed = np.minimum(desired, free_m / headway)
    for _ in range(len(speed)):
        reach = np.sqrt(speed[leader] ** 2 + 2 * COMFORTABLE_BRAKING_M_S2 * free_m)
        slower = np.minimum(speed, reach)
        if np.array_equal(slower, speed):
            break
        speed = slower
    return speed
