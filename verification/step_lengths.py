"""Measures how the SUMO step length changes the traffic and the speed of the simulation.

    python -m verification.step_lengths --out docs/results/step_length.csv

The driver ``idm`` drives the same seeded episodes with 30 vehicles for each step length. The table
holds the mean speed of the traffic, the lane changes per vehicle and minute, the number of vehicles
that SUMO reports in a collision, and the decisions per second. SUMO integrates by semi-implicit
Euler.
"""

from contextlib import closing
from pathlib import Path
from time import perf_counter as now

from drl_av.config import Config
from drl_av.drivers.rule_based import IdmDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.evaluation.provenance import provenance, write_provenance
from drl_av.files.atomic import require_writable
from drl_av.files.table import write_table
from verification.program import Program, run_program
from verification.traffic_tally import TrafficTally

STEP_LENGTHS_S = (1.0, 0.5, 0.25, 0.2, 0.1)
SEEDS = 2_000


def measure(step_length_s: float, episodes: int, vehicles: int) -> dict[str, float]:
    """Drive the episodes with one step length, and return its row of the table."""
    config = Config().with_traffic("calm").updated("simulation", step_length_s=step_length_s)
    with closing(HighwayEnv(config=config)) as env:
        driver, seeds, begun_s = IdmDriver(config.safety), range(SEEDS, SEEDS + episodes), now()
        decisions = sum(drive(env, driver, "idm", seed, vehicles).decisions for seed in seeds)
        rate, tally = decisions / (now() - begun_s), TrafficTally(env)
        for seed in seeds:
            tally.drive(driver, seed, vehicles)
    return {
        "step_length_s": step_length_s,
        "episodes": episodes,
        "vehicles": vehicles,
        "traffic_mean_speed_m_s": round(tally.mean_speed_m_s, 3),
        "lane_changes_a_vehicle_and_minute": round(tally.lane_changes_a_minute, 3),
        "colliding_vehicles": tally.colliding,
        "decisions_a_second": round(rate),
    }


def main() -> None:
    """Measure each step length and write the table."""
    parser = Program(__doc__)
    parser.number("--episodes", 30, "for each step length")
    parser.number("--vehicles", 30, "beside the ego")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.csv")
    options = parser.parse_args()
    require_writable(options.out)
    rows = [measure(step, options.episodes, options.vehicles) for step in STEP_LENGTHS_S]
    seeds = f"{SEEDS} to {SEEDS + options.episodes - 1}"
    facts = provenance(Config(), seeds=seeds, wall_time_s=round(parser.spent_s(), 1))
    write_provenance(options.out, {**facts, "step_length_s": STEP_LENGTHS_S})
    write_table(options.out, rows[0], rows)
    print(*rows, sep="\n")


if __name__ == "__main__":
    run_program(main)
