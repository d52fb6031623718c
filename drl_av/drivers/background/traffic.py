"""Drives the background vehicles that SUMO does not drive; all decide on the same snapshot."""

import numpy as np

from drl_av.compiled import compiled, numbers
from drl_av.config import Config
from drl_av.drivers.background.finite_state import (
    FiniteStateNumbers,
    HardBraking,
    State,
    finite_state,
)
from drl_av.drivers.background.level_k import Level0Numbers, Level1, level_0
from drl_av.drivers.background.right_of_way import give_way
from drl_av.drivers.driver import Decisions
from drl_av.driving.actions import EgoNumbers, acceleration_of, ego_numbers
from drl_av.driving.affordances import CODES, VALUES, IntArray, indicators
from drl_av.road.road import FloatArray, Road
from drl_av.road.road_numbers import RoadNumbers, road_numbers
from drl_av.road.snapshot import NO_COMMANDS, Snapshot, TrafficCommands
from drl_av.road.vehicle_types import VehicleTypes
from drl_av.simulation.population import DriverModel


class TrafficDrivers:
    """Makes the decisions of all background vehicles that SUMO does not drive.

    ``level_1`` is the driver of the level-1 vehicles; None if the config has no such vehicles.
    """

    def __init__(
        self, config: Config, road: Road, vehicle_types: VehicleTypes, level_1: Level1 | None
    ) -> None:
        self._config, self._level_1 = config, level_1
        self._road = road_numbers(road)
        self._rules = (
            float(config.observation.range_m),
            numbers(FiniteStateNumbers, config.finite_state),
            numbers(Level0Numbers, config.level_0),
            ego_numbers(config.ego, config.simulation),
        )
        timing = config.simulation
        self._right_of_way = (
            (self._road.lap_m, self._road.lane_width_m),
            float(vehicle_types.traffic.braking_m_s2),
            (timing.decision_interval_s, timing.step_length_s),
        )

    def start(self, driver_models: IntArray, desired_m_s: FloatArray, seed: int) -> None:
        """Prepare for an episode.

        ``driver_models`` holds the ``DriverModel`` of each vehicle, ``desired_m_s`` its desired
        speed. Both have shape (1 + N,), and the ego comes first. ``seed`` is that of the random
        hard braking.
        """
        of_each = [np.flatnonzero(driver_models == model) for model in ORDER]
        self._rows, ends = np.concatenate(of_each), np.cumsum([len(rows) for rows in of_each])
        self._part = {
            model: slice(end - len(rows), end)
            for model, rows, end in zip(ORDER, of_each, ends.tolist(), strict=True)
            if len(rows)
        }
        self._models = driver_models[self._rows]
        if DriverModel.HARD_BRAKING in self._part:
            self._hard_braking = HardBraking(seed, len(driver_models), self._config)
        self._desired_m_s = np.ascontiguousarray(desired_m_s, np.float64)
        self._states = np.full(len(driver_models), State.CRUISE, dtype=np.int64)

    def __call__(self, snapshot: Snapshot) -> TrafficCommands:
        """Return the commands of all vehicles that SUMO does not drive, until the next decision."""
        rows = self._rows
        if not len(rows):
            return NO_COMMANDS
        arrays = snapshot.arrays
        acceleration, side = np.empty(len(rows)), np.zeros(len(rows), np.int64)
        of_vehicles = rows, self._models, self._states, self._desired_m_s
        decide.fast(*arrays, self._road, *self._rules, *of_vehicles, acceleration, side)
        if part := self._part.get(DriverModel.LEVEL_1):
            assert self._level_1 is not None
            acceleration[part], side[part] = self._level_1(snapshot, rows[part])
        if part := self._part.get(DriverModel.HARD_BRAKING):
            decisions = Decisions(acceleration[part], side[part])
            acceleration[part], side[part] = self._hard_braking(decisions, rows[part])
        if side.any():
            give_way(rows, side, *arrays[:5], *self._right_of_way)
        return TrafficCommands(rows, acceleration, side)


ORDER = (
    DriverModel.FINITE_STATE,
    DriverModel.LEVEL_0,
    DriverModel.LEVEL_1,
    DriverModel.HARD_BRAKING,
)
"""The order of the commands, and so of the priority of the vehicles in ``give_way``."""
LEVEL_0, LEVEL_1 = DriverModel.LEVEL_0.value, DriverModel.LEVEL_1.value


@compiled
def decide(
    s_m: FloatArray,
    y_m: FloatArray,
    speed_m_s: FloatArray,
    lateral_speed_m_s: FloatArray,
    length_m: FloatArray,
    width_m: FloatArray,
    road: RoadNumbers,
    range_m: float,
    machine: FiniteStateNumbers,
    table: Level0Numbers,
    ego: EgoNumbers,
    rows: IntArray,
    models: IntArray,
    states: IntArray,
    desired_m_s: FloatArray,
    acceleration_m_s2: FloatArray,
    side: IntArray,
) -> None:
    """Compute the decisions of the finite-state machines and of the level-0 drivers.

    The first six arrays are those of a snapshot. ``rows``, shape (R,), holds the rows of the
    vehicles that decide, and ``models`` their ``DriverModel``. ``states`` and ``desired_m_s`` have
    shape (1 + N,); the function updates ``states``. It fills the last two arrays, shape (R,), but
    not for level-1 drivers.
    """
    state = s_m, y_m, speed_m_s, lateral_speed_m_s, length_m, width_m
    values, codes = np.empty(VALUES), np.empty(CODES, np.int64)
    for one in range(len(rows)):
        row, model = rows[one], models[one]
        if model == LEVEL_1:
            continue
        indicators(*state, road, range_m, values, codes, row)
        if model == LEVEL_0:
            acceleration_m_s2[one] = acceleration_of(level_0(values, codes, table), ego)
            continue
        states[row], acceleration_m_s2[one], side[one] = finite_state(
            values, codes, road.lane_width_m, states[row], desired_m_s[row], machine
        )
