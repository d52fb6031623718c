"""Drives a scene of the falsifier in SUMO with the speeds of the simulator of ``adversary.py``."""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from drl_av.config import Config
from drl_av.config.traffic import NO_PAPER_DRIVERS
from drl_av.road.road import holds
from drl_av.road.snapshot import Collision, CollisionKind, Command
from drl_av.scenarios.folder import (
    PlacedVehicle,
    ScenarioDescription,
    load_scenario,
    write_scenario,
)
from drl_av.scenarios.highways import StraightDescription
from drl_av.simulation.simulation import Simulation
from drl_av.simulation.vehicle_calls import take_control
from verification.adversary import LENGTH_M, WIDTH_M, BatchCheck, Mover, Orders, World
from verification.open_families import EXIT, MERGE

LAP_M = 2000.0
START_M = 500.0
"""Position of the ego's front bumper along the road at the start."""
ROADS = {
    "loop": ScenarioDescription(circumference_m=LAP_M),
    "straight": StraightDescription(length_m=LAP_M, flow_per_h=0.0),
    "merge": MERGE,
    "exit": EXIT,
}
"""The roads, by name. They are so long that each scene ends before the ego reaches their end."""
HALF_M = LENGTH_M / 2


class SumoWorld:
    """Drives scenes in SUMO and in this simulator at the same time, and compares them.

    ``road`` is a key of ``ROADS``.
    """

    def __init__(self, config: Config, road: str = "loop") -> None:
        self._files = tempfile.TemporaryDirectory()
        folder = Path(self._files.name, road)
        write_scenario(folder, ROADS[road])
        self._scenario = load_scenario(folder)
        self._config = config.updated(  # the commands of a world stand as they are
            "traffic",
            **NO_PAPER_DRIVERS,
            random_lane_changes_per_s=0.0,
            keep_stopping_distance=False,
        )

    def play(
        self, world: World, commands: Iterator[Orders], check: BatchCheck, mover: Mover
    ) -> tuple[Collision | None, Collision | None, float]:
        """Drive a world of one scene to its first collision or its end.

        The scene also ends when a vehicle reaches the end of the road, and when another vehicle
        than the ego drives beyond the end of its lane, which is impossible in SUMO.

        Returns:
            The ego's collision in SUMO; its collision in the simulator (both None without one); and
            the largest deviation between the vehicles' positions in both, m.
        """
        simulation = self._start(world)
        apart_m, to_s_m = 0.0, self._to_s_m(world)
        for order in commands:
            executed = check(world, order.proposal)
            for speeds, places_m in mover.steps(world, executed, order):
                if not self._on_road(world.x_m[0] + to_s_m, places_m[0]):
                    return None, None, apart_m
                self._command_others(speeds[0], places_m[0])
                command = Command(float(speeds[0, 0]), float(places_m[0, 0]), 0.0)
                shot, hit = simulation.advance([command])
                if hit is not None and hit.kind is CollisionKind.HIT_EDGE:
                    return hit, world.collisions.get(0), apart_m
                off_m = np.abs(self._scenario.road.ahead_m(world.x_m[0] + to_s_m, shot.s_m))
                apart_m = max(apart_m, float(off_m.max()))
                apart_m = max(apart_m, float(np.abs(shot.y_m - world.y_m[0]).max()))
                if hit is not None or world.collisions:
                    return hit, world.collisions.get(0), apart_m
        return None, None, apart_m

    def _to_s_m(self, world: World) -> float:
        """Return the position along SUMO's road minus the position in the world, m."""
        shift_m = START_M - HALF_M - float(world.x_m[0, 0])
        return 0.0 if self._scenario.road.partial_lanes else shift_m

    def _on_road(self, s_m: np.ndarray, y_m: np.ndarray) -> bool:
        """Return whether all vehicles are before the road's end, and the others on existing lanes.

        ``s_m`` and ``y_m`` are the positions of the centres along and across the road, shape
        (1 + others,).
        """
        road, fronts_m = self._scenario.road, s_m + HALF_M
        others = zip(y_m[1:].tolist(), fronts_m[1:].tolist(), strict=True)
        stays = all(holds(y, WIDTH_M, front_m, road) for y, front_m in others)
        return stays and bool(fronts_m.max() < road.end_m)

    def _start(self, world: World) -> Simulation:
        """Start SUMO with the vehicles of a world; return the simulation.

        SUMO places vehicles only at the centres of lanes. If a vehicle of the world is beside a
        centre, SUMO starts one step earlier, and the vehicles reach their positions in this step.
        """
        lane = np.round(world.y_m[0] / 3.8)
        beside = bool(np.abs(world.y_m[0] - 3.8 * lane).max() > 0)
        before_m = beside * self._config.simulation.step_length_s * world.speed_m_s[0]
        names = ("ego", *(f"vehicle{row}" for row in range(1, world.x_m.shape[1])))
        front_m = world.x_m[0] + self._to_s_m(world) + HALF_M - before_m
        places_m = front_m % self._scenario.road.lap_m
        columns = lane.astype(int), places_m, world.speed_m_s[0], np.full(len(names), 40.0)
        states = zip(names, *(column.tolist() for column in columns), strict=True)
        placed = tuple(PlacedVehicle(*state) for state in states)
        description = replace(self._scenario.description, vehicles=placed)
        simulation = Simulation(replace(self._scenario, description=description), self._config)
        simulation.reset(0, len(names) - 1)
        self._vehicle = simulation._sumo.vehicle
        for name in names[1:]:
            take_control(self._vehicle, name)
        self._names, self._y_m = names, 3.8 * lane
        if beside:
            self._command_others(world.speed_m_s[0], world.y_m[0])
            ego = float(world.speed_m_s[0, 0]), float(world.y_m[0, 0])
            simulation.advance([Command(*ego, 0.0)])
        self._y_m = world.y_m[0].copy()
        return simulation

    def _command_others(self, speeds: np.ndarray, places_m: np.ndarray) -> None:
        for row, name in enumerate(self._names[1:], 1):
            self._vehicle.setSpeed(name, float(speeds[row]))
            if places_m[row] != self._y_m[row]:
                lane, _ = self._scenario.layout.lane_positions[self._vehicle.getLaneID(name)]
                y_m = 3.8 * lane + self._vehicle.getLateralLanePosition(name)
                self._vehicle.changeSublane(name, float(places_m[row] - y_m))
        self._y_m = places_m.copy()
