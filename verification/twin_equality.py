"""Compares the compiled twin with SUMO: the same seeds, the same drivers, the same commands.

    python -m verification.twin_equality --jobs 2

1. One second ahead: scenes of episodes in SUMO are copied into the twin with the true parameters of
   their vehicles, and both worlds advance by one decision with the same commands of the ego. What
   SUMO's drivers remember is not copied.
2. Paired episodes: each driver drives the same episodes in both worlds, to their ends. The table
   shows the ego's mean speed and its paired difference, the lane changes of the other vehicles per
   vehicle-km, and for which share of the decisions from the start all speeds and lateral positions
   are equal in both worlds (1e-6). Below it are the lane changes of all episodes, and whether both
   worlds order the drivers alike.
"""

from collections.abc import Iterator
from contextlib import closing
from itertools import combinations, count, islice
from statistics import fmean
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import Config
from drl_av.config.simulation import WORLDS
from drl_av.config.traffic import SINGLE_PRESETS
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.evaluation.engines import workers
from drl_av.evaluation.statistics import mean_with_interval
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
    """Return after how many decisions the two worlds still agree in all speeds and positions."""
    pairs = zip(one.indicators[1:], other.indicators[1:], strict=False)
    equal = [np.abs(a - b).max() <= 1e-6 for a, b in pairs]
    return [*equal, False].index(False)


class Cell(NamedTuple):
    """Paired episodes of one driver in one kind of traffic, among so many vehicles."""

    kind: str
    driver: str
    vehicles: int


class Paired(NamedTuple):
    """What the episodes of a cell had in SUMO and in the twin, one entry each."""

    speeds_m_s: tuple[list[float], list[float]]
    lane_changes: tuple[int, int]
    vehicle_km: tuple[float, float]
    equal: float
    """The share of the decisions before the worlds differ."""


def paired(episodes: int, cell: Cell) -> Paired:
    """Drive the episodes of a cell in both worlds."""
    config = Config().with_traffic(cell.kind)
    driver = make_drivers(find_drivers([cell.driver]), config)[cell.driver]
    seeds = range(FIRST_SEED, FIRST_SEED + episodes)
    worlds = [HighwayEnv(config=config.updated("simulation", world=world)) for world in WORLDS]
    with closing(worlds[0]), closing(worlds[1]):
        pairs = [[driven(each, driver, seed, cell.vehicles) for each in worlds] for seed in seeds]
    sumo, twin = zip(*pairs, strict=True)
    return Paired(
        ([one.speed_m_s for one in sumo], [one.speed_m_s for one in twin]),
        (sum(one.lane_changes for one in sumo), sum(one.lane_changes for one in twin)),
        (sum(one.vehicle_km for one in sumo), sum(one.vehicle_km for one in twin)),
        sum(equal_decisions(*pair) for pair in pairs)
        / sum(len(one.indicators) - 1 for one in sumo),
    )


def errors_ahead(scenes: int, kind: str, vehicles: int) -> FloatArray:
    """Return the errors of the speeds of all vehicles a second ahead, m/s, of all scenes."""
    with closing(HighwayEnv(config=Config().with_traffic(kind))) as env:
        return np.concatenate([*islice(seconds_ahead(env, vehicles), scenes)])


def main() -> None:
    """Print the tables of each kind of traffic."""
    program = Program(__doc__)
    program.number("--scenes", 1000, "scenes of each number of vehicles")
    program.number("--episodes", 200, "paired episodes of each driver and number of vehicles")
    program.numbers("--vehicles", (5, 10, 20, 30, 40))
    program.some("--traffic", SINGLE_PRESETS)
    program.number("--jobs", 1, "number of processes")
    given = program.parse_args()
    with workers(given.jobs) as submit:
        for kind in given.traffic:
            ahead = [submit(errors_ahead, given.scenes, kind, n) for n in given.vehicles]
            cells = [Cell(kind, driver, n) for driver in DRIVERS for n in given.vehicles]
            driven_cells = [submit(paired, given.episodes, cell) for cell in cells]
            print(f"traffic {kind}: speeds a second ahead, of all vehicles, from scenes in SUMO")
            print("vehicles  scenes  to 1e-6 m/s  to 0.2 m/s   mean error m/s")
            for vehicles, future in zip(given.vehicles, ahead, strict=True):
                errors = future.result()
                print(
                    f"{vehicles:8d}{len(errors) // vehicles:8d}{(errors < 1e-6).mean():13.4f}"
                    f"{(errors < 0.2).mean():12.4f}{errors.mean():17.5f}",
                    flush=True,
                )
            found = [future.result() for future in driven_cells]
            print_pairs(dict(zip(cells, found, strict=True)))
    print(program.made_by())


def print_pairs(found: dict[Cell, Paired]) -> None:
    """Print the table of the paired episodes of one kind of traffic, and what it sums up to."""
    episodes = len(next(iter(found.values())).speeds_m_s[0])
    print(f"\nthe ego's mean speed in {episodes} paired episodes, m/s, with 95 % intervals;")
    print("lane changes of the others per vehicle-km")
    print("driver         vehicles    SUMO  twin less SUMO  changes SUMO    twin  equal decisions")
    for cell, pairs in found.items():
        sumo, twin = map(np.array, pairs.speeds_m_s)
        less = mean_with_interval(twin - sumo)
        changes = [n / km for n, km in zip(pairs.lane_changes, pairs.vehicle_km, strict=True)]
        print(
            f"{cell.driver:14s}{cell.vehicles:9d}{sumo.mean():8.2f}{less.value:9.3f} ± "
            f"{less.half_width:.3f}{changes[0]:14.4f}{changes[1]:8.4f}{pairs.equal:15.0%}"
        )
    count = [sum(each) for each in zip(*(one.lane_changes for one in found.values()), strict=True)]
    km = [sum(each) for each in zip(*(one.vehicle_km for one in found.values()), strict=True)]
    print(f"lane changes in all: {count[1] / km[1] / (count[0] / km[0]) - 1:+.1%} in the twin")
    apart = same = 0
    for one, other in combinations(found, 2):
        if one.vehicles == other.vehicles:
            sumo, twin = (
                np.subtract(found[one].speeds_m_s[world], found[other].speeds_m_s[world])
                for world in (0, 1)
            )
            less = mean_with_interval(sumo)
            if abs(less.value) > less.half_width:
                apart += 1
                same += bool(twin.mean() * less.value > 0)
    print(f"pairs of drivers that SUMO's interval separates: {apart}; in the same order: {same}\n")


if __name__ == "__main__":
    run_program(main)
