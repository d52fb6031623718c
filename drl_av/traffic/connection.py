"""Starting SUMO, and errors that name what the machine lacks for it."""

import ctypes
import importlib
import importlib.util
import io
import platform
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

from drl_av.config import Config
from drl_av.errors import DisplayError, SimulationError

GUI_OPTIONS = ("--start", "true", "--quit-on-end", "true", "--window-size", "1280,720")


def require_display() -> None:
    """Raise DisplayError if there is no screen, because sumo-gui would end the interpreter."""
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
    """The module libsumo, or traci for sumo-gui; raises SimulationError, which names what lacks.

    libsumo can show sumo-gui too, but cannot load a second episode, and hangs when it is closed.
    """
    name = "traci" if gui else "libsumo"
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SimulationError(missing_library(name, str(error))) from error


def getters(sumo: ModuleType, names: Sequence[str]) -> list[Callable[[str], Any]]:
    """Functions of ``sumo.vehicle`` by name; for libsumo, without the Python wrappers of SWIG.

    The wrappers take a quarter to a third of the time that a call needs.
    """
    within = getattr(sumo, "_libsumo", None)
    return [getattr(within, f"vehicle_{name}", getattr(sumo.vehicle, name)) for name in names]


@contextmanager
def short_names(files: Sequence[Path]) -> Iterator[list[str]]:
    """Short names of files for libsumo, under /dev/fd if it exists, valid inside the block.

    libsumo leaks the copies that it makes of a path, about seven for each file and start, and
    replaces ``${HOME}`` in a path as a variable.
    """
    if not Path("/proc/self/fd").is_dir():
        yield [str(file) for file in files]
        return
    with ExitStack() as stack:
        opened = [stack.enter_context(file.open("rb")) for file in files]
        yield [f"/dev/fd/{file.fileno()}" for file in opened]


def start_arguments(files: Sequence[str], seed: int, config: Config) -> list[str]:
    """The command line arguments of SUMO; the first file is the network."""
    return [
        *("--net-file", files[0]),
        *("--additional-files", ",".join(files[1:])),
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
    ]


def start(
    sumo: ModuleType,
    files: Sequence[Path],
    seed: int,
    config: Config,
    view: Path | None = None,
) -> None:
    """Start libsumo, or sumo-gui through traci if ``view`` is given; SUMO must not run yet."""
    if view is None:
        with short_names(files) as names:
            sumo.start(["sumo", *start_arguments(names, seed, config)])
        return
    sumo_gui = str(program("sumo-gui"))
    arguments = start_arguments([*map(str, files)], seed, config)
    own = ["--gui-settings-file", str(view), *GUI_OPTIONS]
    with redirect_stdout(io.StringIO()):
        sumo.start([sumo_gui, *arguments, *own], stdout=subprocess.DEVNULL)


def program(name: str) -> Path:
    """The path of a program of the package eclipse-sumo; raises SimulationError if it lacks."""
    package = importlib.util.find_spec("sumo")
    for folder in (package and package.submodule_search_locations) or ():
        for file in (name, f"{name}.exe"):
            if (path := Path(folder, "bin", file)).is_file():
                return path
    raise SimulationError(f"SUMO's {name} is not installed: run pip install eclipse-sumo.")


def missing_library(what: str, message: str) -> str:
    """An error message that names the shared library that a loader reports as missing."""
    found = re.search(r"lib[\w.+-]+?\.so[.\d]*", message)
    library = found.group() if found else "named here: " + " ".join(message.split())
    return (
        f"{what} needs the system library {library}, which this machine lacks: install it, "
        "on Debian or Ubuntu with: apt-get install libgl1 libx11-6 libxext6 libxrender1."
    )
