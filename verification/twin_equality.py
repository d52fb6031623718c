"""Compares the compiled twin with SUMO: the same seeds, the same drivers, the same commands.

    python -m verification.twin_equality

1. One second ahead: scenes of episodes in SUMO are copied into the twin with the true parameters of
   their vehicles, and both worlds advance by one decision with the same commands of the ego. What
   SUMO's drivers remember is not copied.
2. Paired episodes: each driver drives the same episodes in both worlds, to their ends. The table
   shows the ego's mean speed, the lane changes of the other vehicles per vehicle-km, and for how
   many decisions all indicators of the ego are equal in both worlds (1e-6).
"""

from argparse import Namespace
from collections.abc import Iterator
from itertools import count, islice
from statistics import fmean
from typing import NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.config.simulation import WORLDS
from drl_av.config.traffic import SINGLE_PRESETS
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.road.road import FloatArray
from verification.program import Program, run_program
from verification.traffic_moments import lane_changes, snapshots

DRIVERS = ("idm", "idm-mobil", "gap-mobil", "gap-mobil-1.3", "random")
EVERY = 7
"""Number of decisions from one scene of an episode to the next."""
FIRST_SEED = 930_000


def seconds_ahead(env: HighwayEnv, vehicles: int) -> Iterator[FloatArray]:
    """Yield the errors of the speeds of all vehicles a second ahead, m/s, from scenes of SUMO."""
    driver = make_drivers(find_drivers(["gap-mobil"]), env.config)["gap-mobil"]
    for seed in count(FIRST_SEED):
        env.reset(seed=seed, options={"vehicles": vehicles})
        for decision in range(1, 200):
            twin = env.fork(1, include_rng=True) if decision % EVERY == 0 else None
            action = driver.act(env.scene, env.observation).number
            if env.execute(action).terminated:
                break
            if twin is not None:
                twin.step(np.array([action]))
                after = twin.scene(0).snapshot.speed_m_s
                yield np.abs(after - env.scene.snapshot.speed_m_s)[1:]


class Drive(NamedTuple):
    """One episode of a driver in one of the worlds."""

    speed_m_s: float
    lane_changes: int
    vehicle_km: float
    indicators: list[FloatArray]


def driven(env: HighwayEnv, driver: Driver, seed: int, vehicles: int) -> Drive:
    """Drive an episode in the world of an environment."""
    shots = snapshots(env, driver, seed, vehicles)
    return Drive(
        fmean(float(shot.speed_m_s[0]) for shot in shots[1:]),
        lane_changes(shots, env.road),
        sum(float(shot.speed_m_s[1:].sum()) for shot in shots) / 1000,
        [np.concatenate((shot.speed_m_s, shot.y_m)) for shot in shots],
    )


def equal_decisions(one: Drive, other: Drive) -> int:
    """Return for how many decisions the two worlds agree in all speeds and lateral positions."""
    pairs = zip(one.indicators, other.indicators, strict=False)
    wrong = [number for number, (a, b) in enumerate(pairs) if np.abs(a - b).max() > 1e-6]
    return wrong[0] if wrong else min(len(one.indicators), len(other.indicators)) - 1


def main() -> None:
    """Print the tables of each kind of traffic."""
    program = Program(__doc__)
    program.number("--scenes", 1000, "scenes of each number of vehicles")
    program.number("--episodes", 20, "paired episodes of each driver")
    program.numbers("--vehicles", (5, 10, 20, 30, 40))
    program.some("--traffic", SINGLE_PRESETS)
    given = program.parse_args()
    for kind in given.traffic:
        compare(given, Config().with_traffic(kind), kind)
    print(program.made_by())


def compare(given: Namespace, config: Config, kind: str) -> None:
    """Print both tables of a kind of traffic."""
    worlds = [HighwayEnv(config=config.updated("simulation", world=world)) for world in WORLDS]
    sumo = worlds[0]
    print(f"traffic {kind}: speeds a second ahead, of all vehicles, from scenes in SUMO")
    print("vehicles  scenes  to 1e-6 m/s  to 0.2 m/s   mean error m/s")
    for vehicles in given.vehicles:
        errors = np.concatenate([*islice(seconds_ahead(sumo, vehicles), given.scenes)])
        print(
            f"{vehicles:8d}{len(errors) // vehicles:8d}{(errors < 1e-6).mean():13.4f}"
            f"{(errors < 0.2).mean():12.4f}{errors.mean():17.5f}",
            flush=True,
        )
    print("\nthe ego's mean speed in paired episodes, m/s; lane changes of the others per km")
    print("driver         vehicles    SUMO    twin  changes SUMO    twin  equal decisions")
    drivers = make_drivers(find_drivers(list(DRIVERS)), config)
    for name, driver in drivers.items():
        for vehicles in given.vehicles:
            pairs = []
            for seed in range(FIRST_SEED, FIRST_SEED + given.episodes):
                pairs.append([driven(world, driver, seed, vehicles) for world in worlds])
            both = list(zip(*pairs, strict=True))
            speeds = [fmean(drive.speed_m_s for drive in each) for each in both]
            changes = [
                sum(drive.lane_changes for drive in each) / sum(drive.vehicle_km for drive in each)
                for each in both
            ]
            equal = sum(equal_decisions(*pair) for pair in pairs)
            total = sum(len(pair[0].indicators) - 1 for pair in pairs)
            print(
                f"{name:14s}{vehicles:9d}{speeds[0]:8.2f}{speeds[1]:8.2f}{changes[0]:14.4f}"
                f"{changes[1]:8.4f}{equal:9d} of {total}",
                flush=True,
            )
    print(flush=True)
    sumo.close()


if __name__ == "__main__":
    run_program(main)
