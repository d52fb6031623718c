"""Functions that start SUMO, and error messages that name the missing software."""

import ctypes
import io
import platform
import shlex
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout
from pathlib import Path
from types import ModuleType

from drl_av.config import Config
from drl_av.errors import ConfigError, DisplayError
from drl_av.sumo_programs import program, require_plain_numbers, sumo_module

GUI_OPTIONS = ("--start", "true", "--quit-on-end", "true", "--window-size", "1280,800")


def require_display() -> None:
    """Raise DisplayError if there is no screen, because sumo-gui would then end the Python process.

    The error is also raised if libX11 is missing. The check is made on Linux only.
    """
    if platform.system() != "Linux":
        return
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError as error:
        raise DisplayError(
            "sumo-gui needs the system library libX11.so.6, which this machine lacks: install "
            "the package libx11-6, or use --video instead."
        ) from error
    x11.XOpenDisplay.restype = ctypes.c_void_p
    display = x11.XOpenDisplay(None)
    if not display:
        raise DisplayError(
            "sumo-gui has no screen to open on: set DISPLAY, run under xvfb-run, "
            "or make a video instead (drl-av replay --video FILE.mp4)."
        )
    x11.XCloseDisplay(ctypes.c_void_p(display))


def connection(gui: bool) -> ModuleType:
    """Return the module libsumo, or traci if ``gui`` is true, to control SUMO.

    libsumo can open sumo-gui too, but then it cannot load a second episode, and it hangs when it is
    closed.

    Raises:
        SimulationError: the module cannot be imported, or only an older version of it.
    """
    return sumo_module("traci" if gui else "libsumo")


@contextmanager
def short_names(files: Sequence[Path]) -> Iterator[list[str]]:
    """Yield short names of files for libsumo, which are valid inside the ``with`` block.

    libsumo leaks about seven copies of each path at each start, and replaces ``${HOME}`` in a path.
    The short names are paths in /dev/fd. On a system without /proc/self/fd they are the paths of
    the files.
    """
    if not Path("/proc/self/fd").is_dir():
        yield [str(file) for file in files]
        return
    with ExitStack() as stack:
        opened = [stack.enter_context(file.open("rb")) for file in files]
        yield [f"/dev/fd/{file.fileno()}" for file in opened]


def option_words(given: str | Sequence[str]) -> tuple[str, ...]:
    """Return SUMO options of the user as words, ``--NAME=VALUE`` as two.

    Raises:
        ConfigError: the text has an open quotation mark, or an option is set by drl-av.
    """
    try:
        words = [*given] if not isinstance(given, str) else shlex.split(given)
    except ValueError as error:
        raise ConfigError(f"sumo_options is {given!r}: close its quotation mark.") from error
    parted = [part for word in words for part in _parted(word)]
    for name in (word.lstrip("-") for word in parted if word.startswith("-")):
        if name in ("r", "route-files"):
            raise ConfigError(
                f"sumo_options has -{'-' * (len(name) > 1)}{name}, but drl-av places the vehicles: "
                "put types into an additional file, or drive with drl_av.attach in a simulation of "
                "your own."
            )
        if name in SET_BY_US:
            raise ConfigError(f"sumo_options has {name}, which drl-av sets itself: leave it out.")
    return tuple(parted)


def _parted(word: str) -> list[str]:
    return word.split("=", 1) if word.startswith("--") else [word]


def start_arguments(
    files: Sequence[str], seed: int, config: Config, own: Sequence[str] = ()
) -> list[str]:
    """Return the command line arguments of SUMO for a scenario.

    ``files`` holds the network file and then the additional files; ``seed`` seeds SUMO. ``own``
    are the words of ``option_words``; their additional files are read after ours.
    """
    others = [*own]
    additional = [*files[1:]]
    for place in reversed([row for row, word in enumerate(own) if word in ADDITIONAL_FILES]):
        additional += others[place + 1 : place + 2]
        del others[place : place + 2]
    return [
        *("--net-file", files[0]),
        *("--additional-files", ",".join(additional)),
        *("--seed", str(seed % 2**31)),
        *("--step-length", repr(config.simulation.step_length_s)),
        *("--lateral-resolution", repr(config.simulation.lateral_resolution_m)),
        *("--lanechange.overtake-right", str(config.traffic.overtake_right).lower()),
        *("--time-to-teleport", "-1"),
        *("--collision.action", "warn"),
        *("--collision.mingap-factor", "0"),
        *("--collision.check-junctions", "true"),
        *("--insertion-checks", "none"),
        *("--no-step-log", "true"),
        *("--no-warnings", "true"),
        *("--xml-validation", "never"),
        *others,
    ]


ADDITIONAL_FILES = ("-a", "--additional-files", "--additional")
SET_BY_US = {"n", "net", "c", "configuration", "configuration-file"} | {
    word.removeprefix("--")
    for word in start_arguments(["", ""], 0, Config())
    if word.startswith("--") and word not in ADDITIONAL_FILES
}
"""The options that the user may not set."""


def start(
    sumo: ModuleType,
    files: Sequence[Path],
    seed: int,
    config: Config,
    view: Path | None = None,
    own: Sequence[str] = (),
) -> None:
    """Start libsumo if ``view`` is None; otherwise start sumo-gui through traci.

    ``sumo`` is the module libsumo or traci, in which SUMO must not be running yet. ``view`` is the
    path of the view settings. The first of ``files`` is the network file. ``own`` are the user's
    words of ``option_words``.
    """
    require_plain_numbers()
    if view is None:
        with short_names(files) as names:
            sumo.start(["sumo", *start_arguments(names, seed, config, own)])
        return
    sumo_gui = str(program("sumo-gui"))
    arguments = start_arguments([*map(str, files)], seed, config, own)
    shown = ["--gui-settings-file", str(view), *GUI_OPTIONS]
    with redirect_stdout(io.StringIO()):
        sumo.start([sumo_gui, *arguments, *shown], stdout=subprocess.DEVNULL)
