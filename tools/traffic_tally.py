"""How the traffic around the ego drives: its speed, lane changes and collisions."""

import numpy as np

from drl_av.drivers.driver import Driver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.traffic.population import EGO_ID
from drl_av.traffic.snapshot import Snapshot


class TrafficTally:
    """Sums over the episodes of an environment, without the ego."""

    def __init__(self, env: HighwayEnv) -> None:
        self._env = env
        env.simulation.after_step = self.after_step
        self.vehicle_decisions, self.lane_changes = 0, 0
        self.speeds_m_s: list[float] = []
        """Mean over the vehicles, after the reset and after each decision."""
        self.colliding = 0
        """Vehicles that SUMO reports in a collision with each other, once an episode."""

    def drive(self, driver: Driver, seed: int, vehicles: int) -> None:
        """Add an episode."""
        self._colliding: set[str] = set()
        scenes = []
        for decision in rollout(self._env, driver, seed, vehicles):
            scenes += [decision.scene.snapshot] if not scenes else []
            scenes.append(decision.next_scene.snapshot)
        lane_width_m = self._env.road.lane_width_m
        lanes = [np.floor(shot.y_m[1:] / lane_width_m + 0.5) for shot in scenes]
        self.speeds_m_s += [float(shot.speed_m_s[1:].mean()) for shot in scenes]
        self.lane_changes += int(np.count_nonzero(np.diff(lanes, axis=0)))
        self.vehicle_decisions += (len(scenes) - 1) * vehicles
        self.colliding += len(self._colliding)

    def after_step(self, shot: Snapshot) -> None:
        """Look at a SUMO step."""
        for record in self._env.simulation._sumo.simulation.getCollisions():
            if EGO_ID not in (record.collider, record.victim):
                self._colliding |= {record.collider, record.victim}

    @property
    def mean_speed_m_s(self) -> float:
        """Mean over the scenes."""
        return float(np.mean(self.speeds_m_s))

    @property
    def lane_changes_a_minute(self) -> float:
        """Of a vehicle."""
        seconds = self.vehicle_decisions * self._env.config.simulation.decision_interval_s
        return 60 * self.lane_changes / seconds
