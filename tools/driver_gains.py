"""Measures a driver beside the strongest rule-based ones, each under the same safety check.

    python tools/driver_gains.py pretrained-large --out gains.csv --first-seed 940000 --episodes 50

All drivers drive the same traffic in SUMO. The program adds the episodes that the table lacks, and
prints the gain in mean speed over the best opponent with its 95 % interval, paired by episode.
"""

import argparse
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import drl_av  # noqa: F401 (registers the environment)
from drl_av.config import SINGLE_PRESETS, Config
from drl_av.drivers.registry import driving_config, find_drivers, make_drivers
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import drive
from drl_av.evaluation.statistics import mean_difference
from drl_av.files import Row, append_rows, read_table

OPPONENTS = ("gap-mobil", "gap-mobil-1.3", "sumo-tuned", "idm-mobil,acc", "idm-sumo,acc")
"""The opponents; ``acc`` names the longitudinal reference with which a driver is fastest."""
VEHICLES = (5, 10, 15, 20, 25)
COUNTS = (
    *("collided", "ego_hit", "lane_changes", "aborted_lane_changes"),
    *("hard_brakes", "safety_triggers", "decisions"),
)
COLUMNS = ("driver", "traffic", "safety_check", "vehicles", "seed", "mean_speed_m_s", *COUNTS)
Cell = dict[tuple[int, int], float]
"""The mean speeds of a driver, m/s, by number of vehicles and traffic seed."""


def add_missing(options: argparse.Namespace, traffic: str, label: str) -> None:
    """Drive the episodes of one driver in one kind of traffic that the table lacks."""
    name, _, reference = label.partition(",")
    key = (label, traffic, options.check)
    held = {
        (int(row["vehicles"]), int(row["seed"]))
        for row in rows_of(options.out)
        if (row["driver"], row["traffic"], row["safety_check"]) == key
    }
    seeds = range(options.first_seed, options.first_seed + options.episodes)
    missing = [(n, seed) for n in options.vehicles for seed in seeds if (n, seed) not in held]
    if not missing:
        return
    config = Config().with_traffic(traffic).updated("safety", check=options.check)
    config = config.updated("ego", longitudinal_reference=reference or "acceleration")
    specs = find_drivers([name])
    config = driving_config(specs, config)  # with the margins of a learned driver
    [driver] = make_drivers(specs, config).values()
    with closing(HighwayEnv(config=config)) as env:
        for vehicles, seed in missing:
            result = drive(env, driver, label, seed, vehicles)
            counts = {name: int(getattr(result, name)) for name in COUNTS}
            row = dict(zip(COLUMNS, (*key, vehicles, seed, result.mean_speed_m_s), strict=False))
            append_rows(options.out, COLUMNS, [row | counts])


def rows_of(table: Path) -> list[Row]:
    """Read the rows of the table; [] before the first one."""
    return read_table(table) if table.exists() else []


def speeds(rows: Iterable[Row]) -> dict[str, Cell]:
    """Return the mean speeds by driver."""
    found: dict[str, Cell] = {}
    for row in rows:
        traffic = int(row["vehicles"]), int(row["seed"])
        found.setdefault(row["driver"], {})[traffic] = float(row["mean_speed_m_s"])
    return found


def gain(found: dict[str, Cell], ours: str, numbers: Iterable[int]) -> str:
    """Return the gain over the best opponent among these numbers of vehicles, and its name."""
    cells = {
        name: {key: v for key, v in own.items() if key[0] in numbers} for name, own in found.items()
    }
    both = set.intersection(*(set(own) for own in cells.values()))
    cells = {name: {key: own[key] for key in sorted(both)} for name, own in cells.items()}
    rivals = {name: sum(own.values()) for name, own in cells.items() if name in OPPONENTS}
    best = max(rivals, key=lambda name: rivals[name])
    return f"{mean_difference(cells[ours], cells[best], ours)} over {best} (n = {len(both)})"


def main() -> None:
    """Drive what is missing, and print the gains."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("driver")
    parser.add_argument("--out", type=Path, required=True, help="the table, a CSV file")
    parser.add_argument("--first-seed", type=int, required=True)
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--vehicles", type=int, nargs="+", default=VEHICLES)
    parser.add_argument("--traffic", nargs="+", default=SINGLE_PRESETS)
    parser.add_argument("--check", default="strict")
    options = parser.parse_args()
    for traffic in options.traffic:
        for label in (options.driver, *OPPONENTS):
            add_missing(options, traffic, label)
        rows = [row for row in rows_of(options.out) if row["traffic"] == traffic]
        rows = [row for row in rows if row["driver"] in (options.driver, *OPPONENTS)]
        found = speeds(rows)
        own = [row for row in rows if row["driver"] == options.driver]
        print(f"{traffic}: {gain(found, options.driver, options.vehicles)}")
        for number in options.vehicles:
            print(f"  {number} vehicles: {gain(found, options.driver, [number])}")
        means = {name: sum(int(row[name]) for row in own) / len(own) for name in COUNTS}
        hits = sum(int(row["ego_hit"]) for row in own)
        print(
            f"  ego hits {hits} of {len(own)}; means:", {k: round(v, 2) for k, v in means.items()}
        )


if __name__ == "__main__":
    main()
