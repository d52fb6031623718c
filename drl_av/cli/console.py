"""What a program shows while it runs, how Ctrl-C stops it, and how it ends.

It ends with one sentence for an error, and the status 0 for success, 1 after an error, 2 after bad
usage and 130 after Ctrl-C.
"""

import codecs
import io
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from drl_av.errors import DrlAvError, DrlAvWarning, printable

REPORT_EVERY_S = 60.0
"""Time between two lines of progress if the output is not a terminal."""
WIDTH = 80
"""Width of a table in characters if the output is not a terminal."""


def make_console() -> Console:
    """Return the console for the output; it is ``WIDTH`` characters wide without a terminal."""
    console = Console(highlight=False, markup=False)
    return console if console.is_terminal else Console(width=WIDTH, highlight=False, markup=False)


def plus_minus() -> str:
    """Return the sign between a value and its interval, which the output can show."""
    try:
        "±".encode(getattr(sys.stdout, "encoding", None) or "ascii")
    except UnicodeEncodeError:
        return "+-"
    return "±"


class Bar:
    """A progress bar with the remaining time; without a terminal it prints a line every minute."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task
        self._decisions, self._begun_s = 0, time.monotonic()
        self._printed_s = self._begun_s

    def advance(self, text: str, decisions: int) -> None:
        """Count an episode with ``decisions`` decisions; show ``text`` and decisions per second."""
        self._decisions += decisions
        rate = self._decisions / (time.monotonic() - self._begun_s)
        self._progress.update(self._task, advance=1, text=f"{text}  {rate:.0f} decisions/s")
        if self._progress.disable and time.monotonic() - self._printed_s >= REPORT_EVERY_S:
            self._printed_s = time.monotonic()
            task = self._progress.tasks[self._task]
            done = f"{task.completed:.0f} of {task.total:.0f}"
            print(f"{task.description} {done}  {text}  {rate:.0f} decisions/s", file=sys.stderr)

    def reach(self, done: int, total: int, text: str) -> None:
        """Set the bar to ``done`` of ``total`` episodes; show ``text`` beside it."""
        self._progress.update(self._task, completed=done, total=total, text=text)

    def say(self, line: str) -> None:
        """Print a line above the bar."""
        self._progress.console.print(line, soft_wrap=True)


@contextmanager
def progress_bar(what: str, total: int, done: int = 0) -> Iterator[Bar]:
    """Show a bar named ``what`` during the block; it starts at ``done`` of ``total`` episodes."""
    console = make_console()
    progress = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[text]}", markup=False),
        console=console,
        disable=not console.is_terminal,
    )
    with progress:
        yield Bar(progress, progress.add_task(what, total=total, completed=done, text=""))


class StopRequest:
    """Holds whether the user has asked the program to stop: ``made`` is then True."""

    made = False


@contextmanager
def stop_request(after: str = "episode") -> Iterator[StopRequest]:
    """Handle SIGINT (Ctrl-C), SIGTERM and SIGHUP in the block; in a thread there are none.

    The first signal sets ``made`` of the yielded StopRequest, and says that the program stops
    ``after`` what it is doing. The second signal raises KeyboardInterrupt.
    """
    request = StopRequest()
    said = f"drl-av: stopping after this {after}; Ctrl-C again stops at once.\n".encode()

    def ask(number: int, frame: object) -> None:
        if request.made:
            raise KeyboardInterrupt
        request.made = True
        with suppress(OSError):  # the terminal may have gone
            os.write(2, said)

    former = {number: signal.signal(number, ask) for number in _endings(signal.SIGINT)}
    try:
        yield request
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def _endings(*further: signal.Signals) -> list[signal.Signals]:
    """Return the signals that end a program, with ``further``; in a thread, which gets none, none.

    SIGHUP, which says that the terminal is closed, is none where nohup ignores it.
    """
    if threading.current_thread() is not threading.main_thread():
        return []
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return [*further, signal.SIGTERM, *(() if ignored else (signal.SIGHUP,))]


INTERRUPTED = 130
"""The status after Ctrl-C, as shells report it."""


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Call ``run`` and return its exit status; an error becomes one sentence on stderr.

    The status is 1 after a DrlAvError or an OSError, and 130 after Ctrl-C, SIGTERM or SIGHUP. The
    sentence begins with the name of the program.
    """
    _open_missing_streams()
    try:
        with _printable(), _interrupts(), _warnings_in_one_line(program):
            return run()
    except BrokenPipeError:
        return 1
    except DrlAvError as error:
        print(printable(" ".join([f"{program}:", *str(error).split()])), file=sys.stderr)
        return 1
    except UnicodeEncodeError as error:
        if not "\udc80" <= error.object[error.start] <= "\udcff":  # no byte of a name
            raise
        name = printable(ascii(error.object))
        print(f"{program}: {name} is no text in {error.encoding}: rename it.", file=sys.stderr)
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


def _open_missing_streams() -> None:
    """Let what the caller has closed of input, output and errors be the null device."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # the lowest free descriptor is its own
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)


@contextmanager
def _interrupts() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt in the block, as SIGINT (Ctrl-C) does.

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

    former = {number: signal.signal(number, interrupt) for number in _endings()}
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
        for number, handler in former.items():
            signal.signal(number, handler)


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
