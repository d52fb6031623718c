"""The way to SUMO: which module speaks to it, and whether this machine can."""

import ctypes
import importlib
import platform
import re
from types import ModuleType

from drl_av.errors import DisplayError, SimulationError


def require_display() -> None:
    """Raise DisplayError where sumo-gui would find no screen, and end the interpreter."""
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
    """libsumo, or traci for sumo-gui on Windows; raises SimulationError, naming what lacks."""
    name = "traci" if gui and platform.system() == "Windows" else "libsumo"
    try:
        return importlib.import_module(name)
    except ImportError as error:
        missing = re.search(r"lib[\w.+-]+\.so[.\d]*", str(error))
        what = missing.group() if missing else str(error)
        raise SimulationError(
            f"{name} needs the system library {what}, which this machine lacks: install it, "
            "on Debian or Ubuntu with: apt-get install libgl1 libx11-6 libxext6 libxrender1."
        ) from error
