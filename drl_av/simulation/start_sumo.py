"""Starts SUMO, and several simulations in one process.

libsumo keeps its simulation in static variables, one set for each loaded library. A copy of the
library file is loaded separately and is therefore an independent simulation. A hard link is not,
because the loader identifies a file by its inode. A copy costs 30 ms, 30 MiB of disk and 17 MiB of
memory.
"""

import ctypes
import importlib
import importlib.util
import io
import itertools
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from threading import Lock
from types import ModuleType

from drl_av.config import Config
from drl_av.errors import DisplayError, SimulationError
from drl_av.simulation.sumo_options import start_arguments
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


OPEN_FILES = Path("/proc/self/fd")
SHARED_ERRORS = ("TraCIException", "FatalTraCIError")


@dataclass(frozen=True, eq=False)
class Instance:
    """One simulation of this process, with a lock for its exclusive use.

    Attributes:
        sumo: The module that controls the simulation: libsumo, a copy of libsumo, or traci.
    """

    sumo: ModuleType
    _taken: Lock = field(default_factory=Lock, repr=False)

    def take(self) -> bool:
        """Reserve the instance if it is free, and return whether it was free.

        It is not free if it is already reserved, or if the user's own program runs SUMO in it.
        """
        if not self._taken.acquire(blocking=False):
            return False
        if self.sumo.isLoaded():
            self._taken.release()
            return False
        return True

    def release(self) -> None:
        """End SUMO in this instance if it runs, and free the instance for other simulations."""
        try:
            with suppress(self.sumo.FatalTraCIError):
                self.sumo.close()
        finally:
            self._taken.release()


_instances: list[Instance] = []
_numbers = itertools.count()


def acquire(gui: bool) -> Instance:
    """Reserve an instance of SUMO that is free in this process, and return it.

    Without ``gui`` it is the installed libsumo, or a copy of it if that is in use. With ``gui`` it
    is sumo-gui, of which there is only one. The function is thread-safe, and a forked process can
    use the instances that are free in its parent.

    Raises:
        SimulationError: sumo-gui is open already, or libsumo is in use and cannot be copied.
    """
    if gui:
        if _window().take():
            return _window()
        raise SimulationError(
            "sumo-gui shows one environment of a process at a time: close the other one first, or "
            "make this one with render_mode='rgb_array'."
        )
    while True:
        for instance in tuple(_instances):
            if instance.take():
                return instance
        number = next(_numbers)
        _instances.append(Instance(_copied_package(number) if number else connection(gui=False)))


@cache
def _window() -> Instance:
    """Return the instance of sumo-gui, which is controlled through the module traci."""
    return Instance(connection(gui=True))


def _copied_package(number: int) -> ModuleType:
    """Load and return a second package libsumo under another name, with a copy of its library.

    All copies use the exception classes of the installed package, because SWIG has one table of
    types for each process and raises the classes that were registered last. Therefore the classes
    of a copy are not registered. ``number`` makes the name unique.

    Raises:
        SimulationError: the library cannot be copied, or the copy is not independent.
    """
    libsumo = connection(gui=False)
    name = f"{libsumo.__name__}_{number}"
    library = _copied_library(f"{name}._libsumo", Path(libsumo._libsumo.__file__), number)
    for register in [word for word in vars(library) if word.endswith("_swigregister")]:
        setattr(library, register, lambda kind: None)
    spec = importlib.util.spec_from_file_location(
        name, libsumo.__file__, submodule_search_locations=[*libsumo.__path__]
    )
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    package._libsumo = library  # type: ignore[attr-defined]
    sys.modules.update({name: package, library.__name__: library})
    proxies = importlib.import_module(f"{name}.libsumo")
    for error in SHARED_ERRORS:  # before exec_module, which passes them to traci
        setattr(proxies, error, getattr(libsumo, error))
    spec.loader.exec_module(package)
    if package.isLoaded():
        raise _no_copy("the copy is not independent")
    return package


def _copied_library(name: str, library: Path, number: int) -> ModuleType:
    """Load a copy of the extension module in the file ``library`` as a module called ``name``."""
    if _is_global(f"PyInit_{library.name.partition('.')[0]}"):
        raise _no_copy("it was loaded with RTLD_GLOBAL, so that a copy would use its variables")
    for folder in (library.parent, Path(tempfile.gettempdir())):
        try:
            with _copied_file(library, folder, number) as copy:
                loader = ExtensionFileLoader(name, copy)
                spec = importlib.util.spec_from_loader(name, loader)
                assert spec is not None
                module = importlib.util.module_from_spec(spec)
                loader.exec_module(module)
            # the copy has no name, and its descriptor will belong to another file later
            module.__file__ = spec.origin = str(library)
        except (OSError, ImportError) as error:
            reason = " ".join(str(error).split()).rstrip(".")
        else:
            return module
    raise _no_copy(reason)


def _is_global(symbol: str) -> bool:
    """Return whether a symbol is global, so that each library loaded later would share it."""
    return os.name == "posix" and hasattr(ctypes.CDLL(None), symbol)


def _no_copy(reason: str) -> SimulationError:
    """Return an error that says why libsumo cannot be copied, and what the user can do."""
    return SimulationError(
        f"This process has a simulation already, and cannot copy libsumo for another ({reason}): "
        "close the other environment first, or run each one in its own process, by "
        "make_vec(..., vectorization_mode='async', vector_kwargs={'context': 'spawn'}), "
        "SubprocVecEnv(..., start_method='spawn') or --vec-env subproc."
    )


@contextmanager
def _copied_file(file: Path, folder: Path, number: int) -> Iterator[str]:
    """Yield the path of a temporary copy of a file; a library loaded from it outlives the block.

    On Linux the copy has no name in any folder, so it disappears with the process in any case. The
    path contains ``number``, because the loader does not load the same path twice.
    """
    anonymous = OPEN_FILES.is_dir()
    temporary = tempfile.TemporaryFile if anonymous else tempfile.NamedTemporaryFile
    with temporary(dir=folder, suffix=file.suffix) as copy:
        path = f"{OPEN_FILES}/{'./' * number}{copy.fileno()}" if anonymous else copy.name
        shutil.copyfile(file, path)
        yield path
