"""Where SUMO's programs and Python modules are, checked once, and errors that name what is missing.

A machine may hold several SUMOs. drl-av uses the one whose version it requires, whatever SUMO_HOME,
PYTHONPATH, LIBSUMO_AS_TRACI and the language of this process say.
"""

import importlib
import importlib.util
import locale
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from types import ModuleType

from drl_av.errors import SimulationError, warn

SERIES = "1.28"
"""The version of SUMO that drl-av is made for, as in the requirements of the package."""
AS_TRACI = ("LIBSUMO_AS_TRACI", "LIBTRACI_AS_TRACI")
"""Variables that make the module traci another one, which cannot control sumo-gui."""


def program(name: str) -> Path:
    """Return the path of a program of the package eclipse-sumo, such as netconvert.

    Raises:
        SimulationError: the program is not installed.
    """
    package = importlib.util.find_spec("sumo")
    places = [*((package and package.submodule_search_locations) or ())]
    if (installed := _folder("eclipse-sumo")) is not None:
        places.insert(0, str(installed / "sumo"))
    for folder in places:
        for file in (name, f"{name}.exe"):
            if (path := Path(folder, "bin", file)).is_file():
                return path
    raise SimulationError(f"SUMO's {name} is not installed: run pip install eclipse-sumo.")


@cache
def _folder(distribution: str) -> Path | None:
    """Return the folder of the installed package of the right version; None if there is none."""
    for found in metadata.distributions(name=distribution):
        if found.version.startswith(f"{SERIES}."):
            return Path(str(found.locate_file("")))
    return None


def sumo_module(name: str) -> ModuleType:
    """Import libsumo, traci or sumolib of the right version, or a module in one of them.

    Older modules in other folders of PYTHONPATH are passed over.

    Raises:
        SimulationError: only another version can be imported, a shared library is missing, or the
            module traci is another one.
    """
    top = name.partition(".")[0]
    try:
        with _right_version_first(top), _without_variables(AS_TRACI):
            module = importlib.import_module(name)
    except ImportError as error:
        _require_version(top, "traci", "sumolib")
        raise SimulationError(missing_library(name, str(error))) from error
    _require_version(top, *(["traci"] if top != "sumolib" else []))
    if top == "traci" and getattr(module, "isLibsumo", bool)():
        raise SimulationError(
            f"The module traci is libsumo in this process, as {' or '.join(AS_TRACI)} makes it: "
            "unset the variable before traci is imported."
        )
    return module


def _require_version(*names: str) -> None:
    """Raise SimulationError if one of these modules was imported with another version."""
    for each in names:
        module = sys.modules.get(each)
        spec = getattr(module, "__spec__", None)
        if module is None or spec is None or not spec.origin:
            continue
        folder = Path(spec.origin).parent
        version = _version_in(folder)
        if version is not None and not version.startswith(f"{SERIES}."):
            raise SimulationError(
                f"{each} {version} was imported from {folder}, but drl-av needs {SERIES}: remove "
                "that folder from PYTHONPATH, or import drl_av first."
            )


def _version_in(package: Path) -> str | None:
    """Return the version of the package in this folder; None if nothing there says it."""
    for described in package.parent.glob(f"{package.name}-*.dist-info"):
        return described.name.removesuffix(".dist-info").partition("-")[2]
    for file in (package / "__init__.py", package / "version.py"):
        text = file.read_text(encoding="utf-8", errors="replace") if file.is_file() else ""
        if found := re.search(r"_version(?:__)?\s*=\s*[\"'](\d+\.[\w.]+)[\"']", text):
            return found[1]
    return None


@contextmanager
def _right_version_first(name: str) -> Iterator[None]:
    """Let Python search in the block the folder of the right version before all others."""
    folder = _folder(name)
    if folder is None or name in sys.modules:
        yield
        return
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))


@contextmanager
def _without_variables(names: tuple[str, ...]) -> Iterator[None]:
    taken = {name: os.environ.pop(name) for name in names if name in os.environ}
    try:
        yield
    finally:
        os.environ.update(taken)


def require_plain_numbers() -> None:
    """Let this process write 3.8 with a point again, if another library has made that a comma.

    SUMO reads numbers by the setting LC_NUMERIC of its process, and would refuse its own.
    """
    if locale.localeconv()["decimal_point"] == ".":
        return
    former = locale.setlocale(locale.LC_NUMERIC)
    locale.setlocale(locale.LC_NUMERIC, "C")
    warn(
        f"LC_NUMERIC of this process was {former}, with which SUMO cannot read a number such as "
        "3.8: it is C from now on."
    )


def missing_library(what: str, message: str) -> str:
    """Return an error message that names the missing shared library and how to install it.

    A library for which the memory does not suffice is not missing.

    ``what`` is the program or module that needs it; ``message`` is the error of the loader.
    """
    found = re.search(r"lib[\w.+-]+?\.so[.\d]*", message)
    if found is None and "No module named" in message:
        words = " ".join(message.split())
        return (
            f"{what} cannot be imported ({words}): run pip install 'libsumo=={SERIES}.*' "
            f"'traci=={SERIES}.*' 'sumolib=={SERIES}.*'."
        )
    if "failed to map segment" in message or "annot allocate memory" in message:
        return (
            f"There is not enough memory to load {what} ({' '.join(message.split())}): allow this "
            "process more, such as by ulimit -v."
        )
    library = found.group() if found else "named here: " + " ".join(message.split())
    return (
        f"{what} needs the system library {library}, which this machine lacks: install it, "
        "on Debian or Ubuntu with: apt-get install libgl1 libx11-6 libxext6 libxrender1."
    )
