"""The ``drl-av`` command: parse, call, print; every room is opened inside its verb."""

import argparse
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.errors import DrlAvError

if TYPE_CHECKING:
    from drl_av.config import Config
    from drl_av.driving.drivers import Driver
    from drl_av.env import HighwayEnv
    from drl_av.studies.evaluation import Summary
    from drl_av.studies.replay import Recording

INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb; returns the exit status: 0, 1 for a failure told in one sentence, 2 for usage."""
    parsed = _parser().parse_args(arguments)
    verb: Callable[[argparse.Namespace], int] = parsed.verb
    try:
        return verb(parsed)
    except DrlAvError as error:
        print(f"drl-av: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("drl-av: interrupted.", file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="drl-av",
        description="Learn to drive on a highway, safely, in SUMO.",
        epilog="Every verb has its own --help.",
    )
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    for add in (_add_scenario, _add_train, _add_evaluate, _add_replay):
        add(verbs)
    return parser


def _verb(verbs: Any, name: str, run: Callable[..., int], meaning: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = verbs.add_parser(
        name,
        help=meaning,
        description=meaning,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.set_defaults(verb=run)
    return parser


def _whole(low: int) -> Callable[[str], int]:
    def parse(text: str) -> int:
        number = int(text)
        if number < low:
            raise argparse.ArgumentTypeError(f"{number} is less than {low}")
        return number

    parse.__name__ = "whole number"
    return parse


def _add_driving_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenario", metavar="DIR", help="scenario folder, or the name of a shipped one"
    )
    parser.add_argument("--config", metavar="FILE.toml", help="settings laid over the others")
    parser.add_argument(
        "--safety-check", metavar="NAME", help="permit_all or paper; default: that of the config"
    )


def _overridden(config: "Config", options: argparse.Namespace) -> "Config":
    """Lay what the command line says over a config."""
    from drl_av.config import load_config

    if options.config:
        config = load_config(options.config, config)
    if options.scenario:
        config = config.updated("simulation", scenario=options.scenario)
    if options.safety_check:
        config = config.updated("safety", check=options.safety_check)
    return config


# ------------------------------------------------------------------------------------- scenario


def _add_scenario(verbs: Any) -> None:
    parser = _verb(verbs, "scenario", _scenario, "write a scenario folder for SUMO and drl-av")
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to write; must be new")
    parser.add_argument("--circumference-m", type=float, default=500.0, metavar="M", help="metres")
    parser.add_argument("--lanes", type=_whole(1), default=3, metavar="N", help="number of lanes")
    parser.add_argument("--lane-width-m", type=float, default=3.8, metavar="M", help="metres")
    parser.add_argument(
        "--barricade",
        type=_whole(0),
        nargs="+",
        default=(),
        metavar="LANE",
        help="lanes to close; 0 is the rightmost",
    )


def _scenario(options: argparse.Namespace) -> int:
    from drl_av.traffic.scenario import ScenarioDescription, write_scenario

    description = ScenarioDescription(
        circumference_m=options.circumference_m,
        lanes=options.lanes,
        lane_width_m=options.lane_width_m,
        barricaded_lanes=tuple(options.barricade),
    )
    write_scenario(options.folder, description)
    print(f"{options.folder}: open it with sumo-gui -c {options.folder / 'highway.sumocfg'}")
    return 0


# ---------------------------------------------------------------------------------------- train


def _add_train(verbs: Any) -> None:
    parser = _verb(verbs, "train", _train, "train a driver (Algorithm 1)")
    parser.add_argument("--out", type=Path, required=True, metavar="RUN", help="the run's folder")
    parser.add_argument("--preset", default="paper", metavar="NAME", help="paper or fast")
    parser.add_argument("--episodes", type=_whole(1), metavar="N", help="default: the preset's")
    parser.add_argument("--seed", type=_whole(0), metavar="S", help="default: the preset's")
    parser.add_argument(
        "--replay", metavar="KIND", help="two-buffer or uniform; default: the preset's"
    )
    _add_driving_options(parser)
    parser.add_argument("--resume", action="store_true", help="go on where the run was stopped")
    parser.add_argument(
        "--tensorboard", action="store_true", help="also write TensorBoard events into the run"
    )


def _train(options: argparse.Namespace) -> int:
    from drl_av.env import HighwayEnv
    from drl_av.learning.run import Run
    from drl_av.learning.training import Training

    run = Run(options.out)
    config = _training_config(options, run)
    env = HighwayEnv(config=config)
    if not options.resume:
        run.create(config)
    training = Training(env)
    run.restore(training)
    try:
        _watch_training(run, training, options.tensorboard)
    finally:
        env.close()
    return 0


def _training_config(options: argparse.Namespace, run: Any) -> "Config":
    from drl_av.config import preset
    from drl_av.errors import RunError

    wanted = {
        name: getattr(options, name)
        for name in ("episodes", "seed", "replay")
        if getattr(options, name) is not None
    }
    if options.resume:
        config: Config = run.read_config()
        changed = _overridden(config, options).updated("learning", **wanted)
        if changed != config:
            raise RunError(
                f"{run.folder} was begun with other settings than these options ask for: "
                "resume it without them, or begin a new run."
            )
        return config
    return _overridden(preset(options.preset), options).updated("learning", **wanted)


def _watch_training(run: Any, training: Any, tensorboard: bool) -> None:
    from drl_av.learning.board import board
    from drl_av.learning.run import train

    episodes = training.config.learning.episodes
    decisions, begun = 0, time.monotonic()
    with (
        _stop_between_episodes() as stopping,
        board(run.folder / "tensorboard" if tensorboard else None) as events,
        _progress_bar() as bar,
    ):
        task = bar.add_task("training", total=episodes, completed=training.episodes_done, told="")
        for progress in train(run, training):
            row = progress.episode
            decisions += row.decisions
            rate = decisions / (time.monotonic() - begun)
            events.add(progress)
            bar.update(
                task,
                completed=row.episode,
                told=f"reward {row.mean_reward:.3f}  {row.mean_speed_m_s:.1f} m/s  "
                f"triggers {row.safety_triggers}  epsilon {row.epsilon:.2f}  "
                f"{rate:.0f} decisions/s",
            )
            if progress.evaluation:
                evaluation = progress.evaluation
                bar.console.print(
                    f"episode {evaluation.episode}: greedy reward {evaluation.mean_reward:.3f}, "
                    f"{evaluation.mean_speed_m_s:.2f} m/s, {evaluation.ego_hits} times hit "
                    f"something, {evaluation.safety_triggers:.1f} triggers an episode"
                )
            if stopping() and row.episode < episodes:
                run.save(training)
                bar.console.print(
                    f"stopped after episode {row.episode}: continue with "
                    f"drl-av train --out {run.folder} --resume"
                )
                raise KeyboardInterrupt


@contextmanager
def _stop_between_episodes() -> Iterator[Callable[[], bool]]:
    """The first Ctrl-C asks to stop after the episode; the second stops at once."""
    asked = False

    def ask(number: int, frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    former = {name: signal.signal(name, ask) for name in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: asked
    finally:
        for name, handler in former.items():
            signal.signal(name, handler)


def _progress_bar() -> Any:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console()
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[told]}"),
        console=console,
        disable=not console.is_terminal,
    )


# ------------------------------------------------------------------------------------- evaluate


def _add_evaluate(verbs: Any) -> None:
    from drl_av.studies import DENSITIES

    parser = _verb(verbs, "evaluate", _evaluate, "compare drivers on the same seeded traffic")
    parser.add_argument(
        "runs", nargs="*", type=Path, metavar="RUN", help="runs; default: the shipped driver"
    )
    parser.add_argument(
        "--driver", nargs="+", default=[], metavar="NAME", help="idm, idm-sumo, random, pretrained"
    )
    parser.add_argument(
        "--vehicles", nargs="+", type=_whole(0), default=list(DENSITIES), metavar="N"
    )
    parser.add_argument("--episodes", type=_whole(1), default=50, metavar="N", help="a density")
    parser.add_argument(
        "--seed", type=_whole(0), default=0, metavar="S", help="of the first episode's traffic"
    )
    _add_driving_options(parser)
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="a row an episode")


def _evaluate(options: argparse.Namespace) -> int:
    from rich.console import Console

    from drl_av.env import HighwayEnv
    from drl_av.studies.evaluation import drive_all, summarize, write_rows

    drivers, base = _drivers(options.runs, options.driver)
    config = _overridden(base, options)
    env = HighwayEnv(config=config)
    seeds = range(options.seed, options.seed + options.episodes)
    rows = []
    interrupted = False
    try:
        with _progress_bar() as bar:
            total = len(drivers) * len(seeds) * len(options.vehicles)
            task = bar.add_task("evaluating", total=total, told="")
            for row in drive_all(env, drivers, options.vehicles, seeds):
                rows.append(row)
                bar.update(task, advance=1, told=f"{row.driver}, {row.vehicles} vehicles")
    except KeyboardInterrupt:
        interrupted = True
    finally:
        env.close()
    if options.out:
        write_rows(options.out, rows)
    Console().print(_table(summarize(rows)))
    return INTERRUPTED if interrupted else 0


def _drivers(runs: Sequence[Path], names: Sequence[str]) -> tuple[dict[str, "Driver"], "Config"]:
    """Drivers by name, and the config of the first learned one among them."""
    from drl_av.config import Config
    from drl_av.studies.drivers import PRETRAINED, learned_driver, rule_driver

    drivers: dict[str, Driver] = {}
    config: Config | None = None
    wanted = list(runs) or ([PRETRAINED] if not names or "pretrained" in names else [])
    for path in wanted:
        name = "pretrained" if path == PRETRAINED else path.name
        drivers[name], own = learned_driver(path)
        config = config or own
    config = config or Config()
    drivers |= {name: rule_driver(name, config) for name in names if name != "pretrained"}
    return drivers, config


def _table(summaries: Sequence["Summary"]) -> Any:
    from rich.table import Table

    table = Table(caption="mean ± half-width of the 95 % confidence interval, over episodes")
    for heading in ("vehicles", "driver", "check", "episodes", "speed m/s", "reward"):
        table.add_column(heading)
    for heading in ("ego hit", "was hit", "triggers", "lane changes"):
        table.add_column(heading, justify="right")
    for summary in summaries:
        table.add_row(
            str(summary.vehicles),
            summary.driver,
            summary.safety_check,
            str(summary.episodes),
            str(summary.speed_m_s),
            str(summary.reward),
            str(summary.ego_hits),
            str(summary.collisions - summary.ego_hits),
            str(summary.triggers),
            str(summary.lane_changes),
        )
    return table


# --------------------------------------------------------------------------------------- replay


def _add_replay(verbs: Any) -> None:
    parser = _verb(verbs, "replay", _replay, "watch a driver, or a recorded episode again")
    parser.add_argument(
        "source",
        nargs="?",
        type=Path,
        metavar="RUN | RECORDING",
        help="default: the shipped driver",
    )
    parser.add_argument("--driver", metavar="NAME", help="a driver by rule instead")
    parser.add_argument("--seed", type=_whole(0), default=0, metavar="S", help="of the traffic")
    parser.add_argument("--vehicles", type=_whole(0), default=15, metavar="N")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--gui", action="store_true", help="in sumo-gui (the default)")
    how.add_argument("--video", type=Path, metavar="FILE.mp4", help="as .mp4 or .gif, no screen")
    parser.add_argument("--rate", type=float, default=2.0, metavar="X", help="times real time")
    parser.add_argument("--record", type=Path, metavar="FILE.npz", help="keep the episode")
    _add_driving_options(parser)


def _replay(options: argparse.Namespace) -> int:
    from drl_av.env import HighwayEnv
    from drl_av.episode import drive
    from drl_av.studies.replay import Film, Follower, Pacer, RecordedDriver, Recorder

    recording, driver, name, config = _episode_to_watch(options)
    seed, vehicles = options.seed, options.vehicles
    if recording:
        driver, seed, vehicles = RecordedDriver(recording), recording.seed, recording.vehicles
    env = HighwayEnv(config=config, render_mode="rgb_array" if options.video else "human")
    film, recorder = Film(name), Recorder()
    watchers: list[Callable[[HighwayEnv], None]] = [recorder]
    watchers.append(film if options.video else Pacer(options.rate))
    if recording:
        watchers.append(Follower(recording))

    def watch(env: "HighwayEnv") -> None:
        for watcher in watchers:
            watcher(env)

    try:
        result = drive(env, driver, name, seed, vehicles, watch)
    finally:
        env.close()
    if options.record:
        recorder.recording(env, name).save(options.record)
    if options.video:
        frames = film.write(options.video, rate=options.rate)
        print(f"{options.video}: {frames} frames")
    followed = "exactly as recorded, " if recording else ""
    print(
        f"{name}, {vehicles} vehicles, seed {seed}: {followed}{result.decisions} decisions, "
        f"{result.mean_speed_m_s:.2f} m/s, reward {result.mean_reward:.3f}, "
        f"{result.safety_triggers} safety triggers, {result.collision or 'no collision'}"
    )
    return 0


def _episode_to_watch(
    options: argparse.Namespace,
) -> tuple["Recording | None", "Driver", str, "Config"]:
    """The recording, if the source is one; the driver, its name, and its config."""
    from drl_av.studies.replay import RecordedDriver, load_recording

    source: Path | None = options.source
    if source is not None and source.suffix == ".npz":
        recording = load_recording(source)
        return recording, RecordedDriver(recording), recording.driver, recording.config
    runs, names = [source] if source else [], [options.driver] if options.driver else []
    drivers, config = _drivers(runs, names)
    name, driver = next(iter(drivers.items()))
    return None, driver, name, _overridden(config, options)
