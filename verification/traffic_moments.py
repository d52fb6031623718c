"""Measures the background traffic, and compares it with published measurements of real highways.

    python -m verification.traffic_moments --traffic calm naturalistic

SUMO also drives the ego, which is not included. The statistics are over all other vehicles at all
decisions after the first 30 s. They are the speed and, for vehicles with a leader in their lane at
most 120 m ahead, the range (net gap), the time gap (range / speed) and the relative speed.
"""

import math
from collections.abc import Sequence
from contextlib import closing
from typing import NamedTuple

import numpy as np

from drl_av.arrays import FloatArray
from drl_av.config import SINGLE_PRESETS, Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.rule_based import SumoDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.road.road import Road
from drl_av.road.snapshot import EGO, Snapshot
from drl_av.scenarios.folder import find_scenario, load_scenario
from drl_av.simulation.vehicle_calls import EgoModel
from verification.program import Program, run_program

SEEDS = 840_000
WARM_UP_DECISIONS = 30
RANGE_M = 120.0
SHORT_GAP_S = 1.3
VEHICLES = (10, 15, 20, 25, 30, 35)
TOLERANCE = 0.1


class Moments(NamedTuple):
    """Statistics of simulated traffic or of a data set; NaN where there is no number."""

    speed_m_s: float = math.nan
    speed_sd_m_s: float = math.nan
    median_time_gap_s: float = math.nan
    share_below_1_3_s: float = math.nan
    range_p10_m: float = math.nan
    range_p50_m: float = math.nan
    range_p90_m: float = math.nan
    relative_speed_sd_m_s: float = math.nan
    lane_changes_per_km: float = math.nan


US_NATURALISTIC = Moments(30.05, 3.48, 1.12, 0.59, 18, 34, 77, 1.3)
"""Highway driving in the studies Safety Pilot Model Deployment and IVBSS, Michigan."""
HIGHD = Moments(lane_changes_per_km=0.12)
"""The highD data set, Germany."""


class Following(NamedTuple):
    """The F vehicles that follow a leader in their lane at one moment; arrays of shape (F,)."""

    range_m: FloatArray
    time_gap_s: FloatArray
    relative_speed_m_s: FloatArray


def following(shot: Snapshot, road: Road) -> Following:
    """Find the vehicles besides the ego that follow a leader in the same lane.

    A vehicle is in the lane that contains its centre.
    """
    lane = lanes(shot, road)
    ahead_m = (shot.s_m - shot.s_m[:, None]) % road.lap_m
    gap_m = ahead_m - (shot.length_m + shot.length_m[:, None]) / 2
    gap_m[(lane != lane[:, None]) | np.eye(len(lane), dtype=bool)] = np.inf
    rows, leader = np.arange(len(lane)), gap_m.argmin(axis=1)
    found = (gap_m[rows, leader] <= RANGE_M) & (rows != EGO) & (shot.speed_m_s > 0)
    range_m = np.maximum(gap_m[rows, leader], 0.0)[found]
    return Following(
        range_m, range_m / shot.speed_m_s[found], (shot.speed_m_s[leader] - shot.speed_m_s)[found]
    )


def lanes(shot: Snapshot, road: Road) -> FloatArray:
    """Return the index of the lane that contains each vehicle's centre, shape (1 + N,)."""
    return np.floor(shot.y_m / road.lane_width_m + 0.5)


def lane_changes(shots: Sequence[Snapshot], road: Road) -> int:
    """Return how often the vehicles besides the ego change lanes from one snapshot to the next."""
    changes, before = 0, dict[str, int]()
    for shot in shots:
        now = dict(zip(shot.ids[1:], lanes(shot, road)[1:].tolist(), strict=True))
        changes += sum(before.get(name, lane) != lane for name, lane in now.items())
        before = now
    return changes


def snapshots(env: HighwayEnv, driver: Driver, seed: int, vehicles: int) -> list[Snapshot]:
    """Drive an episode; return the snapshots after the reset and after each decision."""
    made = [*rollout(env, driver, seed, vehicles)]
    return [made[0].scene.snapshot, *(decision.next_scene.snapshot for decision in made)]


def moments(config: Config, episodes: int, vehicles: Sequence[int] = VEHICLES) -> Moments:
    """Drive episodes with the numbers of ``vehicles`` in turn; return the traffic's statistics."""
    shots = [drive(config, SEEDS + n, vehicles[n % len(vehicles)]) for n in range(episodes)]
    road = load_scenario(find_scenario(config.simulation.scenario)).road
    speed = np.concatenate([shot.speed_m_s[1:] for episode in shots for shot in episode])
    columns = zip(*(following(shot, road) for episode in shots for shot in episode), strict=True)
    range_m, time_gap_s, relative_m_s = map(np.concatenate, columns)
    changes = sum(lane_changes(episode, road) for episode in shots)
    driven_km = speed.sum() * config.simulation.decision_interval_s / 1000
    gaps = np.median(time_gap_s), (time_gap_s < SHORT_GAP_S).mean()
    ranges_m = np.quantile(range_m, (0.1, 0.5, 0.9))
    found = speed.mean(), speed.std(), *gaps, *ranges_m, relative_m_s.std(), changes / driven_km
    return Moments(*map(float, found))


def drive(config: Config, seed: int, vehicles: int) -> list[Snapshot]:
    """Drive an episode; return the snapshots after each decision, without the first 30."""
    driver = SumoDriver(EgoModel(overtake_right=config.traffic.overtake_right))
    with closing(HighwayEnv(config=config)) as env:
        return snapshots(env, driver, seed, vehicles)[1 + WARM_UP_DECISIONS :]


def table(columns: dict[str, Moments]) -> str:
    """Return the table as text: a row for each statistic, a column for each traffic or data set.

    A ``*`` marks a value within 10 % of that of a data set.
    """
    measured = {"US naturalistic": US_NATURALISTIC, "highD": HIGHD}
    lines = ["".join(f"{word:>22}" for word in ("", *columns, *measured))]
    for name in Moments._fields:
        values = [getattr(column, name) for column in columns.values()]
        ours = [f"{value:.2f}{mark(name, value)}" for value in values]
        theirs = [f"{getattr(one, name):.2f} ".replace("nan", "-") for one in measured.values()]
        lines.append("".join(f"{word:>22}" for word in (name, *ours, *theirs)))
    return "\n".join(lines)


def mark(name: str, value: float) -> str:
    """Return ``*`` if the value is within 10 % of that of a data set, otherwise a blank."""
    known = [getattr(one, name) for one in (US_NATURALISTIC, HIGHD)]
    near = any(abs(value - one) <= TOLERANCE * one for one in known if not math.isnan(one))
    return "*" if near else " "


def main() -> None:
    """Drive each kind of traffic and print the table."""
    parser = Program(__doc__)
    parser.number("--episodes", 60, "for each kind of traffic")
    parser.numbers("--vehicles", VEHICLES, low=2)
    parser.some("--traffic", SINGLE_PRESETS)
    options = parser.parse_args()
    size, kinds = (options.episodes, options.vehicles), options.traffic
    print(table({kind: moments(Config().with_traffic(kind), *size) for kind in kinds}))
    print("* within 10 % of a measured number")


if __name__ == "__main__":
    run_program(main)
