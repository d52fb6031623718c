"""What no driver can exceed: full throttle from the start, and nobody in its way.

    python tools/bound_speeds.py

The ego's mean speed in the episodes of ``drl-av reproduce speeds`` if it accelerated at
``ego.accelerate_m_s2`` to ``ego.max_speed_m_s`` on an empty road; the best driver by rule, from
``docs/results/evaluation.csv``; and the most that anybody could gain on it, paired by episode.
"""

import argparse
import csv
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from drl_av.config import Config
from drl_av.env import HighwayEnv
from drl_av.studies.evaluation import mean_with_interval
from drl_av.studies.reproduction.provenance import made_by

VEHICLES = (1, 5, 10)
BY_RULE = ("idm", "idm-mobil", "idm-sumo")
EVALUATION = Path(__file__).parents[1] / "docs" / "results" / "evaluation.csv"


def main() -> None:
    """Read, compare, print."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    begun_s = time.monotonic()
    driven: dict[tuple[int, str], dict[int, float]] = {}
    with EVALUATION.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            of_driver = driven.setdefault((int(row["vehicles"]), row["driver"]), {})
            of_driver[int(row["seed"])] = float(row["mean_speed_m_s"])
    print(f"{'vehicles':>8}{'at most':>20}{'best by rule':>32}{'most to gain':>20}")
    with closing(HighwayEnv(config=Config())) as env:
        for vehicles in VEHICLES:
            name = max(BY_RULE, key=lambda name: np.mean([*driven[vehicles, name].values()]))
            speeds = driven[vehicles, name]
            bounds = {seed: fastest_m_s(env, seed, vehicles) for seed in speeds}
            gains = [bounds[seed] - speed for seed, speed in speeds.items()]
            print(
                f"{vehicles:>8}{told([*bounds.values()]):>20}"
                f"{f'{name} {told([*speeds.values()])}':>32}{told(gains):>20}"
            )
    print(made_by(time.monotonic() - begun_s))


def fastest_m_s(env: HighwayEnv, seed: int, vehicles: int) -> float:
    """Mean over the decisions of the speed after each."""
    env.reset(seed=seed, options={"vehicles": vehicles})
    ego, simulation = env.config.ego, env.config.simulation
    ends_s = simulation.decision_interval_s * np.arange(1, simulation.decisions_per_episode + 1)
    speeds = env.scene.seen.ego_speed_m_s + ego.accelerate_m_s2 * ends_s
    return float(np.minimum(speeds, ego.max_speed_m_s).mean())


def told(values: list[float]) -> str:
    """A mean with its 95 % interval."""
    mean = mean_with_interval(values)
    return f"{mean.value:.4f} ± {mean.half_width:.4f}"


if __name__ == "__main__":
    main()
