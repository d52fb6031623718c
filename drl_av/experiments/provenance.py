"""What made a results file: command, versions, SUMO's steps, machine, and the time it took."""

import json
import os
import platform
import shlex
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w
from threadpoolctl import threadpool_info

from drl_av.config import BEFORE, Config, from_toml
from drl_av.drivers import policy_file
from drl_av.errors import DrlAvError
from drl_av.files import write_whole

PACKAGES = ("drl-av", "eclipse-sumo", "torch", "numpy", "gymnasium")
INTEGRATION = "semi-implicit Euler"
"""SUMO's default, which no setting changes."""


def provenance(config: Config, **facts: Any) -> dict[str, Any]:
    """Everything about this process that a results file depends on, and the caller's own facts."""
    return {
        "command": command(),
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "step_length_s": config.simulation.step_length_s,
        "integration": INTEGRATION,
        "machine": machine(),
        "blas": blas(),
        **facts,
    }


def command() -> str:
    """The command line of this process, as somebody in the project's folder would give it."""
    program = Path(sys.argv[0])
    called = {
        "tools": ["python", f"tools/{program.name}"],
        "verification": ["python", "-m", f"verification.{program.stem}"],
    }
    return shlex.join([*called.get(program.parent.name, ["drl-av"]), *sys.argv[1:]])


def made_by(seconds: float) -> str:
    """Command, time, versions and machine in a line, for results that are a text."""
    facts = provenance(Config())
    versions = ", ".join(f"{package} {facts[package]}" for package in ("python", *PACKAGES))
    return (
        f"made by {facts['command']} in {seconds:.0f} s on {facts['date']}: "
        f"{versions}; {facts['machine']}; {facts['blas']}"
    )


def checksum(policy: Path) -> str:
    """SHA-256 of a policy file's tensors: the same driver, whatever settings came up since.

    Raises:
        CheckpointError: as ``policy_file.load``.
    """
    tensors, _ = policy_file.load(policy)
    return policy_file.checksum(tensors, "")


def machine() -> str:
    """Processor, number of cores, and operating system."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if "model name" in line]
        model = next(iter(names), model)
    return f"{model}, {os.cpu_count()} cores, {platform.system()}"


def blas() -> str:
    """The linear algebra in this process, and the kernels it chose for this processor.

    Networks trained with other kernels differ in their last bits, and then in all.
    """
    libraries = [info for info in threadpool_info() if info["user_api"] == "blas"]
    told = [
        f"{info['internal_api']} {info['version']} {info.get('architecture', '')}".rstrip()
        for info in libraries
    ]
    return ", ".join(dict.fromkeys(told)) or "not told"


def sidecar(table: Path) -> Path:
    """The file that says what made a table: ``curves.csv`` has ``curves.json`` beside it."""
    return table.with_suffix(".json")


def write_sidecar(table: Path, facts: dict[str, Any]) -> None:
    """Write it, before the table, whole or not at all; raises DrlAvError where the disk refuses."""
    write_whole(sidecar(table), json.dumps(facts, indent=2).encode() + b"\n")


def read_sidecar(table: Path) -> dict[str, Any]:
    """What made the table, nothing where there is none yet.

    Raises:
        DrlAvError: it cannot be read, or there is a table and nothing beside it.
        TypeError: what should have names in it has none.
    """
    path = sidecar(table)
    if not path.exists() and not table.exists():
        return {}
    if not path.exists():
        raise DrlAvError(
            f"{table} has no {path.name} beside it that says what made it: put that back, or move "
            "the table away to make it anew."
        )
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DrlAvError(f"{path} cannot be read ({error}): put back what was there.") from error
    if not isinstance(facts, dict):
        raise DrlAvError(f"{path} holds no provenance: put back what was there.")
    for name in ("settings", "policies_sha256", "episodes"):
        if not isinstance(facts.get(name, {}), dict):
            raise TypeError(f"{name} in {path.name} has no names")
    return facts


def made_otherwise(table: Path) -> DrlAvError:
    """What to raise instead of writing over somebody's results."""
    return DrlAvError(
        f"{table} was made with other settings or another driver: choose another folder with "
        f"--out, or move it and {sidecar(table).name} away to make it anew."
    )


def stored_config(settings: dict[str, Any], name: str) -> Config:
    """The config a table was made with; of settings younger than the table, as it was before.

    Raises:
        ConfigError: it holds settings that this version does not know.
    """
    return from_toml(tomli_w.dumps(settings), BEFORE, name)
