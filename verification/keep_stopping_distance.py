"""Measures what ``traffic.keep_stopping_distance`` costs the traffic, and what it prevents.

    python -m verification.keep_stopping_distance --episodes 20 --vehicles 5 10 20 30 40

Each episode is driven twice, with the same seed: once as SUMO's IDM alone drives, and once with
vehicles that stay slow enough to stop behind the vehicle ahead. In the first table SUMO drives the
ego too. The program prints the mean speed of the other vehicles without the setting, the change by
the setting with its 95 % interval over the episodes, and the pairs of other vehicles whose bodies
touch. In the second table the ego acts at random, and so brakes hard at random, under the check
``paper``; an episode ends if the ego collides.
"""

from collections.abc import Sequence
from contextlib import closing

import numpy as np

from drl_av.cli.options import int_at_least
from drl_av.config import TRAFFIC_PRESETS, Config
from drl_av.drivers.registry import driving_config, find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.road.road import FloatArray
from verification.background_traffic import SEEDS, SweptTally
from verification.program import Program, run_program

VEHICLES = (1, 5, 10, 20, 30, 40)
SETTING = "keep_stopping_distance"


def measured(
    config: Config, ego: str, seeds: Sequence[int], vehicles: int
) -> tuple[FloatArray, int, int]:
    """Drive one episode a seed; ``ego`` names the ego's driver.

    Returns:
        The mean speed of the other vehicles in each episode, m/s, shape (episodes,); the number of
        pairs of them that touch; and the number of decisions of all vehicles.
    """
    specs = find_drivers([ego])
    [driver] = make_drivers(specs, driving_config(specs, config)).values()
    speeds, pairs, decisions = [], 0, 0
    with closing(HighwayEnv(config=config)) as env:
        for seed in seeds:
            tally = SweptTally(env)
            tally.drive(driver, seed, vehicles)
            speeds.append(tally.mean_speed_m_s)
            pairs += len(tally.overlaps)
            decisions += tally.vehicle_decisions
    return np.array(speeds), pairs, decisions


def row(traffic: str, ego: str, episodes: int, vehicles: int) -> str:
    """Return the line of one number of vehicles: speeds, change, and pairs that touch."""
    base = Config().with_traffic(traffic)
    seeds = range(SEEDS, SEEDS + episodes)
    (idm, idm_pairs, many), (kept, kept_pairs, _) = (
        measured(base.updated("traffic", **{SETTING: keeps}), ego, seeds, vehicles)
        for keeps in (False, True)
    )
    change = 100 * (kept - idm) / idm
    half = 1.96 * change.std(ddof=1) / np.sqrt(episodes) if episodes > 1 else np.inf
    return (
        f"{vehicles:8d} {idm.mean():10.3f} {change.mean():+9.3f} % +- {half:5.3f} "
        f"{idm_pairs:8d} {kept_pairs:8d} {many:10d}"
    )


def main() -> None:
    """Drive the episodes and print both tables."""
    parser = Program(__doc__)
    parser.number("--episodes", 20, "for each number of vehicles", low=2)
    parser.add_argument(
        "--traffic", choices=list(TRAFFIC_PRESETS), default="calm", help="default: calm"
    )
    parser.add_argument(
        "--vehicles", type=int_at_least(1), nargs="+", default=VEHICLES, metavar="N"
    )
    options = parser.parse_args()
    for ego in ("sumo", "random"):
        print(f"ego {ego}, traffic {options.traffic}, {options.episodes} episodes a row")
        print("vehicles  speed m/s  change by the setting   pairs  with it  decisions")
        for vehicles in options.vehicles:
            print(row(options.traffic, ego, options.episodes, vehicles), flush=True)
    print(parser.made_by())


if __name__ == "__main__":
    run_program(main)
