"""Converts the outcome of a program to an exit status, and prints one sentence for an error.

The status is 0 for success, 1 after an error, 2 after bad usage and 130 after Ctrl-C.
"""

import codecs
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from drl_av.errors import DrlAvError, DrlAvWarning, printable

INTERRUPTED = 130
"""The status after Ctrl-C, as shells report it."""


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Call ``run`` and return its exit status; an error becomes one sentence on stderr.

    The status is 1 after a DrlAvError or an OSError, and 130 after Ctrl-C or SIGTERM. The sentence
    begins with the name of the program.
    """
    try:
        with _printable(), _interrupts(), _warnings_in_one_line(program):
            return run()
    except BrokenPipeError:
        return 1
    except DrlAvError as error:
        print(printable(" ".join([f"{program}:", *str(error).split()])), file=sys.stderr)
        return 1
    except OSError as error:
        where, why = error.filename or "the output", error.strerror or error
        sentence = (
            f"{program}: {where} cannot be read or written ({why}): correct the path, or free some "
            "space."
        )
        print(printable(sentence), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"{program}: interrupted.", file=sys.stderr)
        return INTERRUPTED


@contextmanager
def _interrupts() -> Iterator[None]:
    """Make SIGTERM raise KeyboardInterrupt in the block, as SIGINT (Ctrl-C) does.

    A library that swallows a KeyboardInterrupt in a callback, as LLVM's does, may fail a moment
    later with an error of its own. At the end of the block it is a KeyboardInterrupt again.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    swallowed, show = [], sys.unraisablehook

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    def note(unraisable: Any) -> None:
        if isinstance(unraisable.exc_value, KeyboardInterrupt):
            swallowed.append(unraisable.exc_type)
        else:
            show(unraisable)

    former = signal.signal(signal.SIGTERM, interrupt)
    sys.unraisablehook = note
    try:
        yield
        if swallowed:
            raise KeyboardInterrupt
    except Exception as error:
        if swallowed and not isinstance(error, DrlAvError):
            raise KeyboardInterrupt from None
        raise
    finally:
        sys.unraisablehook = show
        signal.signal(signal.SIGTERM, former)


@contextmanager
def _warnings_in_one_line(program: str) -> Iterator[None]:
    """Print each DrlAvWarning once, as one line on stderr that begins with the program's name."""
    with warnings.catch_warnings():
        warnings.simplefilter("default", DrlAvWarning)
        show, said = warnings.showwarning, set[str]()

        def show_in_one_line(
            message: Warning | str, category: type[Warning], *rest: Any, **named: Any
        ) -> None:
            if not issubclass(category, DrlAvWarning):
                show(message, category, *rest, **named)
                return
            text = " ".join(str(message).split())
            if text not in said:
                said.add(text)
                print(printable(f"{program}: {text}"), file=sys.stderr, flush=True)

        warnings.showwarning = show_in_one_line
        yield


PLAIN = {"±": "+-", "…": "...", "→": "->", "≤": "<=", "≥": ">=", "²": "^2", "³": "^3", "─": "-"}
"""What is printed in place of a character that the output cannot show."""


def _plainly(error: UnicodeError) -> tuple[str, int]:
    """Replace characters that cannot be encoded by plain ones; a handler for ``codecs``."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    found = error.object[error.start : error.end]
    return "".join(PLAIN.get(each, ascii(each)[1:-1]) for each in found), error.end


codecs.register_error("drl_av.plain", _plainly)


@contextmanager
def _printable() -> Iterator[None]:
    """Replace characters that the output cannot encode, and flush it.

    Raises DrlAvError if the output cannot be written.
    """
    out = sys.stdout
    for stream in (out, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="drl_av.plain")
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
