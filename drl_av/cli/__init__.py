"""The ``drl-av`` command: parse, call, print; every room is opened inside its verb."""

import argparse
import io
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from drl_av.cli.learning import INTERRUPTED, adapt, train
from drl_av.cli.options import Verb, command_line, overridden
from drl_av.cli.reproduction import reproduce
from drl_av.config import Config
from drl_av.errors import DrlAvError, RecordingError

SAVE_EVERY_S = 5.0
"""What an evaluation may lose where its process dies; SUMO can take it along."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb; returns the exit status: 0, 1 for a failure told in one sentence, 2 for usage."""
    try:
        with _printable():
            options = command_line(VERBS).parse_args(arguments)
            verb: Verb = options.verb
            return verb(options)
    except BrokenPipeError:
        return 1
    except (DrlAvError, OSError) as error:
        print("drl-av:", *str(error).split(), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("drl-av: interrupted.", file=sys.stderr)
        return INTERRUPTED


@contextmanager
def _printable() -> Iterator[None]:
    """A character that the output has no code for is told by its number; a full output, at once.

    Raises:
        BrokenPipeError: nobody reads the output any more.
        DrlAvError: it cannot be written.
    """
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper) and out.errors == "strict":
        out.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        try:
            if out is not None:
                out.flush()
        except OSError as error:  # Python would try again at its end, and complain
            os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())
            if isinstance(error, BrokenPipeError):
                raise
            raise DrlAvError(
                f"The output cannot be written ({error.strerror}): print it somewhere else."
            ) from error


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


def _evaluate(options: argparse.Namespace) -> int:
    from drl_av.cli.console import print_summaries, progress_bar
    from drl_av.studies.drivers import choose, config_of
    from drl_av.studies.evaluation import Evaluation, summarize, write_rows, write_summaries
    from drl_av.studies.files import require_writable

    require_writable(options.out, options.json)
    choices = choose([*options.runs, *options.driver] or ["pretrained"])
    config = overridden(config_of(choices), options)
    seeds = range(options.seed, options.seed + options.episodes)
    evaluation = Evaluation(config, choices, tuple(options.vehicles or ()), seeds)
    rows, status, saved_s = [], 0, time.monotonic()
    try:
        with (
            progress_bar("evaluating", len(evaluation)) as bar,
            closing(evaluation.rows(options.jobs)) as found,
        ):
            for row in found:
                rows.append(row)
                bar.advance(f"{row.driver}, {row.vehicles} vehicles", row.decisions)
                if options.out and time.monotonic() - saved_s > SAVE_EVERY_S:
                    write_rows(options.out, rows)
                    saved_s = time.monotonic()
    except KeyboardInterrupt:
        status = INTERRUPTED
        print(f"drl-av: interrupted after {len(rows)} episodes.", file=sys.stderr)
    finally:
        if rows and options.out:
            write_rows(options.out, rows)
    if rows and options.json:
        write_summaries(options.json, summarize(rows))
    if rows:
        print_summaries(summarize(rows))
    return status


def _replay(options: argparse.Namespace) -> int:
    from drl_av.studies.drivers import build, choose, config_of
    from drl_av.studies.files import require_writable
    from drl_av.studies.replay import Film, Pacer, Ride, load_recording, ride_again
    from drl_av.video import require_film

    require_writable(options.record, options.video)
    if options.video:
        require_film(options.video, options.rate)
    given = (options.source, options.driver, "pretrained")
    source = next(word for word in given if word is not None)
    if Path(source).is_file() and Path(source).suffix != ".safetensors":
        _refuse_settings(options)
        ride = ride_again(load_recording(Path(source)))
    else:
        choices = choose([source])
        config = overridden(config_of(choices), options)
        if options.decisions:
            config = config.updated("simulation", decisions_per_episode=options.decisions)
        [(name, driver)] = build(choices, config).items()
        ride = Ride(config, driver, name, options.seed or 0, options.vehicles)
    film = Film(ride.name)
    if options.video:
        recording, result = ride.drive("rgb_array", film)
        print(f"{options.video}: {film.write(options.video, rate=options.rate)} frames")
    else:
        recording, result = ride.drive("human", Pacer(options.rate))
    if options.record:
        recording.save(options.record)
        print(f"{options.record}: recorded")
    print(
        f"{ride.name}, {result.vehicles} vehicles, seed {result.seed}: "
        f"{'exactly as recorded, ' if ride.recording else ''}{result.decisions} decisions, "
        f"{result.mean_speed_m_s:.2f} m/s, reward {result.mean_reward:.3f}, "
        f"{result.safety_triggers} safety triggers, {result.collision or 'no collision'}"
    )
    return 0


def _refuse_settings(options: argparse.Namespace) -> None:
    names = ("seed", "vehicles", "decisions", "scenario", "safety_check", "config")
    given = [name for name in names if getattr(options, name) is not None]
    if given:
        raise RecordingError(
            f"--{given[0].replace('_', '-')} cannot be changed in {options.source}: "
            "a recording is replayed as it was recorded."
        )


def _figures(options: argparse.Namespace) -> int:
    from drl_av.studies.figures import learning_figure, reward_figure, save_figure, speed_figure
    from drl_av.studies.lane_change_figure import lane_change_figure
    from drl_av.studies.reproduction.published import published

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


VERBS: dict[str, Verb] = {
    "scenario": _scenario,
    "train": train,
    "evaluate": _evaluate,
    "adapt": adapt,
    "replay": _replay,
    "figures": _figures,
    "reproduce": reproduce,
}
