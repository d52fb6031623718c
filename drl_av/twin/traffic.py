"""Places the vehicles of an episode in a world of the twin, with the draws of the SUMO side."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from drl_av.arrays import FloatArray, IntArray
from drl_av.compiled import borrowing, compiled
from drl_av.config import Config
from drl_av.drivers.background.finite_state import HardBraking
from drl_av.drivers.background.traffic import in_order
from drl_av.errors import ConfigError
from drl_av.random_streams import Stream, generator
from drl_av.road.vehicle_types import AS_WRITTEN
from drl_av.scenarios.folder import Scenario
from drl_av.scenarios.imported.description import ImportedDescription
from drl_av.simulation.fleet import Fleet
from drl_av.simulation.population import ARRAYS, DECISIONS_AT_ONCE, DriverModel, Population
from drl_av.simulation.speed_requests import LEFT_TO_SUMO
from drl_av.twin.following import STEP_S
from drl_av.twin.lane_speeds import RIGHT_RELUCTANCE
from drl_av.twin.neighbors import edge_of, insert_sorted, link
from drl_av.twin.worlds import (
    ACCELERATION_M_S2,
    ADVICE_M_S,
    CHOSEN_M_S,
    COUNT,
    DESIRED_M_S,
    DRIVER_COUNT,
    DRIVERS,
    EDGE,
    EDGE_BEGIN,
    EDGE_LENGTH,
    EXPECTED_M_S,
    FIRST_SEEN,
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
    PRESENT,
    REQUEST_END,
    REQUEST_LANE,
    REQUESTED_M_S,
    RESERVED,
    SHADOW,
    SPEED_M_S,
    THRESHOLD_LEFT,
    THRESHOLD_RIGHT,
    WIDTH_M,
    WISH_M_S2,
    Net,
    World,
    activate,
    strips_with_vehicles,
)

ROUTE_M, LEAST_EDGES, MOST_EDGES = 3000.0, 5, 9
"""What SUMO's lane-change models regard of a route: this length, but at least and at most so many
edges, with which they look further than the braking distance where edges are longer than 90 m."""
ONLY_SUMO = int(DriverModel.SUMO)
GAIN = 0.2
"""SL2015's threshold of the gain for a driver with lcSpeedGain 1."""
IN_SUMO = (
    'drive in SUMO (--world sumo; in Python simulation.world = "sumo", and gymnasium.make or '
    'make_vec with vectorization_mode="sync")'
)
"""What a user can do about what the twin does not know."""


def net_of(scenario: Scenario, config: Config) -> Net:
    """Return the road of a scenario as the twin needs it.

    Raises:
        ConfigError: the twin cannot drive on this road or with this traffic.
    """
    require_supported(scenario, config)
    road, start = scenario.road, scenario.layout.start
    names, begins_m, lengths_m, first_lanes = edges_of(scenario)
    by_rank = np.argsort(names, kind="stable")
    lanes = np.flatnonzero(road.open_lanes) if start is None else np.array(start.lanes)
    first_seen = np.full(len(names), lanes.min()) if road.is_loop else first_lanes
    return Net(
        lap_m=float(road.lap_m),
        edges_m=np.stack((begins_m, lengths_m, routes_of(lengths_m, road.is_loop))),
        edge_lanes=np.stack((first_lanes, first_seen, by_rank.argsort(), by_rank)),
        edges=len(names),
        is_loop=road.is_loop,
        lane_m=float(road.lane_width_m),
        lanes=len(road.open_lanes),
        first_open=int(lanes.min()),
        last_open=int(lanes.max()),
        limit_m_s=float(scenario.description.speed_limit_m_s),
    )


def edges_of(scenario: Scenario) -> tuple[list[str], FloatArray, FloatArray, IntArray]:
    """Return the names of the edges of the traffic's route, begins, lengths and first lanes."""
    layout = scenario.layout
    names = [*next(iter(layout.routes.values()))]
    starts = [layout.lane_positions[f"{name}_0"] for name in names]
    first_lanes, begins_m = map(np.array, zip(*starts, strict=True))
    ends_m = np.array([layout.edge_ends_m[name] for name in names])
    return names, begins_m, ends_m - begins_m, first_lanes


def strips_of(scenario: Scenario) -> int:
    """Return the number of strips, one for each lane on each edge."""
    return len(edges_of(scenario)[0]) * len(scenario.road.open_lanes)


def routes_of(lengths_m: FloatArray, is_loop: bool) -> FloatArray:
    """Return the length of the road that SUMO regards from the beginning of each edge.

    It regards the rest of the route, but no more edges than are needed for ``ROUTE_M``, and from
    ``LEAST_EDGES`` to ``MOST_EDGES``.
    """
    edges, found = len(lengths_m), []
    laps = 2 + max(math.ceil(ROUTE_M / lengths_m.sum()), MOST_EDGES) if is_loop else 1
    along_m = np.tile(lengths_m, laps)
    for edge in range(edges):
        ways_m = along_m[edge:].cumsum()
        enough = min(int(np.searchsorted(ways_m, ROUTE_M)), MOST_EDGES - 1)
        found.append(ways_m[min(max(enough, LEAST_EDGES - 1), len(ways_m) - 1)])
    return np.array(found)


