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
        metavar="FILE.csv | RUN | RESULTS",
        help="tables of evaluate, folders of runs, and folders of results of reproduce",
    )
    parser.add_argument(
        "--out", type=Path, default=Path(), metavar="DIR", help="folder for the figures"
    )


def figures(options: argparse.Namespace) -> int:
    """Draw ``reward``, ``lane_change`` and each figure for which the given sources have data.

    Returns the exit status 0. Raises ConfigError if two sources have a figure of the same name.
    """
    from drl_av.experiments.canvas import save_figure
    from drl_av.experiments.experiment import draw_results
    from drl_av.experiments.figures import (
        EPISODE_COLUMNS,
        learning_figure,
        profile_figure,
        reward_figure,
        speed_figure,
    )
    from drl_av.experiments.lane_change_figure import lane_change_figure
    from drl_av.experiments.registry import EXPERIMENTS
    from drl_av.files import read_table

    folders = [path for path in options.sources if path.is_dir()]
    runs = [folder for folder in folders if (folder / "evaluations.csv").is_file()]
    tables = [path for path in options.sources if not path.is_dir()]
    figures = {"reward": reward_figure(Config()), "lane_change": lane_change_figure(Config())}
    if tables:
        rows = [row for table in tables for row in read_table(table, EPISODE_COLUMNS)]
        _require_distinct(tables)
        figures["mean_speed"] = speed_figure(rows)
        figures["speed_profile"] = profile_figure(rows)
    if runs:
        figures["learning"] = learning_figure(runs)
    for folder in folders:
        for name, figure in () if folder in runs else draw_results(EXPERIMENTS, folder):
            if name in figures:
                raise ConfigError(
                    f"Another source has a figure {name}, too: draw {folder} by itself, with "
                    "another --out."
                )
            figures[name] = figure
    for name, figure in figures.items():
        save_figure(figure, options.out / f"{name}.png")
        print(options.out / f"{name}.png")
    return 0


def _require_distinct(tables: Iterable[Path]) -> None:
    """Raise ConfigError if the tables have two episodes of one driver in the same traffic.

    Tables without a column ``seed`` are not examined.
    """
    from drl_av.experiments.figures import EPISODE_COLUMNS
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
