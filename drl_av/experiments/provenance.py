"""Describes how results were made: the command, versions, SUMO's steps and the machine."""

import os
import platform
import shlex
import sys
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_info

from drl_av.config import Config
from drl_av.drivers import policy_file

PACKAGES = ("drl-av", "eclipse-sumo", "torch", "numpy", "gymnasium")
INTEGRATION = "semi-implicit Euler"
"""SUMO's integration method: its default, which no setting changes."""


def provenance(config: Config, **facts: Any) -> dict[str, Any]:
    """Return the provenance of this process's results: command, versions, machine and ``facts``."""
    return {
        "command": command(),
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        **{package: _version(package) for package in PACKAGES},
        "step_length_s": config.simulation.step_length_s,
        "integration": INTEGRATION,
        "machine": machine(),
        "blas": blas(),
        **facts,
    }


def _version(package: str) -> str:
    """Return the version of a package, or "not installed", as torch may be."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def command() -> str:
    """Return the command line that starts this process, as typed in the project's folder."""
    program = Path(sys.argv[0])
    called = {
        "tools": ["python", f"tools/{program.name}"],
        "verification": ["python", "-m", f"verification.{program.stem}"],
    }
    return shlex.join([*called.get(program.parent.name, ["drl-av"]), *sys.argv[1:]])


def made_by(seconds: float) -> str:
    """Return command, wall time, date, versions and machine in one line, for results in text files.

    ``seconds`` is the wall time.
    """
    facts = provenance(Config())
    versions = ", ".join(f"{package} {facts[package]}" for package in ("python", *PACKAGES))
    return (
        f"made by {facts['command']} in {seconds:.0f} s on {facts['date']}: "
        f"{versions}; {facts['machine']}; {facts['blas']}"
    )


def checksum(policy: Path) -> str:
    """Return the SHA-256 of a policy file's weights, without its config.

    The hash identifies a driver even if later versions of the package add settings.

    Raises:
        CheckpointError: the file is missing or damaged, or is not a file of this package.
    """
    tensors, _ = policy_file.load(policy)
    return policy_file.checksum(tensors, "")


def machine() -> str:
    """Return the processor's model, the number of cores and the operating system, as text."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if "model name" in line]
        model = next(iter(names), model)
    return f"{model}, {os.cpu_count()} cores, {platform.system()}"


def blas() -> str:
    """Return the BLAS libraries of this process and the kernels that they use, as text.

    Different kernels round differently, so a training with other kernels yields another network.
    """
    libraries = [info for info in threadpool_info() if info["user_api"] == "blas"]
    found = [
        f"{info['internal_api']} {info['version']} {info.get('architecture', '')}".rstrip()
        for info in libraries
    ]
    return ", ".join(dict.fromkeys(found)) or "unknown"
