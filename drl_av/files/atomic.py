"""Files are replaced whole or stay unchanged, and no second process writes to them; and hashes."""

import atexit
import errno
import fcntl
import glob
import hashlib
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from drl_av.errors import DrlAvError, RunError

OF_A_RUN = {
    *("config.toml", "checkpoint.safetensors", "policy.safetensors"),
    *("episodes.csv", "evaluations.csv"),
}
"""Files of a training's run folder, which no other command may overwrite."""
LEAST_BYTES = 4096
"""The least free disk space, bytes, that ``require_writable`` demands for a file."""


@contextmanager
def replacing(path: Path, error: type[DrlAvError] = DrlAvError) -> Iterator[Path]:
    """Replace a file or folder atomically: the ``with`` block writes to the temporary path it gets.

    The temporary path has the same suffix, in a new folder beside ``path`` that only this user may
    enter, so that no link of another user is followed. If the block succeeds, the written data is
    synced to the disk and then replaces ``path``. A new file has the permissions of the one that it
    replaces; a new folder can replace only an empty one, in which this process is not. If the block
    raises, the data is removed. If ``path`` is a link, its target is replaced. Temporary files of
    processes that have died are removed first.

    Raises:
        error: the disk is full, or the folder is missing or not writable; ``error`` is its class.
    """
    path = _target(path)
    _remove_abandoned(path)
    try:
        if path.is_dir() and Path.cwd().is_relative_to(path):
            raise error(f"You are in the folder {path}, which is to be made: name a new one in it.")
        with _unfinished(path) as temporary:
            yield temporary
            if path.is_file():
                shutil.copymode(path, temporary)
            for part in (*temporary.rglob("*"), temporary):
                _sync(part)
            os.replace(temporary, path)
            _sync(path.parent)
    except OSError as refusal:
        raise _refused(path, refusal, error) from refusal


def write_atomic(path: Path, data: bytes, error: type[DrlAvError] = DrlAvError) -> None:
    """Write ``data`` to a file atomically: the file has the new contents, or stays unchanged.

    Raises:
        error: the disk is full, or the folder is missing or not writable; ``error`` is its class.
    """
    with replacing(path, error) as temporary:
        temporary.write_bytes(data)


def append_lines(path: Path, lines: bytes, header: bytes) -> None:
    """Append ``lines`` to a file; write ``header`` first if the file is missing or empty.

    A last line without a line feed is removed first. If the process is killed during the call, the
    file may contain only the first part of ``lines``.

    Raises:
        DrlAvError: the disk is full, or the file or its folder is not writable; no line is added.
    """
    end = None
    try:
        with path.open("ab+") as file:
            if end := file.seek(0, os.SEEK_END):
                file.seek(-1, os.SEEK_END)
                if file.read() != b"\n":
                    file.seek(0)
                    end = file.truncate(file.read().rfind(b"\n") + 1)
            file.write(lines if end else header + lines)
    except OSError as refusal:
        if end is not None:
            with suppress(OSError):
                os.truncate(path, end)
        raise _refused(path, refusal, DrlAvError) from refusal


def make_folder(folder: Path, option: str) -> None:
    """Make a folder and its parents if they do not exist.

    The error message advises the user to choose another folder with ``option``, such as "--out".

    Raises:
        DrlAvError: the folder cannot be made.
    """
    with refusals(f"The folder {folder} cannot be made", f"choose another one with {option}"):
        folder.mkdir(parents=True, exist_ok=True)


@contextmanager
def refusals(what: str, remedy: str, kind: type[DrlAvError] = DrlAvError) -> Iterator[None]:
    """Replace an OSError in the block by an error that says what cannot be done, and a remedy."""
    try:
        yield
    except OSError as error:
        raise kind(f"{what} ({error.strerror or error}): {remedy}.") from error


def require_writable(
    *paths: Path | None, inputs: Iterable[str | Path | None] = (), by_sumo: Iterable[str] = ()
) -> None:
    """Check before a long computation that ``write_atomic`` can write to the given paths.

    A path that is None is ignored. ``inputs`` are the files and folders that the same command
    reads, and ``by_sumo`` the files that SUMO writes at the same time.

    Raises:
        DrlAvError: a path is not writable, is a folder, belongs to a run (``OF_A_RUN``), occurs
            twice, or is one of ``inputs``.
    """
    asked = [path for path in paths if path is not None]
    read = {_target(Path(name)) for name in inputs if name is not None}
    for path in asked:
        if _target(path) in read:
            raise DrlAvError(f"{path} is an input of this command: name another file to write.")
        _try(path)
        if [_target(other) for other in asked].count(_target(path)) > 1:
            raise DrlAvError(f"{path} cannot hold two files at once: name another for one of them.")
    for name in by_sumo:
        target, own = _target(Path(name)), read | {*map(_target, asked)}
        if not own.isdisjoint((target, *target.parents)):
            raise DrlAvError(
                f"SUMO would write {name}, which this command itself reads or writes: name another "
                "file in the options of SUMO."
            )


