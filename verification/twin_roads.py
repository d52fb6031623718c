"""Compares the compiled twin with SUMO on open roads: the same seeds and the same drivers.

    python -m verification.twin_roads

Each driver drives the same episodes in both worlds, to their ends, in the flow of the scenario. The
table shows the share of the episodes in which it merged or took its exit; its mean speed, and the
mean difference with its 95 % interval; the lane changes of the other vehicles per vehicle-km; and
the share of vehicles, over the decisions that both worlds make, with the same speed and lateral
position (1e-3), of all that have not yet passed the end of the ego's way.
"""

from collections.abc import Sequence
from contextlib import closing
from statistics import fmean
from typing import NamedTuple

import numpy as np

from drl_av.config import Config
from drl_av.config.simulation import WORLDS
from drl_av.drivers.driver import Driver
from drl_av.drivers.registry import find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.env.transition import COMPLETE
from drl_av.evaluation.statistics import mean_with_interval
from drl_av.road.road import Road
from drl_av.road.snapshot import Snapshot
from verification.program import Program, run_program
from verification.traffic_moments import lane_changes

ROADS = ("straight", "merge", "exit", "ramp_to_ramp")
TRAFFIC = ("calm", "overtaking", "naturalistic")
FIRST_SEED = 931_000
EQUAL = 1e-3


class Drive(NamedTuple):
    """One episode in one of the worlds."""

    speed_m_s: float
    is_complete: bool
    """Whether the ego has merged or taken its exit, or had neither to do."""
    shots: list[Snapshot]


def driven(env: HighwayEnv, driver: Driver, seed: int) -> Drive:
    """Drive an episode."""
    made = [*rollout(env, driver, seed, None)]
    shots = [made[0].scene.snapshot, *(one.next_scene.snapshot for one in made)]
    is_complete = not made[-1].terminated and made[-1].route_outcome in ("", *COMPLETE)
    return Drive(fmean(float(shot.speed_m_s[0]) for shot in shots[1:]), is_complete, shots)


def equal_vehicles(one: Sequence[Snapshot], other: Sequence[Snapshot], end_m: float) -> list[bool]:
    """Return of each vehicle but the ego, at each decision of both, whether it is the same."""
    found = []
    for a, b in zip(one[1:], other[1:], strict=False):
        rows = {name: row for row, name in enumerate(b.ids)}
        for row, name in enumerate(a.ids):
            if row and a.s_m[row] < end_m:
                there = rows.get(name)
                found.append(
                    there is not None
                    and abs(a.speed_m_s[row] - b.speed_m_s[there]) < EQUAL
                    and abs(a.y_m[row] - b.y_m[there]) < EQUAL
                )
    return found


def changes_per_km(drives: Sequence[Drive], road: Road) -> float:
    """Return the lane changes of the other vehicles per vehicle-km."""
    metres = sum(float(shot.speed_m_s[1:].sum()) for drive in drives for shot in drive.shots)
    return 1000 * sum(lane_changes(drive.shots, road) for drive in drives) / metres


def compare(road: str, kind: str, drivers: Sequence[str], episodes: int) -> None:
    """Print the rows of a road and a kind of traffic."""
    config = Config().with_traffic(kind)
    worlds = [
        HighwayEnv(road, "paper", config.updated("simulation", world=world)) for world in WORLDS
    ]
    with closing(worlds[0]):
        for name, driver in make_drivers(find_drivers(list(drivers)), config).items():
            seeds = range(FIRST_SEED, FIRST_SEED + episodes)
            both = [[driven(env, driver, seed) for seed in seeds] for env in worlds]
            gain = mean_with_interval(b.speed_m_s - a.speed_m_s for a, b in zip(*both, strict=True))
            end_m = worlds[0].road.end_m
            same = [
                equal
                for a, b in zip(*both, strict=True)
                for equal in equal_vehicles(a.shots, b.shots, end_m)
            ]
            complete = [np.mean([drive.is_complete for drive in drives]) for drives in both]
            changes = [changes_per_km(drives, worlds[0].road) for drives in both]
            speed = fmean(drive.speed_m_s for drive in both[0])
            print(
                f"{road:13s}{kind:13s}{name:12s}{episodes:5d}{complete[0]:7.2f}{complete[1]:6.2f}"
                f"{speed:8.2f}{gain.value:7.2f} +- {gain.half_width:4.2f}{changes[0]:9.3f}"
                f"{changes[1]:7.3f}{np.mean(same):8.3f}",
                flush=True,
            )


def main() -> None:
    """Print the table."""
    program = Program(__doc__)
    program.number("--episodes", 100, "paired episodes of each driver")
    program.drivers("gap-mobil", "idm-mobil")
    program.some("--roads", ROADS)
    program.some("--traffic", TRAFFIC)
    given = program.parse_args()
    print(f"{'complete':>51s}{'speed, m/s':>20s}{'changes a km':>20s}")
    print(
        f"{'road':13s}{'traffic':13s}{'driver':12s} runs   SUMO  twin    SUMO twin minus SUMO",
        end="",
    )
    print("    SUMO   twin   equal")
    for road in given.roads:
        for kind in given.traffic:
            compare(road, kind, given.driver, given.episodes)
    print(program.made_by())


if __name__ == "__main__":
    run_program(main)
