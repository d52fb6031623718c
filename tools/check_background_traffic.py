"""Whether the background traffic collides with itself, and how it drives, mix by mix.

    python tools/check_background_traffic.py --episodes 500
    python tools/check_background_traffic.py --episodes 200 --vehicles 30 --mix calm paper

SUMO drives the ego too, like the vehicles around it, so that nobody is there but traffic. A line
a mix: shares of finite-state machine, level 0 and level 1 (the rest is SUMO's IDM) or a kind of
traffic, episodes,
decisions of vehicles, collisions by SUMO, overlaps of bodies swept through each SUMO step, mean
speed, lane changes a vehicle and minute. Exits with 1 where anything collided.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drl_av.config import TRAFFIC_KINDS, Config
from drl_av.drivers.background.level_1 import load_level_1
from drl_av.drivers.background.traffic import TrafficDrivers
from drl_av.experiments.provenance import made_by
from drl_av.traffic.collisions import bodies, motions
from drl_av.traffic.population import EGO_ID
from drl_av.traffic.scenario import Scenario, find_scenario, load_scenario
from drl_av.traffic.simulation import Simulation
from drl_av.traffic.snapshot import EGO, Command, Snapshot

MIXES = (
    "0,0,0",
    "1,0,0",
    "0,1,0",
    "0,0.5,0",
    "0,0,1",
    "0.3,0.3,0.4",
    "0.4,0.3,0.3",
    "0.25,0.25,0.25",
)
SEEDS = 810_000
DEFAULT_SPEED_MODE, DEFAULT_LANE_CHANGE_MODE = 31, 1621
LATERAL_SPEED_M_S = 0.76
NOTHING = Command(0.0, 0.0, 0.0)


class Background(Simulation):
    """Traffic alone: SUMO drives the ego as it drives the others, whatever it is commanded."""

    def __init__(self, scenario: Scenario, config: Config) -> None:
        super().__init__(scenario, config)
        self.after_step = self._watch
        self.seen_by_sumo, self.swept = 0, 0

    def reset(self, seed: int, vehicles: int) -> Snapshot:
        """Start an episode and hand the ego over to SUMO."""
        super().reset(seed, vehicles)
        vehicle = self._sumo.vehicle
        vehicle.setSpeedMode(EGO_ID, DEFAULT_SPEED_MODE)
        vehicle.setLaneChangeMode(EGO_ID, DEFAULT_LANE_CHANGE_MODE)
        vehicle.setMaxSpeedLat(EGO_ID, LATERAL_SPEED_M_S)
        self._before = self._snapshot()
        return self._before

    def _command(self, command: Command) -> bool:
        return True

    def _watch(self, shot: Snapshot) -> None:
        moves = motions(self._before, shot, self.road)
        self._before = shot
        self.swept += len(bodies(shot, self.road).collisions(moves))
        self.seen_by_sumo += self._sumo.simulation.getCollidingVehiclesNumber()
        self._ego_lateral_speed_m_s = self._sumo.vehicle.getLateralSpeed(EGO_ID)


class Tally(NamedTuple):
    """What one mix did."""

    decisions: int
    seen_by_sumo: int
    swept: int
    mean_speed_m_s: float
    lane_changes_a_minute: float


def check(config: Config, episodes: int, vehicles: Sequence[int]) -> Tally:
    """Drive the episodes of a mix, the numbers of vehicles in turn."""
    scenario = load_scenario(find_scenario(config.simulation.scenario))
    simulation, road = Background(scenario, config), scenario.road
    level_1 = load_level_1(road) if config.traffic.level_1_share else None
    drivers = TrafficDrivers(config, road, scenario.vehicle_types, level_1)
    steps = config.simulation.steps_per_decision
    decisions, changes, speeds = 0, 0, []
    for episode in range(episodes):
        shot = simulation.reset(SEEDS + episode, vehicles[episode % len(vehicles)])
        drivers.start(simulation.kinds, simulation.desired_speed_m_s, SEEDS + episode)
        lanes = []
        for _ in range(config.simulation.decisions_per_episode):
            shot, _ = simulation.advance([NOTHING] * steps, drivers(shot))
            others = np.arange(len(shot.ids)) != EGO
            lanes.append(np.floor(shot.y_m[others] / road.lane_width_m + 0.5))
            speeds.append(shot.speed_m_s[others])
            decisions += int(others.sum())
        changes += int(np.count_nonzero(np.diff(lanes, axis=0)))
    simulation.close()
    mean_speed = float(np.concatenate(speeds).mean())
    per_minute = 60 * changes / decisions / config.simulation.decision_interval_s
    found = simulation.seen_by_sumo, simulation.swept
    return Tally(decisions, *found, mean_speed, per_minute)


def with_mix(mix: str) -> Config:
    """The default config with a kind of traffic, or with shares, written ``FSM,L0,L1``."""
    if mix in TRAFFIC_KINDS:
        return Config().with_traffic(mix)
    finite_state, level_0, level_1 = map(float, mix.split(","))
    return Config().updated(
        "traffic",
        finite_state_share=finite_state,
        level_0_share=level_0,
        level_1_share=level_1,
    )


def main() -> int:
    """Check each mix and print its line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--episodes", type=int, default=500, help="a mix (default: 500)")
    parser.add_argument(
        "--vehicles",
        type=int,
        nargs="+",
        default=range(1, 31),
        metavar="N",
        help="beside the ego, in turn (default: 1 to 30)",
    )
    kinds = ", ".join(TRAFFIC_KINDS)
    parser.add_argument(
        "--mix", nargs="+", default=MIXES, metavar="MIX", help=f"shares FSM,L0,L1, or: {kinds}"
    )
    options = parser.parse_args()
    collided, begun_s = 0, time.monotonic()
    for mix in options.mix:
        tally = check(with_mix(mix), options.episodes, options.vehicles)
        collided += tally.seen_by_sumo + tally.swept
        print(
            f"{mix}: {options.episodes} episodes, {tally.decisions} vehicle-decisions, "
            f"{tally.seen_by_sumo} collisions, {tally.swept} overlaps, "
            f"{tally.mean_speed_m_s:.2f} m/s, {tally.lane_changes_a_minute:.2f} lane changes "
            "a vehicle and minute",
            flush=True,
        )
    print(made_by(time.monotonic() - begun_s))
    return 1 if collided else 0


if __name__ == "__main__":
    sys.exit(main())
