"""Where SUMO's programs are, and error messages that name the missing software."""

import importlib.util
import re
from pathlib import Path

from drl_av.errors import SimulationError


def program(name: str) -> Path:
    """Return the path of a program of the package eclipse-sumo, such as netconvert.

    Raises:
        SimulationError: the program is not installed.
    """
    package = importlib.util.find_spec("sumo")
    for folder in (package and package.submodule_search_locations) or ():
        for file in (name, f"{name}.exe"):
            if (path := Path(folder, "bin", file)).is_file():
                return path
    raise SimulationError(f"SUMO's {name} is not installed: run pip install eclipse-sumo.")


def missing_library(what: str, message: str) -> str:
    """Return an error message that names the missing shared library and how to install it.

    ``what`` is the program or module that needs it; ``message`` is the error of the loader.
    """
    found = re.search(r"lib[\w.+-]+?\.so[.\d]*", message)
    library = found.group() if found else "named here: " + " ".join(message.split())
    return (
        f"{what} needs the system library {library}, which this machine lacks: install it, "
        "on Debian or Ubuntu with: apt-get install libgl1 libx11-6 libxext6 libxrender1."
    )
