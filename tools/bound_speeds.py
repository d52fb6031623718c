"""What no driver can exceed: full throttle from the start, and nobody in its way.

    python tools/bound_speeds.py

The ego's mean speed in the episodes of ``drl-av reproduce speeds`` if it accelerated at
``ego.accelerate_m_s2`` to ``ego.max_speed_m_s`` on an empty road, and what that gains on the best
driver by rule in ``docs/results/evaluation.csv``, paired by episode: the most that anybody could.
"""

import argparse
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.evaluation.paired import paired
from drl_av.experiments.density_sweep import BASELINES, TABLE, episode_of
from drl_av.experiments.provenance import made_by
from drl_av.experiments.tables import read_rows

BOUND = "full throttle"
VEHICLES = (1, 5, 10)
RESULTS = Path(__file__).parents[1] / "docs" / "results"


def main() -> None:
    """Read, compare, print."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    begun_s = time.monotonic()
    episodes = [
        episode
        for episode in map(episode_of, read_rows(RESULTS / TABLE))
        if episode.vehicles in VEHICLES and episode.driver in BASELINES
    ]
    with closing(HighwayEnv(config=Config())) as env:
        bounds = [
            replace(
                episode,
                driver=BOUND,
                mean_speed_m_s=fastest_m_s(env, episode.seed, episode.vehicles),
            )
            for episode in episodes
            if episode.driver == BASELINES[0]
        ]
    print(f"{'vehicles':>8}{'best by rule':>16}{'most to gain, m/s':>24}")
    for gain in paired([*episodes, *bounds], BOUND, BASELINES):
        if gain.best:
            mean, half_width = gain.difference_m_s
            told = f"{mean:.4f} ± {half_width:.4f}"
            print(f"{gain.vehicles:>8}{gain.baseline:>16}{told:>24}")
    print(made_by(time.monotonic() - begun_s))


def fastest_m_s(env: HighwayEnv, seed: int, vehicles: int) -> float:
    """Mean over the decisions of the speed after each."""
    env.reset(seed=seed, options={"vehicles": vehicles})
    ego, simulation = env.config.ego, env.config.simulation
    ends_s = simulation.decision_interval_s * np.arange(1, simulation.decisions_per_episode + 1)
    speeds = env.scene.affordances.ego_speed_m_s + ego.accelerate_m_s2 * ends_s
    return float(np.minimum(speeds, ego.max_speed_m_s).mean())


if __name__ == "__main__":
    main()
