"""Drives the background vehicles that SUMO does not drive; all decide on the same snapshot."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from drl_av.config import Config
from drl_av.drivers.background.finite_state import HardBraking, State, finite_state
from drl_av.drivers.background.level_k import Level1, level_0
from drl_av.drivers.background.right_of_way import give_way
from drl_av.drivers.background.surroundings import Surroundings, surroundings
from drl_av.drivers.driver import Decisions
from drl_av.road.road import FloatArray, Road
from drl_av.road.snapshot import Snapshot, TrafficCommand
from drl_av.road.vehicle_types import VehicleTypes
from drl_av.simulation.population import DriverModel

IntArray = npt.NDArray[np.intp]


class TrafficDrivers:
    """Makes the decisions of all background vehicles that SUMO does not drive.

    ``level_1`` is the driver of the level-1 vehicles; None if the config has no such vehicles.
    """

    def __init__(
        self, config: Config, road: Road, vehicle_types: VehicleTypes, level_1: Level1 | None
    ) -> None:
        self._config, self._road, self._level_1 = config, road, level_1
        self._braking_m_s2 = vehicle_types.traffic.braking_m_s2
        self._drivers: dict[DriverModel, Callable[[Snapshot, IntArray], Decisions]] = {
            DriverModel.FINITE_STATE: self._by_finite_state,
            DriverModel.LEVEL_0: self._by_level_0,
            DriverModel.LEVEL_1: self._by_level_1,
            DriverModel.HARD_BRAKING: self._by_hard_braking,
        }

    def start(self, driver_models: IntArray, desired_m_s: FloatArray, seed: int) -> None:
        """Prepare for an episode.

        ``driver_models`` holds the ``DriverModel`` of each vehicle, ``desired_m_s`` its desired
        speed. Both have shape (1 + N,), and the ego comes first. ``seed`` is that of the random
        hard braking.
        """
        rows = {kind: np.flatnonzero(driver_models == kind) for kind in self._drivers}
        self._rows = {kind: found for kind, found in rows.items() if len(found)}
        if DriverModel.HARD_BRAKING in self._rows:
            self._hard_braking = HardBraking(seed, len(driver_models), self._config)
        self._desired_m_s = desired_m_s
        self._states = np.full(len(driver_models), State.CRUISE, dtype=np.intp)

    def __call__(self, snapshot: Snapshot) -> list[TrafficCommand]:
        """Return one command for each vehicle that SUMO does not drive.

        The commands hold until the next decision.
        """
        traffic_commands: list[TrafficCommand] = []
        if not self._rows:
            return traffic_commands
        for kind, rows in self._rows.items():
            acceleration, side = self._drivers[kind](snapshot, rows)
            traffic_commands += map(
                TrafficCommand, rows.tolist(), acceleration.tolist(), side.tolist()
            )
        timing, braking_m_s2 = self._config.simulation, self._braking_m_s2
        return give_way(traffic_commands, snapshot, self._road, braking_m_s2, timing)

    def _by_finite_state(self, snapshot: Snapshot, rows: IntArray) -> Decisions:
        neighbors = self._look(snapshot, rows, self._config.observation.range_m)
        self._states[rows], decisions = finite_state(
            neighbors, self._states[rows], self._desired_m_s[rows], self._config.finite_state
        )
        return decisions

    def _by_level_0(self, snapshot: Snapshot, rows: IntArray) -> Decisions:
        neighbors = self._look(snapshot, rows, self._config.observation.range_m)
        return level_0(neighbors, self._config.level_0, self._config.ego)

    def _by_level_1(self, snapshot: Snapshot, rows: IntArray) -> Decisions:
        assert self._level_1 is not None
        return self._level_1(self._look(snapshot, rows, self._level_1.range_m))

    def _by_hard_braking(self, snapshot: Snapshot, rows: IntArray) -> Decisions:
        return self._hard_braking(self._by_finite_state(snapshot, rows), rows)

    def _look(self, snapshot: Snapshot, rows: IntArray, range_m: float) -> Surroundings:
        return surroundings(snapshot, self._road, range_m, rows)
