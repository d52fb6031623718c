"""The verb ``replay``: shows a driver or a recorded episode in sumo-gui, as a video or a page."""

import argparse
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from drl_av.cli.options import (
    add_env_options,
    add_flag,
    add_number,
    add_observation,
    add_path,
    add_text,
    custom_parts,
    driver_words,
    rate,
    require_driving_settings,
    require_one_word,
    with_command_line,
)
from drl_av.config.functions import is_factory
from drl_av.drivers.registry import DRIVER_FILES, DriverSpec, default_config, find_drivers
from drl_av.errors import ConfigError, DrlAvError, RecordingError, pluralize

if TYPE_CHECKING:
    from drl_av.drawing.page import PageEpisode
    from drl_av.env.custom import CustomParts
    from drl_av.env.metrics import EpisodeResult
    from drl_av.evaluation.recording import Recording
    from drl_av.evaluation.replay import ReplaySession

USUAL_RATE, USUAL_VEHICLES = 2.0, 15
OTHER_SOURCES = (*DRIVER_FILES, ".toml")
"""Endings of the files that are not recordings."""
SUFFIXES = {
    "html": ".html",
    "record": ".npz",
    "fcd": ".xml",
    "parquet": ".parquet",
    "sheet": ".png",
}
"""The options that write a file, and how its name must end."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``drl-av replay`` to its parser."""
    parser.add_argument(
        "source",
        nargs="*",
        metavar="RUN | RECORDING | TABLE.csv",
        help="a file written by --record, a table of evaluate (with --worst), or a driver in any "
        "form that --driver takes (default: the shipped driver, under strict); with --html also "
        "two drivers, or two recordings, in the same traffic",
    )
    add_text(parser, "--driver", "NAME", driver_words())
    add_text(
        parser,
        "--worst",
        "COLUMN",
        "drive the worst episode of a table again, such as min_ttc_s, the smallest, or "
        "hard_brakes, the largest",
    )
    add_number(parser, "--seed", 0, "traffic seed (default: 0)", shown="S")
    vehicles = "vehicles around the ego (default: the scenario's number, or 15)"
    add_number(parser, "--vehicles", 0, vehicles)
    most = "largest number of decisions, one per second (default: the RUN's, 200)"
    add_number(parser, "--decisions", 1, most)
    how = parser.add_mutually_exclusive_group()
    add_flag(how, "--gui", "show it in sumo-gui (default, unless it writes a file)")
    add_path(how, "--video", "FILE.mp4", "write a .mp4 or .gif video; needs no screen")
    add_path(how, "--html", "FILE.html", "write a page that plays in a browser")
    sheet = "with --worst: draw the critical moments of the ten worst episodes"
    add_path(how, "--sheet", "FILE.png", sheet)
    parser.add_argument(
        "--rate", type=rate, metavar="X", help=f"multiple of real time (default: {USUAL_RATE:g})"
    )
    add_path(parser, "--record", "FILE.npz", "save the episode")
    fcd = "let SUMO write its floating car data: each vehicle at each SUMO step"
    add_path(parser, "--fcd", "FILE.xml", fcd)
    frame = "write drl_av.episode_frame: each vehicle at each decision; needs the extra parquet"
    add_path(parser, "--parquet", "FILE.parquet", frame)
    add_env_options(parser, "the RUN's, but those of trainings")
    add_observation(parser)


