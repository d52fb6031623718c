"""Drives the background vehicles that SUMO does not drive; all decide on the same snapshot.

Two vehicles may want to enter the same lane from opposite sides. Neither is in that lane yet, so
neither counts in the other's gaps: ``give_way`` decides which of them begins.
"""

from typing import NamedTuple

import numpy as np

from drl_av.arrays import Float32Array, FloatArray, IntArray
from drl_av.compiled import borrowing
from drl_av.config import Config, EgoConfig, FiniteStateConfig, Level0Config, ObservationConfig
from drl_av.config.traffic import STANDSTILL_GAP_M
from drl_av.drivers.background.finite_state import CRUISE, HardBraking, finite_state, looks_aside
from drl_av.drivers.background.level_k import (
    NO_LEVEL_K,
    LevelKNumbers,
    level_0,
    level_k,
    load_level_k,
)
from drl_av.driving.actions import EgoNumbers, acceleration_of, ego_numbers
from drl_av.driving.affordances import CODES, VALUES, complete
from drl_av.driving.nearest import Along, find_nearest, sort_along
from drl_av.road.road import Road, RoadNumbers, ahead_m, lane_of, road_numbers
from drl_av.road.snapshot import NO_COMMANDS, Snapshot, TrafficCommands, Vehicles
from drl_av.road.vehicle_types import VehicleTypes
from drl_av.safety.reachability import stopping_distance
from drl_av.simulation.population import DriverModel

ORDER = (
    DriverModel.FINITE_STATE,
    DriverModel.LEVEL_0,
    DriverModel.LEVEL_1,
    DriverModel.HARD_BRAKING,
    DriverModel.LEVEL_2,
)
"""The order of the commands, and so of the priority of the vehicles in ``give_way``."""
LEVEL_0, LEVEL_1, LEVEL_2 = (DriverModel[f"LEVEL_{k}"].value for k in range(3))


class TrafficNumbers(NamedTuple):
    """What the decisions depend on besides the scene, for compiled functions."""

    road: RoadNumbers
    range_m: float
    machine: FiniteStateConfig
    table: Level0Config
    level_1: LevelKNumbers
    level_2: LevelKNumbers
    ego: EgoNumbers
    """The accelerations of level-0 drivers, those of the paper's ego."""
    braking_m_s2: float
    """The hardest braking of the vehicles."""
    times_s: tuple[float, float]
    """The time of a decision and of a SUMO step."""


def traffic_numbers(config: Config, road: Road, vehicle_types: VehicleTypes) -> TrafficNumbers:
    """Return the numbers of a config, with the shipped level-k drivers that the traffic has.

    Raises:
        CheckpointError: a level-k driver cannot be read.
    """
    timing, kinds = config.simulation, [each.traffic for each in config.per_traffic_preset]
    has_1, has_2 = any(k.level_1_share for k in kinds), any(k.level_2_share for k in kinds)
    return TrafficNumbers(
        road=road_numbers(road),
        range_m=float(ObservationConfig().range_m),
        machine=config.finite_state.numbers,
        table=config.level_0.numbers,
        level_1=load_level_k(road, 1) if has_1 else NO_LEVEL_K,
        level_2=load_level_k(road, 2) if has_2 else NO_LEVEL_K,
        ego=ego_numbers(EgoConfig(), timing),
        braking_m_s2=float(vehicle_types.traffic.braking_m_s2),
        times_s=(float(timing.decision_interval_s), float(timing.step_length_s)),
    )


class Scratch(NamedTuple):
    """Arrays that a decision needs while it is made."""

    values: FloatArray
    codes: IntArray
    units: Float32Array
    order: IntArray
    places: IntArray
    entering: IntArray
    lanes: IntArray


