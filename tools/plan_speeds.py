"""What reward the shipped driver leaves in its speeds.

    python tools/plan_speeds.py

The shipped driver, and the same one at speeds for which every sequence of five longitudinal
decisions is tried on the reward before each, in the same episodes as ``drl-av reproduce speeds``;
then what that gains, paired by episode.
"""

import argparse
import time
from contextlib import closing

from drl_av.cli.arguments import whole
from drl_av.driving.drivers import Driver
from drl_av.env import HighwayEnv
from drl_av.episode import drive
from drl_av.studies.drivers import PRETRAINED, learned_driver
from drl_av.studies.evaluation import mean_with_interval
from drl_av.studies.planned_speeds import PlannedSpeeds
from drl_av.studies.reproduction.provenance import made_by

VEHICLES = (1, 5, 10, 15, 20, 25, 30)
HORIZON = 5
TERMS = ("mean_reward", "mean_r_v", "mean_r_y", "mean_r_x", "mean_speed_m_s")


def main() -> None:
    """Parse, drive, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=whole(1), default=100, help="a density (default: 100)")
    options = parser.parse_args()
    begun_s = time.monotonic()
    pretrained, config = learned_driver(PRETRAINED)
    drivers: dict[str, Driver] = {
        "pretrained": pretrained,
        "planned speeds": PlannedSpeeds(pretrained, config, HORIZON),
    }
    print(f"{'':<16}" + "".join(f"{term:>20}" for term in (*TERMS, "ego_hit")))
    driven: list[dict[str, list[float]]] = []
    with closing(HighwayEnv(config=config)) as env:
        for name, driver in drivers.items():
            results = [
                drive(env, driver, name, seed, vehicles)
                for vehicles in VEHICLES
                for seed in range(options.episodes)
            ]
            driven.append({term: [getattr(row, term) for row in results] for term in TERMS})
            hits = f"{sum(row.ego_hit for row in results)} of {len(results)}"
            print(line(name, driven[-1]) + f"{hits:>20}", flush=True)
    before, after = driven
    gains = {
        term: [b - a for a, b in zip(before[term], after[term], strict=True)] for term in TERMS
    }
    print(line("gain", gains))
    print(made_by(time.monotonic() - begun_s))


def line(name: str, columns: dict[str, list[float]]) -> str:
    """Means with 95 % intervals."""
    means = map(mean_with_interval, columns.values())
    return f"{name:<16}" + "".join(f"{f'{m.value:.4f} ± {m.half_width:.4f}':>20}" for m in means)


if __name__ == "__main__":
    main()
