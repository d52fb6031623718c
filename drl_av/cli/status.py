"""Converts the outcome of a program to an exit status, and prints one sentence for an error.

The status is 0 for success, 1 after an error, 2 after bad usage and 130 after Ctrl-C.
"""

import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drl_av.errors import DrlAvError

INTERRUPTED = 130
"""The status after Ctrl-C, as shells report it."""


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Call ``run`` and return its exit status; an error becomes one sentence on stderr.

    The status is 1 after a DrlAvError or an OSError, and 130 after Ctrl-C or SIGTERM. The sentence
    begins with the name of the program.
    """
    try:
        with _printable(), _terminated_as_interrupted():
            return run()
    except BrokenPipeError:
        return 1
    except DrlAvError as error:
        print(f"{program}:", *str(error).split(), file=sys.stderr)
        return 1
    except OSError as error:
        where, why = error.filename or "the output", error.strerror or error
        print(
            f"{program}: {where} cannot be read or written ({why}): correct the path, or free some "
            "space.",
            file=sys.stderr,
        )
        return 1
    except KeyboardInterrupt:
        print(f"{program}: interrupted.", file=sys.stderr)
        return INTERRUPTED


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Make SIGTERM raise KeyboardInterrupt in the block, as SIGINT (Ctrl-C) does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    former = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former)


@contextmanager
def _printable() -> Iterator[None]:
    """Escape characters that stdout cannot encode, and flush it; raise DrlAvError if that fails."""
    out = sys.stdout
    if isinstance(out, io.TextIOWrapper) and out.errors == "strict":
        out.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        try:
            if out is not None:
                out.flush()
        except OSError as error:  # Python would flush again at its exit, and print an error
            os.dup2(os.open(os.devnull, os.O_WRONLY), out.fileno())
            if isinstance(error, BrokenPipeError):
                raise
            raise DrlAvError(
                f"The output cannot be written ({error.strerror}): print it somewhere else."
            ) from error
