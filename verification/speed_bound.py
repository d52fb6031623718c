"""Computes an upper bound of a driver's gain over the best opponent, in each kind of traffic.

    python -m verification.speed_bound

The bound on the mean speed is that of an ego which accelerates at ``ego.accelerate_m_s2`` to
``ego.max_speed_m_s`` on an empty road, in the episodes of ``docs/results/opponents.csv``. The gain
of this bound over the best opponent is paired by episode. The last column pools the episodes among
5 to 25 vehicles.
"""

from contextlib import closing
from typing import Any

import numpy as np

from drl_av.config import SINGLE_PRESETS, Config
from drl_av.env.highway import HighwayEnv
from drl_av.evaluation.statistics import gain
from studies.options import FOLDER, RESULTS
from studies.pivot import SPEED, Pivot, by_traffic, select
from studies.study import FileStudy
from verification.program import Program, run_program


def main() -> None:
    """Print the largest possible gain in each kind of traffic, at each number of vehicles."""
    parser = Program(__doc__)
    parser.parse_args()
    study = FileStudy(FOLDER / "opponents.toml")
    pivot = Pivot(study, study.file["tables"]["opponents_gain"], RESULTS)
    columns = pivot.columns()
    print("most to gain over the best opponent, m/s, by number of vehicles")
    print(f"{'traffic':<14}" + "".join(f"{name:>14}" for name in columns))
    for kind in SINGLE_PRESETS:
        with closing(HighwayEnv(config=Config().with_traffic(kind))) as env:
            gains = [most_to_gain(env, pivot, {"traffic": kind, **c}) for c in columns.values()]
        print(f"{kind:<14}" + "".join(f"{gain:>14}" for gain in gains))
    print(parser.made_by())


def most_to_gain(env: HighwayEnv, pivot: Pivot, where: dict[str, Any]) -> str:
    """Return the mean gain of the bound over the best opponent, with its 95 % interval, m/s.

    ``where`` selects a kind of traffic and numbers of vehicles.
    """
    rows = select(pivot.rows, where | {"label": pivot.best(where)})
    best = by_traffic(rows, SPEED)
    bound = {traffic: fastest_m_s(env, *map(int, traffic[1:])) for traffic in best}
    return str(gain(bound, best))


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
    run_program(main)