def scratch_of(traffic: TrafficNumbers, vehicles: int) -> Scratch:
    """Return arrays for the decisions of up to ``vehicles`` vehicles, the ego included."""
    units = max(traffic.level_1.units, traffic.level_2.units)
    return Scratch(
        np.empty(VALUES),
        np.empty(CODES, np.int64),
        np.empty((2, units), np.float32),
        np.empty(vehicles, np.int64),
        np.empty(vehicles, np.int64),
        np.empty(2 * vehicles, np.int64),
        np.empty(2 * vehicles, np.int64),
    )


def in_order(driver_models: IntArray) -> IntArray:
    """Return the rows of the vehicles that SUMO does not drive, in ``ORDER``."""
    of_each = [np.flatnonzero(driver_models == model) for model in ORDER]
    return np.concatenate(of_each).astype(np.int64)


class TrafficDrivers:
    """Makes the decisions of all background vehicles that SUMO does not drive."""

    def __init__(self, config: Config, road: Road, vehicle_types: VehicleTypes) -> None:
        self._config = config
        self._numbers = traffic_numbers(config, road, vehicle_types)

    def start(self, driver_models: IntArray, desired_m_s: FloatArray, seed: int) -> None:
        """Prepare for an episode.

        ``driver_models`` holds the ``DriverModel`` of each vehicle, ``desired_m_s`` its desired
        speed. Both have shape (1 + N,), and the ego comes first. ``seed`` is that of the random
        hard braking.
        """
        n = len(driver_models)
        self._rows = in_order(driver_models)
        self._of_each = driver_models.astype(np.int64), np.ascontiguousarray(desired_m_s, float)
        self.memory = np.full(n, CRUISE, np.int64), np.zeros(n, np.int64)
        """The state of each finite-state machine, and for how many decisions it still brakes."""
        self._found = np.zeros(n), np.zeros(n, np.int64)
        self._scratch = scratch_of(self._numbers, n)
        self._hard_braking = HardBraking(seed, driver_models, self._config)

    def __call__(self, snapshot: Snapshot) -> TrafficCommands:
        """Return the commands of all vehicles that SUMO does not drive, until the next decision."""
        rows = self._rows
        if not len(rows):
            return NO_COMMANDS
        self._hard_braking(self.memory[1])
        of_vehicles = *self._of_each, *self.memory, *self._found
        decide.fast(snapshot.arrays, self._numbers, rows, of_vehicles, self._scratch)
        acceleration_m_s2, side = self._found
        return TrafficCommands(rows, acceleration_m_s2[rows], side[rows])


OfVehicles = tuple[IntArray, FloatArray, IntArray, IntArray, FloatArray, IntArray]
"""The ``DriverModel`` of each vehicle, shape (1 + N,) like all; its desired speed; the state of its
machine; for how many decisions it brakes hard; its acceleration; and its lane change."""


@borrowing
def decide(
    scene: Vehicles,
    traffic: TrafficNumbers,
    rows: IntArray,
    of_vehicles: OfVehicles,
    scratch: Scratch,
) -> None:
    """Compute the decisions of the vehicles ``rows``, shape (R,), in ``ORDER``.

    ``scene`` is ``Snapshot.arrays``. The function updates the states of ``of_vehicles`` and for how
    long they brake, and fills its last two arrays in ``rows``.
    """
    models, desired_m_s, states, braking, acceleration_m_s2, side = of_vehicles
    values, codes, units, order, places = scratch[:5]
    road, lane_m, machine, changes = traffic.road, traffic.road.lane_width_m, traffic.machine, False
    longest_m, right, left = sort_along(scene, lane_m, order, places)
    along, road_m = Along(order, places, longest_m, (right, left)), (road.lap_m, lane_m)
    for row in rows:
        model, state, desired = models[row], states[row], desired_m_s[row]
        is_level_k = model in (LEVEL_1, LEVEL_2)
        sees_all = is_level_k
        driver = traffic.level_2 if model == LEVEL_2 else traffic.level_1
        range_m = driver.range_m if sees_all else traffic.range_m
        while True:
            find_nearest(scene, road_m, along, range_m, row, sees_all, values, codes)
            complete(scene, road, range_m, values, codes, row)
            if sees_all or model == LEVEL_0:
                break
            sees_all = looks_aside(values, codes, lane_m, state, desired, machine)
            if not sees_all:
                break
        if is_level_k:
            acceleration_m_s2[row], side[row] = level_k(values, codes, lane_m, driver, units)
        elif model == LEVEL_0:
            action = level_0(values, codes, traffic.table)
            acceleration_m_s2[row], side[row] = acceleration_of(action, traffic.ego), 0
        else:
            states[row], acceleration_m_s2[row], side[row] = finite_state(
                values, codes, lane_m, state, desired, machine
            )
        if braking[row] > 0:
            braking[row] -= 1
            acceleration_m_s2[row], side[row] = -machine.braking_m_s2, 0
        changes = changes or side[row] != 0
    if changes:
        give_way(rows, side, scene, traffic, scratch)


