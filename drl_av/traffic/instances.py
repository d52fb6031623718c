"""Simulations side by side in one process: the installed libsumo, and copies of its library.

libsumo keeps its simulation in static variables, one set for each library that is loaded. A copy
of the file is loaded apart, and is an independent simulation; a hard link is not, because loaders
recognize a file by its inode. A copy costs 30 ms, 30 MiB of disk and 17 MiB of memory.
"""

import ctypes
import importlib
import importlib.util
import itertools
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import IO

from drl_av.errors import SimulationError
from drl_av.traffic.connection import connection

OPEN_FILES = Path("/proc/self/fd")
SHARED_ERRORS = ("TraCIException", "FatalTraCIError")


@dataclass(frozen=True, eq=False)
class Instance:
    """One simulation of this process, and who may use it.

    Attributes:
        sumo: libsumo, a copy of it, or traci.
    """

    sumo: ModuleType
    _taken: Lock = field(default_factory=Lock, repr=False)

    def take(self) -> bool:
        """Take it if it is free; it is not while a program of the user's own runs SUMO in it."""
        if not self._taken.acquire(blocking=False):
            return False
        if self.sumo.isLoaded():
            self._taken.release()
            return False
        return True

    def release(self) -> None:
        """End SUMO, which may have ended on its own, and leave the instance to others."""
        try:
            with suppress(self.sumo.FatalTraCIError):
                self.sumo.close()
        finally:
            self._taken.release()


_instances: list[Instance] = []
_numbers = itertools.count()


def acquire(gui: bool) -> Instance:
    """Take a simulation of this process that is free: the installed libsumo before its copies.

    Threads may call it at once, and a forked process has the free ones of its parent: all that is
    shared are the lock of each instance, which is never waited for, and a list that only grows.

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
    """sumo-gui, which the module traci connects to."""
    return Instance(connection(gui=True))


def _copied_package(number: int) -> ModuleType:
    """The package libsumo once more under another name, around a copy of its library.

    All copies share the types of the installed package, as SWIG has one table of them a process:
    it raises the classes that were registered last, so those of the copies are not registered.
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
    for error in SHARED_ERRORS:  # before the package hands them on to traci
        setattr(proxies, error, getattr(libsumo, error))
    spec.loader.exec_module(package)
    if package.isLoaded():
        raise _no_copy("the copy is not independent")
    return package


def _copied_library(name: str, library: Path, number: int) -> ModuleType:
    """A copy of an extension module, loaded under a name; raises SimulationError."""
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
        except (OSError, ImportError) as error:
            reason = " ".join(str(error).split()).rstrip(".")
        else:
            return module
    raise _no_copy(reason)


def _is_global(symbol: str) -> bool:
    """Whether every library that is loaded from now on sees a symbol, and takes it for its own."""
    return os.name == "posix" and hasattr(ctypes.CDLL(None), symbol)


def _no_copy(reason: str) -> SimulationError:
    return SimulationError(
        f"This process has a simulation already, and cannot copy libsumo for another ({reason}): "
        "close the other environment first, or give each a process of its own, by "
        "make_vec(..., vectorization_mode='async', vector_kwargs={'context': 'spawn'}), "
        "SubprocVecEnv(..., start_method='spawn') or --vec-env subproc."
    )


@contextmanager
def _copied_file(file: Path, folder: Path, number: int) -> Iterator[str]:
    """A path from which to load a copy of a file; the loaded copy outlives its file.

    On Linux the copy has no name in any folder, so that it is gone with the process, however that
    ends. Its path has the number in it, because the loader takes one path twice for one library.
    """
    anonymous = OPEN_FILES.is_dir()
    temporary = tempfile.TemporaryFile if anonymous else tempfile.NamedTemporaryFile
    with file.open("rb") as source, temporary(dir=folder, suffix=file.suffix) as copy:
        _copy(source, copy)
        yield f"{OPEN_FILES}/{'./' * number}{copy.fileno()}" if anonymous else copy.name


def _copy(source: IO[bytes], target: IO[bytes]) -> None:
    """Copy on write where the file system can, which copy_file_range does by itself."""
    try:
        while os.copy_file_range(source.fileno(), target.fileno(), 2**30):
            pass
    except (AttributeError, OSError):  # another platform, or another file system
        source.seek(0)
        target.seek(0)
        shutil.copyfileobj(source, target)
        target.flush()
