"""Places the vehicles of an episode in a world of the twin, with the draws of the SUMO side."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drl_av.compiled import borrowing
from drl_av.config import Config
from drl_av.drivers.background.finite_state import HardBraking
from drl_av.drivers.background.traffic import in_order
from drl_av.errors import ConfigError
from drl_av.random_streams import Stream, generator, kind_of_traffic
from drl_av.scenarios.folder import Scenario
from drl_av.simulation.population import (
    DECISIONS_AT_ONCE,
    DriverModel,
    Population,
    draw_driver_models,
    draw_population,
    require_speed_limit,
    require_truck_width,
)
from drl_av.simulation.speed_requests import LEFT_TO_SUMO
from drl_av.twin.active_lanes import activate, strips_with_vehicles
from drl_av.twin.following import STEP_S
from drl_av.twin.neighbors import EDGES, edge_of, insert_sorted, link
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ADVICE_M_S,
    CHOSEN_M_S,
    COUNT,
    DESIRED_M_S,
    DRIVER_COUNT,
    DRIVERS,
    EDGE,
    EXPECTED_M_S,
    FRONT_M,
    HEADWAY_S,
    IS_FULL,
    KEEPS_DISTANCE,
    LANE,
    LENGTH_M,
    MASK,
    MODEL,
    MOST_STRIPS,
    ON_REQUEST_ONLY,
    ORDER,
    OVERTAKES_RIGHT,
    REQUEST_END,
    REQUEST_LANE,
    REQUESTED_M_S,
    RESERVED,
    SHADOW,
    SPEED_M_S,
    THRESHOLD_LEFT,
    THRESHOLD_RIGHT,
    TRACKED,
    TRACKED_LEFT,
    WIDTH_M,
    WISH_M_S2,
    IntArray,
    Net,
    World,
)

RIGHT_RELUCTANCE = 10.0
"""SUMO's 1 / lcSpeedGainRight: a change to the right needs so much more gain."""
GAIN = 0.2
"""SL2015's threshold of the gain for a driver with lcSpeedGain 1."""


def net_of(scenario: Scenario, config: Config) -> Net:
    """Return the road of a scenario as the twin needs it.

    Raises:
        ConfigError: the twin cannot drive on this road or with this traffic.
    """
    require_supported(scenario, config)
    for kind in config.per_traffic_preset:
        require_speed_limit(kind, scenario.description)
        require_truck_width(kind, scenario.description)
    road, lanes = scenario.road, np.flatnonzero(scenario.road.open_lanes)
    return Net(
        lap_m=float(road.lap_m),
        edge_m=float(road.lap_m) / EDGES,
        edges_per_m=EDGES / float(road.lap_m),
        lane_m=float(road.lane_width_m),
        lanes=len(road.open_lanes),
        first_open=int(lanes[0]),
        last_open=int(lanes[-1]),
        limit_m_s=float(scenario.description.speed_limit_m_s),
    )


def require_supported(scenario: Scenario, config: Config) -> None:
    """Raise ConfigError, with the reason, for what the twin cannot do."""
    timing = config.simulation
    lanes = np.flatnonzero(scenario.road.open_lanes)
    refused = {
        "open roads": not scenario.road.is_loop,
        "a barricade between open lanes": len(lanes) != lanes[-1] - lanes[0] + 1,
        f"roads of more than {MOST_STRIPS // EDGES} lanes": len(scenario.road.open_lanes)
        > MOST_STRIPS // EDGES,
        "vehicles that a scenario places exactly": bool(scenario.description.vehicles),
        "speed limits and lines along the road": bool(
            scenario.road.speed_limits or scenario.road.forbidden_lines
        ),
        "vehicle types of the user": bool(scenario.vehicle_types.own),
        "a simulation.step_length_s other than 0.5": timing.step_length_s != STEP_S,
        "a simulation.lateral_resolution_m other than the lane width": not math.isclose(
            timing.lateral_resolution_m, scenario.road.lane_width_m
        ),
    }
    for what, is_so in refused.items():
        if is_so:
            raise ConfigError(f"The twin does not know {what}: drive in SUMO, with gymnasium.make.")


class Drawn(NamedTuple):
    """The vehicles of an episode and what they do at random."""

    config: Config
    """The settings, with the episode's kind of traffic."""
    population: Population
    driver_models: IntArray
    """The ``DriverModel`` of each vehicle, shape (1 + N,)."""
    events: IntArray
    """Decision, row and event, shape (events, 3), in the order of the decisions. An event is a lane
    change, +1 to the left or -1 to the right, or 1 + the decisions of a hard braking."""


def draw_traffic(
    seed: int, vehicles: int, scenario: Scenario, kinds: Sequence[Config], decisions: int
) -> Drawn:
    """Draw the traffic of an episode in SUMO with the same seed and number of vehicles.

    ``kinds`` has a config for each kind of traffic that the episode may have.

    Raises:
        ScenarioError: the vehicles do not fit on the road.
    """
    config = kinds[kind_of_traffic(seed, len(kinds))]
    rng, traffic = np.random.default_rng(seed), config.traffic
    length_m = scenario.description.vehicle_length_m
    population = draw_population(rng, vehicles, scenario.road, length_m, traffic, config.ego)
    driver_models = draw_driver_models(seed, vehicles + 1, traffic).astype(np.int64)
    chance = traffic.random_lane_changes_per_s * config.simulation.decision_interval_s
    found = [hard_brakings(seed, driver_models, config, 0, decisions)]
    for first in range(0, decisions, DECISIONS_AT_ONCE):
        draws = rng.random((min(DECISIONS_AT_ONCE, decisions - first), 2, vehicles + 1))
        below = np.unravel_index(np.flatnonzero(draws < chance), draws.shape)
        decision, _, row = (where[(below[1] == 0) & (below[2] != 0)] for where in below)
        side = np.where(draws[decision, 1, row] < 0.5, 1, -1)
        found.append(np.stack((decision + first, row, side), axis=1))
    return Drawn(config, population, driver_models, in_order_of_decisions(found))


