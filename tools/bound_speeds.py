"""Computes an upper bound of a driver's gain over the best opponent, in each kind of traffic.

    python tools/bound_speeds.py

The bound on the mean speed is that of an ego which accelerates at ``ego.accelerate_m_s2`` to
``ego.max_speed_m_s`` on an empty road, in the episodes of ``docs/results/opponents.csv``. The gain
of this bound over the best opponent is paired by episode. The last column pools the episodes among
5 to 25 vehicles.
"""

import argparse
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from drl_av.config import SINGLE_PRESETS, Config
from drl_av.env.highway import HighwayEnv
from drl_av.evaluation.provenance import made_by
from drl_av.files import Row
from studies.experiment import ResultsFolder
from studies.opponents import (
    MIDDLE,
    OPPONENTS_SWEEP,
    VEHICLES,
    best_opponent,
    gain,
    speeds,
)

RESULTS = Path(__file__).parents[1] / "docs" / "results"


def main() -> None:
    """Print the largest possible gain in each kind of traffic, at each number of vehicles."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    begun_s = time.monotonic()
    rows = ResultsFolder(RESULTS).rows(OPPONENTS_SWEEP.table)
    columns = [(number,) for number in VEHICLES]
    pooled = tuple(number for number in VEHICLES if number in MIDDLE)
    names = [*map(str, VEHICLES), f"{pooled[0]} to {pooled[-1]}"]
    print("most to gain over the best opponent, m/s, by number of vehicles")
    print(f"{'traffic':<14}" + "".join(f"{name:>14}" for name in names))
    for kind in SINGLE_PRESETS:
        own = [row for row in rows if row["traffic"] == kind]
        with closing(HighwayEnv(config=Config().with_traffic(kind))) as env:
            gains = [most_to_gain(env, own, numbers) for numbers in (*columns, pooled)]
        print(f"{kind:<14}" + "".join(f"{gain:>14}" for gain in gains))
    print(made_by(time.monotonic() - begun_s))


def most_to_gain(env: HighwayEnv, rows: list[Row], numbers: tuple[int, ...]) -> str:
    """Return the mean gain of the bound over the best opponent, with its 95 % interval, m/s.

    ``rows`` are those of one kind of traffic, and ``numbers`` are the numbers of vehicles.
    """
    found = speeds(row for row in rows if int(row["vehicles"]) in numbers)
    best = found[best_opponent(found)]
    return str(gain({traffic: fastest_m_s(env, *map(int, traffic)) for traffic in best}, best))


def fastest_m_s(env: HighwayEnv, vehicles: int, seed: int) -> float:
    """Return the ego's mean speed over an episode if no vehicle were in its way, m/s.

    The mean is over the speeds after each decision.
    """
    env.reset(seed=seed, options={"vehicles": vehicles})
    ego, simulation = env.config.ego, env.config.simulation
    ends_s = simulation.decision_interval_s * np.arange(1, simulation.decisions_per_episode + 1)
    speeds_m_s = env.scene.affordances.ego_speed_m_s + ego.accelerate_m_s2 * ends_s
    return float(np.minimum(speeds_m_s, ego.max_speed_m_s).mean())


if __name__ == "__main__":
    main()
