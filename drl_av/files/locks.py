"""Locks against a second process that writes to the same folder or table."""

import atexit
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drl_av.errors import DrlAvError, RunError

_held: dict[Path, int] = {}
"""By table the open file with the lock of this process."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock the folder against other trainings; raises RunError if another one has locked it."""
    descriptor = os.open(folder, os.O_RDONLY) if os.name == "posix" else None
    try:
        if descriptor is not None and not _lock(descriptor):
            raise RunError(
                f"Another training is writing to {folder}: wait for it, or stop it first."
            )
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def hold(table: Path) -> None:
    """Lock a table against other processes until this one ends.

    The lock is a file in the system's folder for temporary files; without one there is no lock.

    Raises:
        DrlAvError: another process has locked the table.
    """
    path = table.resolve()
    if os.name != "posix" or path in _held:
        return
    name = hashlib.sha256(str(path).encode()).hexdigest()[:16]
    file = Path(tempfile.gettempdir(), f"drl-av-{os.getuid()}-{name}.lock")
    try:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError:
        return
    if not _lock(descriptor):
        os.close(descriptor)
        raise DrlAvError(
            f"Another process is writing to {table}: wait for it, stop it first, or choose another "
            "--out."
        )
    _held[path] = descriptor
    atexit.register(file.unlink, missing_ok=True)


def _lock(descriptor: int) -> bool:
    """Lock an open file, and return True, unless another process has locked it."""
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