def draw_future(
    seed: int, driver_models: IntArray, config: Config, first: int, decisions: int
) -> IntArray:
    """Draw the events of ``decisions`` decisions from ``first`` on, as they occur.

    They have the form and the distribution of those of ``draw_traffic``.
    """
    rng, vehicles = generator(seed, Stream.FORKS), len(driver_models) - 1
    chance = config.traffic.random_lane_changes_per_s * config.simulation.decision_interval_s
    cells = decisions * vehicles
    drawn = np.sort(rng.choice(cells, rng.binomial(cells, chance), replace=False))
    side = rng.choice((-1, 1), len(drawn))
    decision, row = np.divmod(drawn, max(vehicles, 1))
    return in_order_of_decisions(
        [
            hard_brakings(seed, driver_models, config, first, decisions),
            np.stack((first + decision, 1 + row, side), axis=1),
        ]
    )


def hard_brakings(
    seed: int, driver_models: IntArray, config: Config, first: int, decisions: int
) -> IntArray:
    """Return the events in which vehicles are to begin to brake hard, from ``first`` on."""
    if not driver_models.any():  # a generator takes as long to make as to use
        return np.empty((0, 3), np.int64)
    begun = HardBraking(seed, driver_models, config).begun(decisions)
    event = np.full(len(begun), 1 + config.traffic.hard_brake_s)
    return np.column_stack((begun[:, 0] + first, begun[:, 1], event))


def in_order_of_decisions(events: Sequence[IntArray]) -> IntArray:
    """Return all events in one array, in the order of the decisions."""
    found = np.concatenate(events).astype(np.int64)
    return found[np.argsort(found[:, 0], kind="stable")]


def place_vehicles(
    world: World,
    net: Net,
    population: Population,
    driver_models: IntArray,
    scenario: Scenario,
    config: Config,
) -> None:
    """Place the vehicles of a population in a world, and make it forget all else.

    ``driver_models`` holds the ``DriverModel`` of each.
    """
    x, z, near, n = world.x, world.z, world.near, len(population.ids)
    x[:], z[:], near[:] = 0.0, 0, 0
    types, traffic = scenario.vehicle_types, config.traffic
    drivers = in_order(driver_models) if driver_models.any() else driver_models[:0]
    near[COUNT], near[DRIVER_COUNT] = n, len(drivers)
    near[OVERTAKES_RIGHT] = traffic.overtake_right
    near[KEEPS_DISTANCE] = traffic.keep_stopping_distance or len(drivers) > 0
    z[MODEL, :n], z[DRIVERS, : len(drivers)] = driver_models, drivers
    z[ON_REQUEST_ONLY] = z[MODEL] != DriverModel.SUMO
    rows = np.arange(n)
    for column, (ours, cars, trucks) in {
        LENGTH_M: (types.ego.length_m, types.traffic.length_m, traffic.truck_length_m),
        WIDTH_M: (types.ego.width_m, types.traffic.width_m, traffic.truck_width_m),
    }.items():
        x[column, :n] = np.where(population.is_truck, trucks, np.where(rows == 0, ours, cars))
    x[FRONT_M, :n], x[SPEED_M_S, :n] = population.front_m, population.speed_m_s
    x[DESIRED_M_S, :n] = population.desired_speed_m_s
    x[HEADWAY_S, :n] = population.headway_s
    x[ACCELERATION_M_S2, :n] = population.acceleration_m_s2
    with np.errstate(divide="ignore"):  # a driver without lcSpeedGain changes for no gain
        x[THRESHOLD_LEFT, :n] = GAIN / population.speed_gain
    x[THRESHOLD_RIGHT] = RIGHT_RELUCTANCE * x[THRESHOLD_LEFT]
    x[ADVICE_M_S] = np.inf
    x[WISH_M_S2] = np.where(z[ON_REQUEST_ONLY], 0.0, np.nan)
    x[REQUESTED_M_S], x[CHOSEN_M_S] = LEFT_TO_SUMO, x[SPEED_M_S]
    for lane in range(net.lanes):
        is_open = net.first_open <= lane <= net.last_open
        x[EXPECTED_M_S + lane] = x[DESIRED_M_S] if is_open else -1.0
    z[LANE, :n], z[ORDER, :n] = population.lane, rows
    z[MASK], z[IS_FULL] = 1 << z[LANE], 1
    z[REQUEST_END], z[REQUEST_LANE], z[SHADOW], z[RESERVED] = -1, -1, -1, -1
    z[TRACKED], z[TRACKED_LEFT] = -1, -1
    sort_and_activate(world, net)


@borrowing
def sort_and_activate(world: World, net: Net) -> None:
    """Sort the vehicles, and list the strips on which they start as SUMO does."""
    for i in range(world.near[COUNT]):
        world.z[EDGE, i] = edge_of(world.x[FRONT_M, i], net)
    insert_sorted(world)
    link(world, net)
    activate(world, strips_with_vehicles(world, net))
