"""What the SUMO step length changes in the traffic, and what it costs.

    python tools/compare_step_lengths.py --out docs/results/step_length.csv

For each step length the same seeded episodes with 30 vehicles, the ego driven by ``idm``: mean
speed of the traffic, lane changes a vehicle, vehicles that SUMO reports in a collision, decisions
a second. Integration is semi-implicit Euler, SUMO's default.
"""

import argparse
import csv
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from unittest.mock import patch

import libsumo
import numpy as np

from drl_av.config import Config
from drl_av.drivers.rules import IdmDriver
from drl_av.driving.scene import Scene
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.experiments.provenance import provenance
from drl_av.experiments.store import write_sidecar

STEP_LENGTHS_S = (1.0, 0.5, 0.25, 0.2, 0.1)
SEEDS = 2_000


class TrafficTally:
    """What the traffic does, the ego left out: looked at each decision, collisions each step."""

    def __init__(self) -> None:
        self.speeds: list[float] = []
        self.lanes: list[np.ndarray] = []
        self.colliding: set[str] = set()

    def look(self, scene: Scene) -> None:
        """One scene of the episode."""
        snapshot, lane_width_m = scene.snapshot, scene.affordances.lane_width_m
        self.speeds.append(float(snapshot.speed_m_s[1:].mean()))
        self.lanes.append(np.floor(snapshot.y_m[1:] / lane_width_m + 0.5))

    def step(self, simulation_step: Callable[[], None]) -> None:
        """One SUMO step."""
        simulation_step()
        for record in libsumo.simulation.getCollisions():
            if "ego" not in (record.collider, record.victim):
                self.colliding |= {record.collider, record.victim}


def measure(step_length_s: float, episodes: int, vehicles: int) -> dict[str, float]:
    """One row of the table."""
    config = Config().updated("simulation", step_length_s=step_length_s)
    env, speeds, changes, colliding = HighwayEnv(config=config), [], 0, 0
    begun, decisions = time.perf_counter(), 0
    for seed in range(SEEDS, SEEDS + episodes):
        tally = TrafficTally()
        stepping = partial(tally.step, libsumo.simulationStep)
        with patch.object(libsumo, "simulationStep", stepping):
            for decision in rollout(env, IdmDriver(config.safety), seed, vehicles):
                if not tally.speeds:
                    tally.look(decision.scene)
                tally.look(decision.next_scene)
                decisions += 1
        speeds += tally.speeds
        changes += int(np.count_nonzero(np.diff(np.array(tally.lanes), axis=0)))
        colliding += len(tally.colliding)
    rate = decisions / (time.perf_counter() - begun)
    env.close()
    return {
        "step_length_s": step_length_s,
        "episodes": episodes,
        "vehicles": vehicles,
        "traffic_mean_speed_m_s": round(float(np.mean(speeds)), 3),
        "lane_changes_a_vehicle_and_minute": round(changes / vehicles / decisions * 60, 3),
        "colliding_vehicles": colliding,
        "decisions_a_second": round(rate),
    }


def main() -> None:
    """Measure each step length and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=30, help="(default: 30)")
    parser.add_argument("--vehicles", type=int, default=30, help="(default: 30)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.csv")
    options = parser.parse_args()
    begun_s = time.monotonic()
    rows = [measure(step, options.episodes, options.vehicles) for step in STEP_LENGTHS_S]
    facts = provenance(
        Config(),
        seeds=f"{SEEDS} to {SEEDS + options.episodes - 1}",
        wall_time_s=round(time.monotonic() - begun_s, 1),
    )
    write_sidecar(options.out, {**facts, "step_length_s": STEP_LENGTHS_S})
    with options.out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        print(row)


if __name__ == "__main__":
    main()
