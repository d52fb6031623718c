"""Starts worker processes for evaluations and trainings, with joblib's loky."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any

from loky import ProcessPoolExecutor
from loky.process_executor import BrokenProcessPool

__all__ = ["BrokenProcessPool", "workers"]

Submit = Callable[..., "Future[Any]"]
"""``submit(function, *arguments)`` returns the future of the result."""
SINGLE_THREADED = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
LOOKS_FOR_PARENT_EVERY_S = 1.0


@contextmanager
def workers(processes: int) -> Iterator[Submit]:
    """Start worker processes, and yield the function that submits calls to them.

    If a worker is killed, all open futures raise ``BrokenProcessPool``. Each worker uses one
    thread, and ignores Ctrl-C, which a terminal sends to every process. The workers stop when the
    ``with`` block ends or this process is killed.
    """
    pool = ProcessPoolExecutor(
        processes, env=SINGLE_THREADED, initializer=_end_with, initargs=(os.getpid(),)
    )

    def submit(function: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        with _interrupts_ignored():  # a worker that starts here inherits this
            future: Future[Any] = pool.submit(function, *arguments)
        return future

    try:
        yield submit
    finally:
        pool.shutdown(kill_workers=True)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)


def _end_with(parent: int) -> None:
    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOKS_FOR_PARENT_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
