"""Result files, written whole or not at all."""

import os
from pathlib import Path

from drl_av.errors import DrlAvError

Row = dict[str, str]
"""A row of a CSV file as text, by column."""
OF_A_RUN = {
    *("config.toml", "checkpoint.safetensors", "policy.safetensors"),
    *("episodes.csv", "evaluations.csv"),
}


def write_whole(path: Path, data: bytes) -> None:
    """Put ``data`` in the file; whatever interrupts it, what was there before stays or is replaced.

    Raises:
        DrlAvError: the disk is full, or the folder is missing or may not be written to.
    """
    path = _target(path)
    temporary = _beside(path)
    try:
        try:
            with temporary.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(path, error) from error


def require_writable(*paths: Path | None) -> None:
    """Try whether ``write_whole`` could; raises DrlAvError before any long work is done for it.

    None stands for a file that is not asked for; none may be written over by another of them.
    """
    asked = [path for path in paths if path is not None]
    for path in asked:
        _try(path)
        if [_target(other) for other in asked].count(_target(path)) > 1:
            raise DrlAvError(f"{path} cannot hold two files at once: name another for one of them.")


def _try(path: Path) -> None:
    if path.is_dir():
        raise DrlAvError(f"{path} is a folder: name a file in it.")
    if path.exists() and not path.is_file():
        raise DrlAvError(f"{path} is there already and no regular file: name a file.")
    target = _target(path)
    if target.name in OF_A_RUN and target.exists() and target.with_name("config.toml").exists():
        raise DrlAvError(f"{path} belongs to the run in that folder: name another file.")
    probe = _beside(target)
    try:
        try:
            probe.touch()
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(path, error) from error


def _target(path: Path) -> Path:
    """Where a link leads; the link itself where it leads in a circle."""
    return Path(os.path.realpath(path))


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.unfinished")


def _refused(path: Path, error: OSError) -> DrlAvError:
    return DrlAvError(
        f"{path} cannot be written ({error.strerror or error}): free some space, or choose a "
        "folder that exists and may be written to; what was there before is unchanged."
    )
