"""The verb ``replay``: shows a driver or a recorded episode in sumo-gui, as a video or a page."""

import argparse
from contextlib import ExitStack, closing
from pathlib import Path

from drl_av.cli.options import (
    add_env_options,
    custom_parts,
    driver_words,
    int_at_least,
    rate,
    with_command_line,
)
from drl_av.config.functions import is_factory
from drl_av.drivers.registry import (
    DRIVER_FILES,
    default_config,
    find_drivers,
    make_drivers,
)
from drl_av.errors import ConfigError, RecordingError, pluralize

USUAL_RATE = 2.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av replay`` to its parser."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "source",
        nargs="?",
        metavar="RUN | RECORDING",
        help="a file written by --record, or a driver in any form that --driver takes "
        "(default: the shipped driver, under strict)",
    )
    which.add_argument("--driver", metavar="NAME", help=driver_words())
    parser.add_argument(
        "--seed", type=int_at_least(0), metavar="S", help="traffic seed (default: 0)"
    )
    parser.add_argument(
        "--vehicles",
        type=int_at_least(0),
        metavar="N",
        help="vehicles around the ego (default: the scenario's number, or 15)",
    )
    parser.add_argument(
        "--decisions",
        type=int_at_least(1),
        metavar="N",
        help="largest number of decisions, one per second (default: the RUN's, 200)",
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--gui", action="store_true", help="show it in sumo-gui (default, unless it writes a file)"
    )
    how.add_argument(
        "--video", type=Path, metavar="FILE.mp4", help="write a .mp4 or .gif video; needs no screen"
    )
    how.add_argument(
        "--html", type=Path, metavar="FILE.html", help="write a page that plays in a browser"
    )
    parser.add_argument(
        "--rate", type=rate, metavar="X", help=f"multiple of real time (default: {USUAL_RATE:g})"
    )
    parser.add_argument("--record", type=Path, metavar="FILE.npz", help="save the episode")
    parser.add_argument(
        "--fcd",
        type=Path,
        metavar="FILE.xml",
        help="let SUMO write its floating car data: each vehicle at each SUMO step",
    )
    parser.add_argument(
        "--parquet",
        type=Path,
        metavar="FILE.parquet",
        help="write drl_av.episode_frame: each vehicle at each decision; needs the extra parquet",
    )
    add_env_options(parser, "the RUN's")


def replay(options: argparse.Namespace) -> int:
    """Drive one episode, and show it or write it to a file; return the exit status 0."""
    from drl_av.drawing.film import require_film
    from drl_av.env.highway import HighwayEnv
    from drl_av.env.video import Film
    from drl_av.evaluation.recording import load_recording
    from drl_av.evaluation.replay import (
        FCD_OPTIONS,
        USUAL_VEHICLES,
        Pacer,
        Page,
        ReplaySession,
        replay_session,
    )
    from drl_av.evaluation.trajectories import write_parquet
    from drl_av.files import replacing, require_suffix, require_writable

    if options.html and options.rate is not None:
        raise ConfigError(
            "--rate has no effect on a page, whose menu sets the speed: leave it out."
        )
    pace = USUAL_RATE if options.rate is None else options.rate
    inputs = [options.source, options.driver, *options.config]
    written = options.record, options.video, options.html, options.fcd, options.parquet
    require_writable(*written, inputs=inputs)
    suffixes = {"html": ".html", "record": ".npz", "fcd": ".xml", "parquet": ".parquet"}
    for name, suffix in suffixes.items():
        require_suffix(getattr(options, name), suffix)
    if options.video:
        require_film(options.video, pace)
    given = (options.source, options.driver, "pretrained")
    source = next(word for word in given if word is not None)
    custom = custom_parts(options)
    if Path(source).is_file() and Path(source).suffix not in (*DRIVER_FILES, ".toml"):
        recording = load_recording(Path(source))
        _refuse_settings(options, source, recording.config.safety.check)
        session = replay_session(recording, custom)
    else:
        specs = find_drivers([source])
        config = with_command_line(default_config(specs), options)
        if options.decisions:
            config = config.updated("simulation", decisions_per_episode=options.decisions)
        seed = options.seed or 0
        config = specs[0].config(config)
        if specs[0].under:
            custom = custom._replace(safety_check=None)
        with closing(HighwayEnv(config=config, **custom._asdict())) as env:
            implied = env.simulation.fleet.default_vehicle_count
            usual = USUAL_VEHICLES if implied is None else implied
            vehicles = usual if options.vehicles is None else options.vehicles
            env.reset(seed=seed, options={"vehicles": vehicles})
            check = env.safety_check if custom.safety_check else None
        [(name, driver)] = make_drivers(specs, config, check).items()
        session = ReplaySession(config, driver, name, seed, vehicles, custom=custom)
    with ExitStack() as stack:
        if options.fcd:
            unfinished = stack.enter_context(replacing(options.fcd))
            session = session.with_options("--fcd-output", str(unfinished), *FCD_OPTIONS)
        if options.video:
            film = Film(session.name, session.road, session.seed)
            recording, result = session.drive(None, film.add)
            print(f"{options.video}: {pluralize(film.write(options.video, rate=pace), 'frame')}")
        elif options.html:
            page = Page(f"{session.name}, seed {session.seed}", session.road, session.driver)
            recording, result = session.drive(None, page)
            page.write(options.html)
            print(f"{options.html}: open it in a browser")
        elif any(written) and not options.gui:
            recording, result = session.drive(None)
        else:
            recording, result = session.drive("human", Pacer(pace))
    if options.record:
        recording.save(options.record)
    if options.parquet:
        write_parquet(recording, options.parquet)
    for path in filter(None, (options.record, options.fcd, options.parquet)):
        print(f"{path}: recorded")
    print(
        f"{session.name}, check {result.safety_check}, "
        f"{pluralize(result.vehicles, 'vehicle')}, seed {result.seed}: "
        f"{'exactly as recorded, ' if session.recording else ''}"
        f"{pluralize(result.decisions, 'decision')}, {result.mean_speed_m_s:.2f} m/s, "
        f"reward {result.mean_reward:.3f}, "
        f"{pluralize(result.safety_triggers, 'safety trigger')}, "
        f"{result.collision or 'no collision'}"
        f"{', ' * bool(result.way)}{result.way}"
    )
    return 0


def _refuse_settings(options: argparse.Namespace, recording: str, check: str) -> None:
    """Raise RecordingError if an option would change a recording made under this check.

    Only a check of the user's own has to be named again, as a recording may run no code.
    """
    names = ("seed", "vehicles", "decisions", "scenario", "safety_check", "traffic", "config")
    given = [name for name in names if getattr(options, name) not in (None, [])]
    if is_factory(check) and options.safety_check == check:
        given.remove("safety_check")
    if given:
        raise RecordingError(
            f"--{given[0].replace('_', '-')} cannot be changed in {recording}: "
            "a recording is replayed as it was recorded."
        )
