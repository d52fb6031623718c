"""Measures speed, lane changes and collisions of the background traffic over episodes."""

import numpy as np

from drl_av.drivers.driver import Driver
from drl_av.env.highway import HighwayEnv
from drl_av.road.snapshot import EGO_ID, Snapshot
from drl_av.simulation.simulation import Simulation
from verification.traffic_moments import lane_changes, snapshots


class TrafficTally:
    """Drives episodes, and collects statistics of the background traffic, without the ego."""

    def __init__(self, env: HighwayEnv) -> None:
        self._env = env
        env.simulation.after_step = self.after_step
        self.vehicle_decisions, self.lane_changes = 0, 0
        self.speeds_m_s: list[float] = []
        """Mean speed of the vehicles after each reset and after each decision."""
        self.colliding = 0
        """Number of vehicles that SUMO reports in a collision; each counts once per episode."""

    def drive(self, driver: Driver, seed: int, vehicles: int) -> None:
        """Drive an episode and update the statistics."""
        self._colliding: set[str] = set()
        shots = snapshots(self._env, driver, seed, vehicles)
        self.speeds_m_s += [float(shot.speed_m_s[1:].mean()) for shot in shots]
        self.lane_changes += lane_changes(shots, self._env.road)
        self.vehicle_decisions += (len(shots) - 1) * vehicles
        self.colliding += len(self._colliding)

    def after_step(self, shot: Snapshot) -> None:
        """Record the collisions that SUMO reports in a step."""
        simulation = self._env.simulation
        assert isinstance(simulation, Simulation)
        for record in simulation._sumo.simulation.getCollisions():
            if EGO_ID not in (record.collider, record.victim):
                self._colliding |= {record.collider, record.victim}

    @property
    def mean_speed_m_s(self) -> float:
        """Mean speed of the vehicles, m/s."""
        return float(np.mean(self.speeds_m_s))

    @property
    def lane_changes_a_minute(self) -> float:
        """Mean number of lane changes of a vehicle per minute."""
        seconds = self.vehicle_decisions * self._env.config.simulation.decision_interval_s
        return 60 * self.lane_changes / seconds