@borrowing
def give_way(
    rows: IntArray, sides: IntArray, scene: Vehicles, traffic: TrafficNumbers, scratch: Scratch
) -> None:
    """Set those of the wanted lane changes to 0 that conflict with another vehicle's.

    Two vehicles conflict if they enter the same lane from opposite sides, and the rear vehicle
    could not stop behind the front vehicle by braking as hard as it can from the next decision
    on. A vehicle that is already changing lanes has priority. Between two others, the vehicle that
    comes first in ``rows`` has priority.

    Args:
        rows: The row of each vehicle that decides, shape (R,).
        sides: The lane change that each row wants, shape (1 + N,): +1 left, -1 right, 0 none.
        scene: ``Snapshot.arrays``.
        traffic: Its road, braking and times count.
        scratch: Of up to 1 + N vehicles.
    """
    s_m, y_m, speed_m_s, lateral_speed_m_s, length_m, _ = scene
    entering, lanes, width_m = scratch.entering, scratch.lanes, traffic.road.lane_width_m
    count = 0
    for row in range(len(s_m)):  # under way: the lane is the one whose centre it reaches next
        if lateral_speed_m_s[row] != 0.0:
            lane = lane_of(y_m[row], width_m)
            leaves = (y_m[row] - lane * width_m) * lateral_speed_m_s[row] >= 0.0
            toward = 1 if lateral_speed_m_s[row] > 0.0 else -1
            entering[count], lanes[count] = row, lane + toward * leaves
            count += 1
    for row in rows:
        if sides[row] == 0:
            continue
        lane = lane_of(y_m[row], width_m) + sides[row]
        center_m, gives_way = lane * width_m, False
        for place in range(count):
            other = entering[place]
            opposite = (y_m[row] < center_m) != (y_m[other] < center_m)
            if lanes[place] == lane and opposite:
                lead_m = ahead_m(s_m[row], s_m[other], traffic.road.lap_m)
                rear, front = (row, other) if lead_m >= 0.0 else (other, row)
                gap_m = abs(lead_m) - (length_m[row] + length_m[other]) / 2
                rolled_m = closing_distance(speed_m_s[rear], speed_m_s[front], traffic)
                gives_way = gives_way or gap_m < STANDSTILL_GAP_M + rolled_m
        if gives_way:
            sides[row] = 0
        else:
            entering[count], lanes[count] = row, lane
            count += 1


def closing_distance(fast_m_s: float, slow_m_s: float, traffic: TrafficNumbers) -> float:
    """Return by how much a gap shrinks, metres, until both vehicles stand.

    The vehicle behind, of speed ``fast_m_s``, brakes one decision later than the one ahead.
    """
    decision_s, step_s = traffic.times_s
    fast_m = stopping_distance(fast_m_s, traffic.braking_m_s2, step_s)
    slow_m = stopping_distance(slow_m_s, traffic.braking_m_s2, step_s)
    rolled_m: float = decision_s * fast_m_s + max(fast_m - slow_m, 0.0)
    return rolled_m