def replay(options: argparse.Namespace) -> int:
    """Drive one episode, and show it or write it to a file; return the exit status 0.

    With ``--html`` it drives two, if two are named. With ``--sheet`` it drives ten, and draws a
    moment of each.
    """
    from drl_av.drawing.film import require_film
    from drl_av.drawing.page import PageEpisode, write_page
    from drl_av.evaluation.replay import require_fcd_alone
    from drl_av.evaluation.trajectories import require_parquet, write_parquet
    from drl_av.files.atomic import require_suffix, require_writable
    from drl_av.simulation.sumo_options import files_of_sumo

    if options.html and options.rate is not None:
        raise ConfigError(
            "--rate has no effect on a page, whose menu sets the speed: leave it out."
        )
    if options.rate is not None and not (options.video or _opens_gui(options)):
        raise ConfigError("--rate has no effect without --video or sumo-gui: leave it out.")
    inputs = [*options.source, options.driver, *options.config]
    by_sumo = files_of_sumo(options.sumo_options)
    require_writable(*_written(options), inputs=inputs, by_sumo=by_sumo)
    if options.fcd:
        require_fcd_alone(options.sumo_options or ())
    for name, suffix in SUFFIXES.items():
        require_suffix(getattr(options, name), suffix)
    if options.video:
        require_film(options.video, options.rate or USUAL_RATE)
    if options.parquet:
        require_parquet()
    sessions = _sessions(options)
    if options.sheet:
        return _draw_sheet(options, sessions)
    pages: list[PageEpisode] = []
    driven = [_show(options, session, pages) for session in sessions]
    if options.html:
        write_page(options.html, sessions[0].road, pages)
        print(f"{options.html}: open it in a browser")
    recording, _ = driven[0]
    if options.record:
        recording.save(options.record)
    if options.parquet:
        write_parquet(recording, options.parquet)
    for path in filter(None, (options.record, options.fcd, options.parquet)):
        print(f"{path}: recorded")
    for session, (_, result) in zip(sessions, driven, strict=True):
        _tell(session, result)
    return 0


def _tell(session: "ReplaySession", result: "EpisodeResult") -> None:
    again = session.recording or session.expected
    print(
        f"{session.name}, check {result.safety_check}, "
        f"{pluralize(result.vehicles, 'vehicle')}, seed {result.seed}: "
        f"{'exactly as recorded, ' if again else ''}"
        f"{pluralize(result.decisions, 'decision')}, {result.mean_speed_m_s:.2f} m/s, "
        f"reward {result.mean_reward:.3f}, "
        f"{pluralize(result.safety_triggers, 'safety trigger')}, "
        f"{result.collision or 'no collision'}"
        f"{', ' * bool(result.way)}{result.way}"
    )


def _written(options: argparse.Namespace) -> list[Path | None]:
    return [options.video, *(getattr(options, name) for name in SUFFIXES)]


def _opens_gui(options: argparse.Namespace) -> bool:
    return options.gui or not any(_written(options))


def _sessions(options: argparse.Namespace) -> "list[ReplaySession]":
    """Return the episode to drive, two for one page, or ten of a table with ``--sheet``."""
    from drl_av.evaluation.recording import load_recording
    from drl_av.evaluation.replay import (
        ON_A_SHEET,
        on_its_road,
        replay_session,
        require_same_traffic,
        worst_sessions,
    )

    custom = custom_parts(options)
    tables = [word for word in options.source if Path(word).suffix.lower() == ".csv"]
    if bool(tables) != (options.worst is not None) or (tables and len(options.source) > 1):
        raise ConfigError(
            "--worst takes a table of evaluate, and a table takes --worst, such as: drl-av replay "
            "table.csv --worst min_ttc_s."
        )
    if options.sheet and (not tables or options.record or options.fcd or options.parquet):
        raise ConfigError("--sheet draws ten episodes of --worst, and goes with no other file.")
    if tables:
        _refuse_settings(options, tables[0])
        count = ON_A_SHEET if options.sheet else 1
        given = options.worst, options.driver, custom, options.scenario
        return worst_sessions(Path(tables[0]), *given, count)
    named = [] if options.driver is None else [options.driver]
    words = [*options.source, *named] or ["pretrained"]
    others = [word for word in words if Path(word).suffix.lower() not in OTHER_SOURCES]
    files = [word for word in others if Path(word).is_file()]
    specs = () if files else find_drivers(words)
    allowed = 2 if [*filter(None, _written(options))] == [options.html] else 1
    if max(len(words), len(specs)) > allowed or files not in ([], words):
        raise ConfigError(
            f"{' and '.join(words)} are no one episode: --html, and no other file, shows two "
            "drivers or two recordings, and everything else one."
        )
    if not files:
        return _new_sessions(options, specs, custom)
    recordings = []
    for file in files:
        found = load_recording(Path(file))
        config = on_its_road(found.config, file, options.scenario)
        recordings.append(replace(found, config=config))
    for file, recording in zip(files, recordings, strict=True):
        if options.fcd and recording.config.simulation.world == "twin":
            raise RecordingError(
                f"{file} was recorded in the twin, and SUMO's floating car data (--fcd) come from "
                "SUMO: record the episode anew there, or take --parquet."
            )
        if options.observation is not None:
            raise RecordingError(
                f"--observation has no effect on {file}, whose actions are recorded: leave it out."
            )
        _refuse_settings(options, file, recording.config.safety.check)
    sessions = [replay_session(recording, custom) for recording in recordings]
    require_same_traffic(sessions)
    return sessions


