"""The verb ``figures``: the paper's figures from tables and runs."""

import argparse
from pathlib import Path

from drl_av.config import Config


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add this command's arguments."""
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="FILE.csv | RUN | RESULTS",
        help="tables that evaluate wrote, in m/s, folders of runs, and of reproduce's results",
    )
    parser.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder for them")


def figures(options: argparse.Namespace) -> int:
    """Draw every figure that the sources allow."""
    from drl_av.experiments.drawing import learning_figure, reward_figure, save_figure, speed_figure
    from drl_av.experiments.figures import published
    from drl_av.experiments.lane_change_figure import lane_change_figure

    folders = [path for path in options.sources if path.is_dir()]
    runs = [folder for folder in folders if (folder / "evaluations.csv").is_file()]
    tables = [path for path in options.sources if not path.is_dir()]
    figures = {"reward": reward_figure(Config()), "lane_change": lane_change_figure(Config())}
    if tables:
        figures["mean_speed"] = speed_figure(tables)
    if runs:
        figures["learning"] = learning_figure(runs)
    for folder in folders:
        figures |= {} if folder in runs else dict(published(folder))
    for name, figure in figures.items():
        save_figure(figure, options.out / f"{name}.png")
        print(options.out / f"{name}.png")
    return 0
