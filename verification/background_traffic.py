"""Checks that the background traffic has no collisions, and measures how it drives.

    python -m verification.background_traffic --episodes 500
    python -m verification.background_traffic --episodes 200 --vehicles 30 --mix calm paper

SUMO also drives the ego, like the vehicles around it. It prints one line for each mix, which is a
kind of traffic, or the shares of the drivers finite-state, level 0 and level 1 (the rest is SUMO's
IDM). The line gives episodes, decisions of vehicles, vehicles in a collision according to SUMO,
overlaps of bodies swept through each SUMO step, mean speed, and lane changes per vehicle and
minute. The exit status is 1 if anything collided.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import closing

from drl_av.config import TRAFFIC_KINDS, Config
from drl_av.drivers.driver import Driver
from drl_av.drivers.sumo import SumoDriver
from drl_av.env.highway import HighwayEnv
from drl_av.experiments.provenance import made_by
from drl_av.traffic.collisions import bodies, motions
from drl_av.traffic.ego_model import EgoModel
from drl_av.traffic.snapshot import Snapshot
from verification.traffic_tally import TrafficTally

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


class SweptTally(TrafficTally):
    """A TrafficTally that also counts pairs of bodies that touch when swept through a SUMO step."""

    def __init__(self, env: HighwayEnv) -> None:
        super().__init__(env)
        self.overlaps = 0
        self._before: Snapshot | None = None

    def drive(self, driver: Driver, seed: int, vehicles: int) -> None:
        """Drive an episode and add it to the statistics."""
        self._before = None
        super().drive(driver, seed, vehicles)

    def after_step(self, shot: Snapshot) -> None:
        """Add the collisions and overlaps of one SUMO step; ``shot`` is the snapshot after it."""
        super().after_step(shot)
        before = self._before or self._env.scene.snapshot
        moves = motions(before, shot, self._env.road)
        self.overlaps += len(bodies(shot, self._env.road).collisions(moves))
        self._before = shot


def check(config: Config, episodes: int, vehicles: Sequence[int]) -> SweptTally:
    """Drive episodes, with the numbers of vehicles in turn, and return their statistics."""
    with closing(HighwayEnv(config=config)) as env:
        tally = SweptTally(env)
        for episode in range(episodes):
            number = vehicles[episode % len(vehicles)]
            tally.drive(SumoDriver(EgoModel()), SEEDS + episode, number)
    return tally


def with_mix(mix: str) -> Config:
    """Return the default config with a kind of traffic, or with shares written ``FSM,L0,L1``."""
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
    """Drive each mix of drivers and print a line for it; return 1 if vehicles collided, else 0."""
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
        collided += tally.colliding + tally.overlaps
        print(
            f"{mix}: {options.episodes} episodes, {tally.vehicle_decisions} vehicle-decisions, "
            f"{tally.colliding} collisions, {tally.overlaps} overlaps, "
            f"{tally.mean_speed_m_s:.2f} m/s, {tally.lane_changes_a_minute:.2f} lane changes "
            "a vehicle and minute",
            flush=True,
        )
    print(made_by(time.monotonic() - begun_s))
    return 1 if collided else 0


if __name__ == "__main__":
    sys.exit(main())
