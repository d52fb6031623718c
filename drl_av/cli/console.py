"""Prints progress bars and lines about results, and handles Ctrl-C."""

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from drl_av.errors import pluralize

if TYPE_CHECKING:
    from drl_av.learning.algorithm_1 import EpisodeRow, EvaluationRow

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
        "±".encode(sys.stdout.encoding or "ascii")
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


def episode_line(row: "EpisodeRow") -> str:
    """Return one line of text about a training episode."""
    return (
        f"reward {row.mean_reward:.3f}  {row.mean_speed_m_s:.1f} m/s  "
        f"triggers {row.safety_triggers}  epsilon {row.epsilon:.2f}"
    )


def evaluation_line(row: "EvaluationRow") -> str:
    """Return one line of text about an evaluation during training."""
    return (
        f"episode {row.episode}: greedy reward {row.mean_reward:.3f}, "
        f"{row.mean_speed_m_s:.2f} m/s, {pluralize(row.ego_hits, 'collision')} by the ego, "
        f"{row.safety_triggers:.1f} triggers an episode"
    )


class StopRequest:
    """Holds whether the user has asked the program to stop: ``made`` is then True."""

    made = False


@contextmanager
def stop_request(after: str = "episode") -> Iterator[StopRequest]:
    """Handle SIGINT (Ctrl-C) and SIGTERM in the block.

    The first signal sets ``made`` of the yielded StopRequest, and says that the program stops
    ``after`` what it is doing. The second signal raises KeyboardInterrupt.
    """
    request = StopRequest()
    said = f"drl-av: stopping after this {after}; Ctrl-C again stops at once.\n".encode()

    def ask(number: int, frame: object) -> None:
        if request.made:
            raise KeyboardInterrupt
        request.made = True
        os.write(2, said)

    former = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