def _new_sessions(
    options: argparse.Namespace, specs: "Sequence[DriverSpec]", custom: "CustomParts"
) -> "list[ReplaySession]":
    """Return the sessions of drivers by the options, whose vehicles fit on the road."""
    from drl_av.env.highway import HighwayEnv
    from drl_av.evaluation.episodes import drivers_in
    from drl_av.evaluation.replay import ReplaySession

    require_one_word(options, {"decisions": "simulation.decisions_per_episode"})
    require_driving_settings(options)
    shared = with_command_line(default_config(specs), options)
    if options.decisions:
        shared = shared.updated("simulation", decisions_per_episode=options.decisions)
    seed, sessions = options.seed or 0, []
    for spec in specs:
        config = spec.config(shared)
        own = custom.beside(spec.under)
        with closing(HighwayEnv(config=config, **own._asdict())) as env:
            implied = env.simulation.fleet.default_vehicle_count
            usual = USUAL_VEHICLES if implied is None else implied
            vehicles = usual if options.vehicles is None else options.vehicles
            env.reset(seed=seed, options={"vehicles": vehicles})  # before code of an agent runs
            [(name, driver)] = drivers_in(env, own, [spec]).items()
        sessions.append(ReplaySession(config, driver, name, seed, vehicles, custom=own))
    return sessions


def _show(
    options: argparse.Namespace, session: "ReplaySession", pages: "list[PageEpisode]"
) -> "tuple[Recording, EpisodeResult]":
    """Drive the session in sumo-gui, for a film, for one of the pages, or without a picture."""
    from drl_av.env.transition import Transition
    from drl_av.env.video import Film
    from drl_av.evaluation.replay import FCD_OPTIONS, Pacer, page_episode
    from drl_av.files.atomic import replacing

    pace = options.rate or USUAL_RATE
    with ExitStack() as stack:
        if options.fcd:
            unfinished = stack.enter_context(replacing(options.fcd))
            session = session.with_options("--fcd-output", str(unfinished), *FCD_OPTIONS)
        if options.video:
            film = Film(session.name, session.road, session.seed)
            driven = session.drive(None, film.add)
            print(f"{options.video}: {pluralize(film.write(options.video, rate=pace), 'frame')}")
        elif options.html:
            decisions = list[Transition]()
            driven = session.drive(None, decisions.append)
            pages.append(page_episode(session, decisions))
        elif _opens_gui(options):
            driven = session.drive("human", Pacer(pace))
        else:
            driven = session.drive(None)
        if options.fcd and not unfinished.read_bytes().rstrip().endswith(b"</fcd-export>"):
            raise DrlAvError(
                f"SUMO could not write {options.fcd} to its end: free some space; what was there "
                "before is unchanged."
            )
    return driven


def _draw_sheet(options: argparse.Namespace, sessions: "Sequence[ReplaySession]") -> int:
    from drl_av.evaluation.replay import contact_sheet
    from drl_av.files.atomic import write_atomic

    write_atomic(options.sheet, contact_sheet(sessions, options.worst))
    print(
        f"{options.sheet}: the {pluralize(len(sessions), 'episode')} with the worst {options.worst}"
    )
    return 0


def _refuse_settings(options: argparse.Namespace, source: str, check: str | None = None) -> None:
    """Raise RecordingError if an option would change a recorded episode, driven under this check.

    Only a check of the user's own has to be named again, as a file may run no code.
    """
    names = "seed", "vehicles", "decisions", "safety_check", "traffic", "config", "world"
    given = [name for name in names if getattr(options, name) not in (None, [])]
    is_own = options.safety_check is not None and is_factory(options.safety_check)
    if is_own and check in (None, options.safety_check):
        given.remove("safety_check")
    if given:
        option = "--config and -o" if given[0] == "config" else f"--{given[0].replace('_', '-')}"
        raise RecordingError(
            f"{option} cannot be changed in {source}: its episodes are driven as they were."
        )
