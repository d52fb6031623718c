"""The verb ``figures``: draws the paper's figures from tables and runs."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.cli.options import add_path
from drl_av.cli.tables import title_of
from drl_av.config import Config, load_config
from drl_av.config.traffic import NUMBERS
from drl_av.drivers.groups import trainings_of
from drl_av.errors import ConfigError, DrlAvError
from drl_av.evaluation import PROVENANCE
from drl_av.evaluation.figure_style import COLUMNS_IN

if TYPE_CHECKING:
    from drl_av.env.metrics import EpisodeResult
    from drl_av.evaluation.statistics import PairedGain


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av figures`` to its parser."""
    parser.add_argument(
        "sources",
        nargs="*",
        metavar="FILE.csv | RUN",
        help="tables of evaluate, and folders of runs; NAME=PATTERN, such as 'ppo=runs/seed-*', "
        "draws the mean of several runs and its 95 %% interval",
    )
    parser.add_argument(
        "--columns",
        type=int,
        choices=COLUMNS_IN,
        help="make the figures as wide as one or two columns of a paper, with text of 8 points",
    )
    meaning = "draw each vehicle of a recorded episode: position against time, speed as colour"
    add_path(parser, "--time-space", "RECORDING", meaning)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(),
        metavar="DIR | FILE",
        help="folder for the figures, as PNG files; or a file that ends in .pdf (a page for each "
        "figure), .svg or .png",
    )


def figures(options: argparse.Namespace) -> int:
    """Draw each figure for which the given sources have data, or ``reward`` without any; return 0.

    Raises DrlAvError if a folder is not a run, runs are of two algorithms, a table is not one of
    ``drl-av evaluate``, tables have an episode of a driver twice, a driver under two checks or
    different traffic, or ``--out`` has the suffix of another kind of file.
    """
    from drl_av.evaluation.figure_style import add_title, fit_columns
    from drl_av.evaluation.figures import (
        gain_figure,
        is_ppo,
        learning_figure,
        profile_figure,
        reward_figure,
        speed_figure,
    )
    from drl_av.evaluation.recording import load_recording
    from drl_av.evaluation.statistics import require_distinct
    from drl_av.evaluation.table import read_results
    from drl_av.evaluation.trajectories import time_space_figure

    _require_known_suffix(options.out)
    sources = [trainings_of(word) for word in options.sources]
    groups = dict[str, list[Path]]()
    for name, found in sources:
        if name:
            groups.setdefault(name, []).extend(map(Path, found))
    alone = [Path(word) for name, [word, *_] in sources if not name]
    runs, tables = [p for p in alone if p.is_dir()], [p for p in alone if not p.is_dir()]
    every_run = [run for own in (runs, *groups.values()) for run in own]
    by_ppo = [run for run in every_run if is_ppo(run)]
    by_another = [run for run in every_run if run not in by_ppo]
    if recordings := [table for table in tables if table.suffix.lower() == ".npz"]:
        raise ConfigError(
            f"{recordings[0]} is a recording, not a table: draw it with --time-space."
        )
    if others := [run for run in by_another if not (run / "evaluations.csv").is_file()]:
        grouped = others[0] not in runs
        raise ConfigError(
            f"{others[0]} is not a run, it has neither evaluations.csv nor updates.csv: name the "
            f"folder of a run{', or a table alone' if grouped else ', or a table of evaluate'}."
        )
    if by_ppo and by_another:
        raise ConfigError(
            f"{by_ppo[0]} is a training by PPO and {by_another[0]} one by Algorithm 1, whose "
            "rewards differ: draw their learning curves apart, or a table of drl-av evaluate."
        )
    figures = dict[str, Any]()
    if tables:
        rows = [row for table in tables for row in read_results(table)]
        _require_like_episodes(tables)
        require_distinct(rows)
        title = title_of((row.compared_as, row.safety_check) for row in rows)
        figures |= {"mean_speed": speed_figure(rows), "speed_profile": profile_figure(rows)}
        if gains := _gains(rows):
            figures["gain"] = gain_figure(gains, rows)
        for figure in figures.values():
            add_title(figure, title)
    if every_run:
        figures["learning"] = learning_figure(runs, groups)
        named = [(run.absolute().name, run) for run in runs]
        named += [(name, run) for name, own in groups.items() for run in own]
        pairs = [(name, load_config(run / "config.toml").safety.check) for name, run in named]
        add_title(figures["learning"], title_of(pairs))
    if options.time_space:
        recording = load_recording(options.time_space)
        figures["time_space"] = time_space_figure(recording)
        add_title(figures["time_space"], f"{recording.driver}, seed {recording.seed}")
    figures = figures or {"reward": reward_figure(Config())}
    for figure in figures.values() if options.columns else ():
        fit_columns(figure, options.columns)
    _save(figures, options.out)
    return 0


def _require_known_suffix(out: Path) -> None:
    """Raise ConfigError if ``out`` reads like a file of another kind, such as figure.jpg."""
    from drl_av.evaluation.figure_style import FORMATS

    if out.suffix[1:].isalpha() and out.suffix.lower() not in FORMATS and not out.is_dir():
        raise ConfigError(
            f"--out is {out}, but a figure's file ends in {', '.join(FORMATS)}: name such a file, "
            "or a folder without a suffix."
        )


def _save(figures: Mapping[str, Any], out: Path) -> None:
    """Write the figures into a folder, or to a file, by its suffix."""
    from drl_av.evaluation.figure_style import FORMATS, save_figure, save_pages

    if out.suffix.lower() not in FORMATS or out.is_dir():
        files = {out / f"{name}.png": figure for name, figure in figures.items()}
    else:
        if out.suffix.lower() == ".pdf":
            save_pages(figures.values(), out)
            print(f"{out}: {', '.join(figures)}")
            return
        one = len(figures) == 1
        files = {
            out if one else out.with_stem(f"{out.stem}_{name}"): figure
            for name, figure in figures.items()
        }
    for file, figure in files.items():
        save_figure(figure, file)
        print(file)


def _gains(rows: "Sequence[EpisodeResult]") -> "Sequence[PairedGain]":
    """Return the gains over the fastest rule-based driver.

    Empty without a rule-based driver and another one, or if the drivers did not drive the same
    traffic, which a line says then.
    """
    from drl_av.drivers.registry import baselines
    from drl_av.evaluation.statistics import gains_over_fastest

    try:
        return gains_over_fastest(rows, baselines(row.driver for row in rows))
    except DrlAvError as error:
        print(f"The gain over the rules is not drawn: {error}")
        return []


def _require_like_episodes(tables: Sequence[Path]) -> None:
    """Raise ConfigError if tables say that their episodes are not alike: traffic, ego, reward."""
    from drl_av.evaluation.provenance import read_provenance
    from drl_av.evaluation.table import report_corrupt_table

    found = dict[str, tuple[str, Any]]()
    for table in tables:
        is_known = table.with_suffix(PROVENANCE).exists()
        with report_corrupt_table(table):
            settings = read_provenance(table, PROVENANCE).get("settings", {}) if is_known else {}
            now = {
                f"{section}.{name}": value
                for section in ("simulation", "traffic", "ego", "reward")
                for name, value in settings.get(section, {}).items()
                if name not in NUMBERS  # the columns say how many
            }
        for name, value in now.items():
            first, its = found.setdefault(name, (str(table), value))
            if its != value:
                raise ConfigError(
                    f"{first} and {table} are of different episodes ({name} is {its} and {value}): "
                    "draw them apart."
                )