LEAST_ROOM_M = 1.2
"""With no more room in its lane than this, a vehicle of SUMO moves aside for those beside it."""


def require_supported(scenario: Scenario, config: Config) -> None:
    """Raise ConfigError, with the reason, for what the twin cannot do."""
    timing, lane_m = config.simulation, scenario.road.lane_width_m
    lanes, types = np.flatnonzero(scenario.road.open_lanes), scenario.vehicle_types
    changed = any(
        replace(one, length_m=written.length_m, width_m=written.width_m) != written
        for one, written in ((types.traffic, AS_WRITTEN.traffic), (types.ego, AS_WRITTEN.ego))
    )
    traffic = [kind.traffic for kind in config.per_traffic_preset]
    trucks_m = (each.truck_width_m for each in traffic if each.truck_share)
    widest_m = max([types.traffic.width_m, *trucks_m])
    refused = {
        "imported roads": isinstance(scenario.description, ImportedDescription),
        "a barricade between open lanes": len(lanes) != lanes[-1] - lanes[0] + 1,
        f"roads of more than {MOST_STRIPS} pieces of lanes": strips_of(scenario) > MOST_STRIPS,
        "vehicles that a scenario places exactly": bool(scenario.description.vehicles),
        "speed limits and lines along the road": bool(
            scenario.road.speed_limits or scenario.road.forbidden_lines
        ),
        "vehicle types of the user": bool(scenario.vehicle_types.own),
        "changes of vehicle_types.add.xml other than sizes": changed,
        f"lanes at most {LEAST_ROOM_M:g} m wider than their widest vehicle": (
            lane_m - widest_m <= LEAST_ROOM_M + 1e-9
        ),
        "a simulation.step_length_s other than 0.5": timing.step_length_s != STEP_S,
        "a simulation.lateral_resolution_m other than the lane width "
        f"(set it to {lane_m})": not math.isclose(timing.strip_width_m(lane_m), lane_m),
    }
    for what, is_so in refused.items():
        if is_so:
            raise ConfigError(f"The twin does not know {what}: {IN_SUMO}.")


def draw_events(seed: int, fleet: Fleet, decisions: int) -> IntArray:
    """Draw what the vehicles of a loop do at random, as in SUMO with the same seed.

    ``fleet`` has just drawn the episode.

    Returns:
        Decision, row and event, shape (events, 3), in the order of the decisions. An event is a
        lane change, +1 to the left or -1 to the right, or 1 + the decisions of a hard braking.
    """
    found = [hard_brakings(seed, fleet.driver_models, fleet.config, 0, decisions)]
    for first in range(0, decisions, DECISIONS_AT_ONCE):
        draws = fleet.rng.random((min(DECISIONS_AT_ONCE, decisions - first), 2, len(fleet.ids)))
        below = np.flatnonzero(draws[:, 0] < fleet.chance)
        decision, row = np.divmod(below[below % len(fleet.ids) > 0], len(fleet.ids))
        side = np.where(draws[decision, 1, row] < 0.5, 1, -1)
        found.append(np.stack((decision + first, row, side), axis=1))
    return in_order_of_decisions(found)