def _try(path: Path) -> None:
    """Raise DrlAvError unless ``write_atomic`` can write as much to ``path`` as it holds now."""
    if path.is_dir():
        raise DrlAvError(f"{path} is a folder: name a file in it.")
    if path.exists() and not path.is_file():
        raise DrlAvError(f"{path} exists and is no regular file: name a file.")
    target = _target(path)
    if target.name in OF_A_RUN and target.exists() and target.with_name("config.toml").exists():
        raise DrlAvError(f"{path} belongs to the run in that folder: name another file.")
    try:
        with _unfinished(target) as probe:
            held = target.stat().st_size if target.exists() else 0
            probe.write_bytes(bytes(max(held, LEAST_BYTES)))
    except OSError as error:
        raise _refused(path, error, DrlAvError) from error


def require_suffix(path: Path | None, suffix: str) -> None:
    """Raise DrlAvError unless the file name ends with ``suffix``; None is accepted.

    A file of another kind, such as a source file of the user, is thus not overwritten by mistake.
    """
    if path is not None and path.suffix.lower() != suffix:
        raise DrlAvError(f"{path} must end with {suffix}: choose another name.")


def _target(path: Path) -> Path:
    """Return the path that ``path`` links to, or ``path`` itself (absolute) if it is no link."""
    return Path(os.path.realpath(path))


@contextmanager
def _unfinished(path: Path) -> Iterator[Path]:
    """Yield a temporary path in a new private folder beside ``path``; remove the folder at the end.

    The folder's name contains the id of this process and a random word. Making a folder follows no
    link.
    """
    begin, end = f".{path.stem}.{os.getpid()}.", f".unfinished{path.suffix}"
    with TemporaryDirectory(end, begin, path.parent, ignore_cleanup_errors=True) as folder:
        yield Path(folder, path.name)


def _remove_abandoned(path: Path) -> None:
    """Remove temporary folders beside ``path`` that belong to processes that no longer run."""
    stem, suffix = re.escape(path.stem), re.escape(path.suffix)
    for other in path.parent.glob(f".{glob.escape(path.stem)}.*"):
        match = re.fullmatch(rf"\.{stem}\.(\d+)(\.\w+)?\.unfinished{suffix}", other.name)
        if match and not _runs(int(match[1])):
            shutil.rmtree(other, ignore_errors=True)


def _runs(process: int) -> bool:
    """Return whether a process with this id may be running."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def _sync(path: Path) -> None:
    """Wait until a file, or the names in a folder if the system supports it, are on the disk."""
    with suppress(OSError) if path.is_dir() else nullcontext():
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _refused(path: Path, refusal: OSError, error: type[DrlAvError]) -> DrlAvError:
    """Return an error that says why ``path`` cannot be written, and what the user can do."""
    if refusal.errno == errno.ENOTEMPTY:
        return error(f"{path} has been made meanwhile, with files in it: choose another folder.")
    if refusal.errno == errno.EBUSY:
        other = "a folder in it" if path.is_dir() else "a file in another folder"
        return error(f"{path} is a mount point, which stays: name {other}.")
    return error(
        f"{path} cannot be written ({refusal.strerror or refusal}): free some space, or choose a "
        "folder that exists and may be written to; what was there before is unchanged."
    )


def files_digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files below a folder with their names."""
    if path.is_file():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    digest = hashlib.sha256()
    for file in sorted(each for each in path.rglob("*") if each.is_file()):
        digest.update(f"{file.relative_to(path)} {files_digest(file)}\n".encode())
    return digest.hexdigest()


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
    name = hashlib.sha256(os.fsencode(path)).hexdigest()[:16]
    busy = DrlAvError(
        f"Another process is writing to {table}: wait for it, stop it first, or choose another "
        "--out."
    )
    with suppress(OSError):
        file = Path(gettempdir(), f"drl-av-{os.getuid()}-{name}.lock")
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
    if not os.fstat(descriptor).st_nlink:  # its last owner has removed it since it was opened
        os.close(descriptor)
        return _locked(path, flags, busy)
    return descriptor
