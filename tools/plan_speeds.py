"""What reward the shipped driver leaves in its speeds.

    python tools/plan_speeds.py

The shipped driver, and its lane changes at speeds for which every sequence of five longitudinal
decisions is tried on the reward before each, in the same episodes as ``drl-av reproduce speeds``.
"""

import argparse
import time
from contextlib import closing

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
    parser.add_argument("--episodes", type=int, default=100, help="a density (default: 100)")
    options = parser.parse_args()
    begun_s = time.monotonic()
    pretrained, config = learned_driver(PRETRAINED)
    drivers: dict[str, Driver] = {
        "pretrained": pretrained,
        "planned speeds": PlannedSpeeds(pretrained, config, HORIZON),
    }
    print(f"{'':<16}" + "".join(f"{term:>20}" for term in (*TERMS, "ego_hit")))
    with closing(HighwayEnv(config=config)) as env:
        for name, driver in drivers.items():
            results = [
                drive(env, driver, name, seed, vehicles)
                for vehicles in VEHICLES
                for seed in range(options.episodes)
            ]
            means = [mean_with_interval(getattr(row, term) for row in results) for term in TERMS]
            told = [f"{mean.value:.4f} ± {mean.half_width:.4f}" for mean in means]
            hits = f"{sum(row.ego_hit for row in results)} of {len(results)}"
            print(f"{name:<16}" + "".join(f"{text:>20}" for text in (*told, hits)), flush=True)
    print(made_by(time.monotonic() - begun_s))


if __name__ == "__main__":
    main()