def draw_future(
    seed: int, driver_models: IntArray, config: Config, first: int, decisions: int
) -> IntArray:
    """Draw the events of ``decisions`` decisions from ``first`` on, as they occur.

    They have the form and the distribution of those of ``draw_events``.
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
    if DriverModel.HARD_BRAKING not in driver_models:  # a generator takes long to make
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
    world.x[:], world.z[:], world.near[:] = 0.0, 0, 0
    drivers = in_order(driver_models) if driver_models.any() else driver_models[:0]
    world.near[DRIVER_COUNT] = len(drivers)
    world.near[OVERTAKES_RIGHT] = config.traffic.overtake_right
    world.near[KEEPS_DISTANCE] = config.traffic.keep_stopping_distance or len(drivers) > 0
    sizes_m = sizes_of(scenario, config)
    write_vehicles(world, net, ARRAYS(population), driver_models, sizes_m)
    world.z[DRIVERS, : len(drivers)] = drivers
    sort_and_activate(world, net)


def sizes_of(scenario: Scenario, config: Config) -> FloatArray:
    """Return the length and the width of the ego, of cars and of trucks, shape (3, 2)."""
    types, traffic = scenario.vehicle_types, config.traffic
    sizes = [(each.length_m, each.width_m) for each in (types.ego, types.traffic)]
    return np.array([*sizes, (traffic.truck_length_m, traffic.truck_width_m)])


@borrowing
def write_vehicles(
    world: World, net: Net, population: Any, driver_models: IntArray, sizes_m: FloatArray
) -> None:
    """Write vehicles behind those of a world; ``population`` holds the arrays of a ``Population``.

    ``sizes_m`` are those of ``sizes_of``.
    """
    lane, front_m, speed, desired, headway, acceleration, speed_gain, is_truck = population
    x, z, first = world.x, world.z, world.near[COUNT]
    for row in range(len(lane)):
        i = first + row
        for column in range(len(x)):
            x[column, i] = 0.0
        for column in range(len(z)):
            z[column, i] = 0
        size = 2 if is_truck[row] else 1 if i else 0
        x[LENGTH_M, i], x[WIDTH_M, i] = sizes_m[size, 0], sizes_m[size, 1]
        x[FRONT_M, i], x[SPEED_M_S, i] = front_m[row], speed[row]
        x[DESIRED_M_S, i], x[HEADWAY_S, i] = desired[row], headway[row]
        x[ACCELERATION_M_S2, i] = acceleration[row]
        # a driver without lcSpeedGain changes for no gain
        x[THRESHOLD_LEFT, i] = GAIN / speed_gain[row] if speed_gain[row] else np.inf
        x[THRESHOLD_RIGHT, i] = RIGHT_RELUCTANCE * x[THRESHOLD_LEFT, i]
        z[MODEL, i] = driver_models[row]
        z[ON_REQUEST_ONLY, i] = driver_models[row] != ONLY_SUMO
        x[ADVICE_M_S, i], x[WISH_M_S2, i] = np.inf, 0.0 if z[ON_REQUEST_ONLY, i] else np.nan
        x[REQUESTED_M_S, i], x[CHOSEN_M_S, i] = LEFT_TO_SUMO, speed[row]
        first_seen = net.edge_lanes[FIRST_SEEN, edge_of(front_m[row], net)]
        for number in range(net.lanes):
            is_seen = first_seen <= number and number <= net.last_open
            x[EXPECTED_M_S + number, i] = desired[row] if is_seen else -1.0
        z[LANE, i], z[ORDER, i], z[MASK, i], z[IS_FULL, i] = lane[row], i, 1 << lane[row], 1
        z[REQUEST_END, i], z[REQUEST_LANE, i], z[SHADOW, i], z[RESERVED, i] = -1, -1, -1, -1
    world.near[COUNT] = world.near[PRESENT] = first + len(lane)


@compiled
def keep_vehicles(world: World, rows: IntArray) -> None:
    """Remove all vehicles but those in ``rows``, which are then in this order, still unsorted."""
    x, z, n, kept = world.x, world.z, world.near[COUNT], len(rows)
    new_row, order, placed = np.full(n, -1), z[ORDER, :n].copy(), 0
    for row in range(kept):
        new_row[rows[row]] = row
    for column in range(len(x)):
        x[column, :kept] = x[column][rows]
    for column in range(len(z)):
        z[column, :kept] = z[column][rows]
    for row in order:
        if new_row[row] >= 0:
            z[ORDER, placed] = new_row[row]
            placed += 1
    world.near[COUNT] = kept


@compiled
def exchange(
    world: World,
    net: Net,
    kept: IntArray,
    entering: Any,
    driver_models: IntArray,
    sizes_m: FloatArray,
) -> None:
    """Remove the vehicles of an open road that are not in ``kept``, and add those that enter.

    As in SUMO, those that have left drive on to the end of the road, in the rows behind the others.
    ``entering`` holds the arrays of a ``Population``; the arguments behind it are those of
    ``write_vehicles``.
    """
    end_m = net.edges_m[EDGE_BEGIN, -1] + net.edges_m[EDGE_LENGTH, -1]
    has_left = world.x[FRONT_M, : world.near[COUNT]] < end_m
    has_left[kept] = False
    rows = np.concatenate((kept, np.flatnonzero(has_left)))
    if len(rows) < world.near[COUNT] or has_left.any():
        keep_vehicles(world, rows)
    if len(driver_models):
        write_vehicles(world, net, entering, driver_models, sizes_m)
        present, stay, before = np.arange(world.near[COUNT]), len(kept), len(rows)
        parts = present[:stay], present[before:], present[stay:before]
        if before > stay:
            keep_vehicles(world, np.concatenate(parts))
    world.near[PRESENT] = len(kept) + len(driver_models)
    sort_and_activate(world, net)


@borrowing
def sort_and_activate(world: World, net: Net) -> None:
    """Sort the vehicles, and list the strips on which they start as SUMO does."""
    for i in range(world.near[COUNT]):
        world.z[EDGE, i] = edge_of(world.x[FRONT_M, i], net)
    insert_sorted(world)
    link(world, net)
    activate(world, strips_with_vehicles(world, net))
