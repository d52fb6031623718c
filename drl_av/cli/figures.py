"""The verb ``figures``: draws the paper's figures from tables and runs."""

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from drl_av.config import Config
from drl_av.errors import ConfigError, pluralize


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av figures`` to its parser."""
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="FILE.csv | RUN",
        help="tables of evaluate, and folders of runs",
    )
    parser.add_argument(
        "--out", type=Path, default=Path(), metavar="DIR", help="folder for the figures"
    )


def figures(options: argparse.Namespace) -> int:
    """Draw ``reward`` and each figure for which the given sources have data; return 0.

    Raises ConfigError if a folder is not a run, or tables have an episode of a driver twice.
    """
    from drl_av.evaluation.figure_style import save_figure
    from drl_av.evaluation.figures import (
        EPISODE_COLUMNS,
        learning_figure,
        profile_figure,
        reward_figure,
        speed_figure,
    )
    from drl_av.files import read_table

    runs = [path for path in options.sources if path.is_dir()]
    if others := [run for run in runs if not (run / "evaluations.csv").is_file()]:
        raise ConfigError(
            f"{others[0]} is not a run, it has no evaluations.csv: name the folder of a run, or a "
            "table of evaluate."
        )
    tables = [path for path in options.sources if not path.is_dir()]
    figures = {"reward": reward_figure(Config())}
    if tables:
        rows = [row for table in tables for row in read_table(table, EPISODE_COLUMNS)]
        _require_distinct(tables)
        figures["mean_speed"] = speed_figure(rows)
        figures["speed_profile"] = profile_figure(rows)
    if runs:
        figures["learning"] = learning_figure(runs)
    for name, figure in figures.items():
        save_figure(figure, options.out / f"{name}.png")
        print(options.out / f"{name}.png")
    return 0


def _require_distinct(tables: Iterable[Path]) -> None:
    """Raise ConfigError if the tables have two episodes of one driver in the same traffic.

    Tables without a column ``seed`` are not examined.
    """
    from drl_av.evaluation.figures import EPISODE_COLUMNS
    from drl_av.files import PlainNumber, read_table

    with_seeds = [table for table in tables if "seed" in read_table(table)[0]]
    columns = {**EPISODE_COLUMNS, "seed": PlainNumber}
    rows = [row for table in with_seeds for row in read_table(table, columns)]
    episodes = Counter((row["driver"], row["vehicles"], row["seed"]) for row in rows)
    for (driver, vehicles, seed), times in episodes.items():
        if times > 1:
            raise ConfigError(
                f"There are {times} rows of {driver} with seed {seed:g} among "
                f"{pluralize(int(vehicles), 'vehicle')}, for example under several checks, and a "
                "curve would mix them: draw the rows of one evaluation at a time."
            )
