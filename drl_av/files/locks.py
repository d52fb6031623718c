"""Locks against a second process that writes to the same folder or table."""

import atexit
import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from drl_av.errors import DrlAvError, RunError

_held: dict[Path, int] = {}
"""By table the open file with the lock of this process."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock the folder against other trainings; raises RunError if another one has locked it."""
    busy = f"Another training is writing to {folder}: wait for it, or stop it first."
    descriptor = _locked(folder, os.O_RDONLY, RunError(busy))
    try:
        yield
    finally:
        os.close(descriptor)


def hold(table: Path) -> None:
    """Lock a table against other processes until this one ends.

    The lock is a file in the system's folder for temporary files; without one there is no lock.

    Raises:
        DrlAvError: another process has locked the table.
    """
    path = table.resolve()
    if path in _held:
        return
    name = hashlib.sha256(str(path).encode()).hexdigest()[:16]
    file = Path(tempfile.gettempdir(), f"drl-av-{os.getuid()}-{name}.lock")
    busy = DrlAvError(
        f"Another process is writing to {table}: wait for it, stop it first, or choose another "
        "--out."
    )
    with suppress(OSError):
        _held[path] = _locked(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, busy)
        atexit.register(file.unlink, missing_ok=True)


def _locked(path: Path, flags: int, busy: DrlAvError) -> int:
    """Open and lock a file or folder; return its descriptor.

    Raises ``busy`` if another process has locked it, and OSError if it cannot be opened.
    """
    descriptor = os.open(path, flags, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise busy from error
    return descriptor
