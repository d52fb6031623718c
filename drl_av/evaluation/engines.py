"""Engines that run jobs in parallel processes. If a process is killed, they start its job again.

An engine takes a function, its jobs and the number of processes. At least once a second it yields
the jobs that have ended since its last yield, possibly none: pairs of a job's place among the jobs
and what the function returned. Because an engine can start a job again, a function with effects
must continue an interrupted job, and do nothing if the job is complete.
"""

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager, contextmanager
from importlib.util import find_spec
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from loky import ProcessPoolExecutor
from loky.process_executor import BrokenProcessPool

from drl_av.errors import DrlAvError, SimulationError
from drl_av.evaluation import LOKY, RAY

Job = TypeVar("Job")
Result = TypeVar("Result")
Ended = Generator[list[tuple[int, Result]], None, None]
Engine = Callable[[Callable[[Any], Any], Sequence[Any], int], Ended[Any]]
RETRIES = 3
"""Largest number of new attempts after processes were killed."""
TICK_S = 1.0
AHEAD = 4
"""Number of jobs that are submitted for each process; the others wait here."""
JOIN_S = 20.0
"""Longest time to wait for an answer of the Ray cluster at ``RAY_ADDRESS``."""
PATIENT = {"agent_register_timeout_ms": 300_000, "worker_register_timeout_seconds": 300}
"""Timeouts for the start of a local Ray; they are longer than the default of 30 s."""


def on_this_machine(
    work: Callable[[Job], Result], jobs: Sequence[Job], processes: int
) -> Ended[Result]:
    """Run the jobs with joblib's loky.

    If a process is killed, a new pool starts the jobs that have not ended.

    Raises:
        SimulationError: processes were killed more than RETRIES times.
    """
    left, breaks = dict(enumerate(jobs)), 0
    while left:
        try:
            with workers(min(processes, len(left))) as submit:
                waiting, futures = iter([*left.items()]), dict[Future[Result], int]()
                while left:
                    for place, job in islice(waiting, AHEAD * processes - len(futures)):
                        futures[submit(work, job)] = place
                    ended = wait(futures, TICK_S, FIRST_COMPLETED).done
                    done = [(futures.pop(future), future.result()) for future in ended]
                    for place, _ in done:
                        del left[place]
                    yield done
        except BrokenProcessPool as error:
            breaks += 1
            if breaks > RETRIES:
                raise _given_up() from error


def require_ray() -> None:
    """Raise DrlAvError if the extra ``ray`` is not installed."""
    if not find_spec("ray"):
        raise DrlAvError(
            "Ray is not installed: pip install 'drl-av[ray]', or take the engine loky."
        )


def on_ray(work: Callable[[Job], Result], jobs: Sequence[Job], processes: int) -> Ended[Result]:
    """Run the jobs on a Ray cluster, one CPU for each job.

    The cluster is the first that exists of: the cluster that this process has joined, the cluster
    at ``RAY_ADDRESS``, and a new local cluster.

    Raises:
        DrlAvError: the extra ``ray`` is not installed, or no cluster answers at ``RAY_ADDRESS``.
        SimulationError: a job's process was killed more than RETRIES times, or Ray's node process
            on this machine was killed.
    """
    require_ray()
    import ray
    from ray.exceptions import RayTaskError, WorkerCrashedError

    with cluster(processes):
        remote = ray.remote(num_cpus=1, max_retries=RETRIES)(work)
        here = ray.get_runtime_context().get_node_id()
        resources: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        at_once = AHEAD * max(processes, int(resources.get("CPU", 1)))
        waiting, running = iter(enumerate(jobs)), dict[Any, int]()
        try:
            while True:
                for place, job in islice(waiting, at_once - len(running)):
                    running[remote.remote(job)] = place
                if not running:
                    return
                if not _lives(here):
                    raise SimulationError(
                        "Ray's own process on this machine was killed: give the same command "
                        "again; what was saved is kept."
                    )
                ended, _ = ray.wait(list(running), timeout=TICK_S)
                yield [(running.pop(reference), ray.get(reference)) for reference in ended]
        except RayTaskError as error:
            raise error.cause from error  # which has the traceback of the worker
        except WorkerCrashedError as error:
            raise _given_up() from error
        finally:
            for reference in running:
                ray.cancel(reference, force=True)


def _lives(node: str) -> bool:
    import ray

    nodes: list[dict[str, Any]] = ray.nodes()  # type: ignore[no-untyped-call]
    return any(each["NodeID"] == node and each["Alive"] for each in nodes)


@contextmanager
def cluster(processes: int) -> Iterator[None]:
    """Provide a Ray cluster for the block.

    If this process has not joined a cluster, it joins or starts one, and leaves it after the block.
    """
    import ray

    if ray.is_initialized():
        yield
        return
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if "RAY_ADDRESS" in os.environ:
        joined = _joined(options)
    else:
        options |= {"num_cpus": processes, "include_dashboard": False, "_system_config": PATIENT}
        joined = ray.init(**options)
    with joined:
        yield


def _joined(options: dict[str, Any]) -> AbstractContextManager[Any]:
    """Join the cluster at ``RAY_ADDRESS`` within JOIN_S seconds.

    Ray itself would try for minutes, during which Ctrl-C has no effect.

    Raises:
        DrlAvError: the address is not valid, or no cluster answers there.
    """
    import ray

    answers: SimpleQueue[Any] = SimpleQueue()

    def join() -> None:
        try:
            answers.put(ray.init(**options))
        except Exception as error:
            answers.put(error)

    threading.Thread(target=join, daemon=True).start()
    try:
        answer = answers.get(timeout=JOIN_S)
    except Empty:
        answer = TimeoutError(f"no answer in {JOIN_S:g} s")
    if isinstance(answer, Exception):
        raise DrlAvError(
            f"No Ray cluster can be joined at RAY_ADDRESS={os.environ['RAY_ADDRESS']!r} "
            f"({str(answer).splitlines()[0].rstrip('.')}): start one there, or unset RAY_ADDRESS "
            "to work on this machine alone."
        ) from answer
    cluster: AbstractContextManager[Any] = answer
    return cluster


def _given_up() -> SimulationError:
    return SimulationError(
        f"A process was killed {RETRIES + 1} times, as it is where memory runs out or SUMO aborts: "
        "try fewer --jobs, then give the same command again; what was saved is kept."
    )


ENGINES: dict[str, Engine] = {LOKY: on_this_machine, RAY: on_ray}
"""The engines by the names that users give."""

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
        processes, env=SINGLE_THREADED, initializer=end_with, initargs=(os.getpid(),)
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


def end_with(parent: int) -> None:
    """Let this process end when ``parent``, the id of the process that started it, has ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOKS_FOR_PARENT_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
