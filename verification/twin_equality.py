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
from statistics import fmean
from typing import NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.config.traffic import SINGLE_PRESETS
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.env.vector import TwinVectorEnv
from drl_av.road.road import FloatArray
from drl_av.road.snapshot import Snapshot
from verification.program import Program, run_program

DRIVERS = ("idm", "idm-mobil", "gap-mobil", "gap-mobil-1.3", "random")
REQUEST_STEPS = 10
FIRST_SEED = 930_000


def second_ahead(
    vehicles: int, scenes: int, every: int, config: Config, scenario: str
) -> FloatArray:
    """Return the errors of the speeds of all vehicles a second ahead, m/s, from SUMO's scenes."""
    env = HighwayEnv(scenario=scenario, config=config)
    driver = make_drivers(find_drivers(["gap-mobil"]), env.config)["gap-mobil"]
    errors: list[FloatArray] = []
    for seed in range(FIRST_SEED, FIRST_SEED + scenes):
        env.reset(seed=seed, options={"vehicles": vehicles})
        for decision in range(1, 200):
            if len(errors) >= scenes:
                break
            twin = env.fork(1, include_rng=True) if decision % every == 0 else None
            action = driver.act(env.scene, env.observation).number
            done = env.execute(action)
            if done.terminated:
                break
            if twin is not None:
                twin.step(np.array([action]))
                after = twin.scene(0).snapshot.speed_m_s
                errors.append(np.abs(after - env.scene.snapshot.speed_m_s)[1:])
        if len(errors) >= scenes:
            break
    env.close()
    return np.concatenate(errors)


class Drive(NamedTuple):
    """One episode of a driver in one of the worlds."""

    speed_m_s: float
    decisions: int
    lane_changes: int
    vehicle_km: float
    indicators: list[FloatArray]


def in_sumo(env: HighwayEnv, driver: Driver, seed: int, vehicles: int) -> Iterator[Snapshot]:
    """Drive an episode in SUMO; yield each snapshot."""
    env.reset(seed=seed, options={"vehicles": vehicles})
    driver.start(seed)
    yield env.scene.snapshot
    over = False
    while not over:
        done = env.execute(driver.act(env.scene, env.observation).number)
        over = done.terminated or done.truncated
        yield env.scene.snapshot


def in_twin(env: TwinVectorEnv, driver: Driver, seed: int, vehicles: int) -> Iterator[Snapshot]:
    """Drive an episode in the twin; yield each snapshot."""
    observation, _ = env.reset(seed=seed, options={"vehicles": vehicles})
    driver.start(seed)
    yield env.scene(0).snapshot
    over = False
    while not over:
        action = driver.act(env.scene(0), observation[0]).number
        observation, _, terminated, truncated, _ = env.step(np.array([action]))
        over = bool(terminated[0] or truncated[0])
        yield env.scene(0).snapshot


def measured(snapshots: Iterator[Snapshot], lane_m: float) -> Drive:
    """Return what an episode amounts to."""
    speeds, changes, way_m, before, states = [], 0, 0.0, None, []
    for snapshot in snapshots:
        lanes = np.floor(snapshot.y_m / lane_m + 0.5)[1:]
        changes += 0 if before is None else int((lanes != before).sum())
        before = lanes
        speeds.append(float(snapshot.speed_m_s[0]))
        way_m += float(snapshot.speed_m_s[1:].sum())
        states.append(np.concatenate((snapshot.speed_m_s, snapshot.y_m)))
    return Drive(fmean(speeds[1:]), len(speeds) - 1, changes, way_m / 1000, states)


def equal_decisions(one: Drive, other: Drive) -> int:
    """Return for how many decisions the two worlds agree in all speeds and lateral positions."""
    pairs = zip(one.indicators, other.indicators, strict=False)
    wrong = [number for number, (a, b) in enumerate(pairs) if np.abs(a - b).max() > 1e-6]
    return wrong[0] if wrong else min(one.decisions, other.decisions)


def main() -> None:
    """Print the tables of each kind of traffic."""
    program = Program(__doc__)
    program.number("--scenes", 1000, "scenes of each number of vehicles")
    program.number("--episodes", 20, "paired episodes of each driver")
    program.number("--every", 7, "decisions between two scenes of an episode")
    program.add_argument("--vehicles", nargs="+", type=int, default=[5, 10, 20, 30, 40])
    program.add_argument("--scenario", default="circular_three_lane")
    program.some("--traffic", SINGLE_PRESETS)
    given = program.parse_args()
    for kind in given.traffic:
        compare(given, Config().with_traffic(kind), kind)
    print(program.made_by())


def compare(given: Namespace, config: Config, kind: str) -> None:
    """Print both tables of a kind of traffic."""
    print(f"traffic {kind}: speeds a second ahead, of all vehicles, from scenes in SUMO")
    print("vehicles  scenes  to 1e-6 m/s  to 0.2 m/s   mean error m/s")
    for vehicles in given.vehicles:
        errors = second_ahead(vehicles, given.scenes, given.every, config, given.scenario)
        print(
            f"{vehicles:8d}{len(errors) // vehicles:8d}{(errors < 1e-6).mean():13.4f}"
            f"{(errors < 0.2).mean():12.4f}{errors.mean():17.5f}",
            flush=True,
        )
    print("\nthe ego's mean speed in paired episodes, m/s; lane changes of the others per km")
    print("driver         vehicles    SUMO    twin  changes SUMO    twin  equal decisions")
    sumo = HighwayEnv(scenario=given.scenario, config=config)
    twin = TwinVectorEnv(1, scenario=given.scenario, config=config, autoreset_mode="Disabled")
    drivers = make_drivers(find_drivers(list(DRIVERS)), config)
    for name, driver in drivers.items():
        for vehicles in given.vehicles:
            pairs = []
            for seed in range(FIRST_SEED, FIRST_SEED + given.episodes):
                asked = driver, seed, vehicles
                drives = in_sumo(sumo, *asked), in_twin(twin, *asked)
                pairs.append([measured(each, sumo.road.lane_width_m) for each in drives])
            both = list(zip(*pairs, strict=True))
            speeds = [fmean(drive.speed_m_s for drive in each) for each in both]
            changes = [
                sum(drive.lane_changes for drive in each) / sum(drive.vehicle_km for drive in each)
                for each in both
            ]
            equal = sum(equal_decisions(*pair) for pair in pairs)
            total = sum(pair[0].decisions for pair in pairs)
            print(
                f"{name:14s}{vehicles:9d}{speeds[0]:8.2f}{speeds[1]:8.2f}{changes[0]:14.4f}"
                f"{changes[1]:8.4f}{equal:9d} of {total}",
                flush=True,
            )
    print(flush=True)
    sumo.close()


if __name__ == "__main__":
    run_program(main)
