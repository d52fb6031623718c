"""Computes the gain over the best rule-based driver that no driver can exceed.

    python tools/bound_speeds.py

The bound on the mean speed is that of an ego which accelerates at ``ego.accelerate_m_s2`` to
``ego.max_speed_m_s`` on an empty road, in the episodes of ``docs/results/density_sweep.csv``. The
gain of this bound over the best of the table's rule-based drivers is paired by episode.
"""

import argparse
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from drl_av.config import Config
from drl_av.env.highway import HighwayEnv
from drl_av.evaluation.paired import Speed, paired
from drl_av.experiments.density_sweep import OPPONENTS, TABLE
from drl_av.experiments.provenance import made_by
from drl_av.files import read_rows

BOUND = "full throttle"
VEHICLES = (1, 5, 10)
RESULTS = Path(__file__).parents[1] / "docs" / "results"


def main() -> None:
    """Print the largest possible gain at each number of vehicles."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    begun_s = time.monotonic()
    episodes = [
        episode
        for episode in read_rows(RESULTS / TABLE, Speed)
        if episode.vehicles in VEHICLES and episode.driver in OPPONENTS
    ]
    with closing(HighwayEnv(config=Config())) as env:
        bounds = [
            episode._replace(driver=BOUND, mean_speed_m_s=fastest_m_s(env, episode))
            for episode in episodes
            if episode.driver == OPPONENTS[0]
        ]
    print(f"{'vehicles':>8}{'best by rule':>16}{'most to gain, m/s':>24}")
    for gain in paired([*episodes, *bounds], BOUND, OPPONENTS):
        if gain.best:
            mean, half_width = gain.difference_m_s
            most = f"{mean:.4f} ± {half_width:.4f}"
            print(f"{gain.vehicles:>8}{gain.baseline:>16}{most:>24}")
    print(made_by(time.monotonic() - begun_s))


def fastest_m_s(env: HighwayEnv, episode: Speed) -> float:
    """Return the ego's mean speed over an episode if no vehicle were in its way, m/s.

    The mean is over the speeds after each decision.
    """
    env.reset(seed=episode.seed, options={"vehicles": episode.vehicles})
    ego, simulation = env.config.ego, env.config.simulation
    ends_s = simulation.decision_interval_s * np.arange(1, simulation.decisions_per_episode + 1)
    speeds = env.scene.affordances.ego_speed_m_s + ego.accelerate_m_s2 * ends_s
    return float(np.minimum(speeds, ego.max_speed_m_s).mean())


if __name__ == "__main__":
    main()
