"""Describes how results were made: the command, versions, SUMO's step length and the machine.

The description of a table of results is a JSON file beside it.
"""

import json
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
from drl_av.errors import DrlAvError
from drl_av.files.atomic import write_atomic

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
    """Return the version of a package, or "not installed", as torch may be.

    That of drl-av is the code's: an editable installation keeps the version of its day.
    """
    if package == "drl-av":
        return str(sys.modules["drl_av"].__version__)
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
        "examples": ["python", f"examples/{program.name}"],
        "studies": ["python", "-m", "studies"],
    }
    is_ours = program.stem == "drl-av" or program.name == "__main__.py"
    usual = ["drl-av"] if is_ours else ["python", program.name]
    return shlex.join([*called.get(program.parent.name, usual), *sys.argv[1:]])


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


def write_provenance(table: Path, facts: dict[str, Any], suffix: str = ".json") -> None:
    """Write how a table was made beside it, atomically: curves.json for curves.csv.

    Raises DrlAvError if the write fails.
    """
    write_atomic(table.with_suffix(suffix), json.dumps(facts, indent=2).encode() + b"\n")


def read_provenance(table: Path, suffix: str = ".json") -> dict[str, Any]:
    """Read how a table was made from the JSON file beside it; {} if neither file exists.

    Raises:
        DrlAvError: the file is missing beside a table, cannot be read, or holds no JSON object.
        TypeError: what is listed in it by names, or of former versions, has another form.
    """
    path = table.with_suffix(suffix)
    if not path.exists() and not table.exists():
        return {}
    if not path.exists():
        raise DrlAvError(
            f"{table} has no {path.name} beside it that says what made it: put that back, or move "
            "the table away to make it again."
        )
    try:
        facts = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise DrlAvError(f"{path} cannot be read ({error}): put back what was there.") from error
    if not isinstance(facts, dict):
        raise DrlAvError(f"{path} holds no provenance: put back what was there.")
    kinds: dict[str, type] = dict.fromkeys(
        ("settings", "policies_sha256", "episodes", "custom"), dict
    )
    for name, kind in {**kinds, "before": list}.items():
        if not isinstance(facts.get(name, kind()), kind):
            raise TypeError(f"{name} in {path.name} is of another form")
    return facts
