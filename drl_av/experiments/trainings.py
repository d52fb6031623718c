"""Experiments whose rows are what trainings report while they learn."""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass

from drl_av.errors import DrlAvError
from drl_av.experiments.engines import ENGINES
from drl_av.experiments.options import Progress, ReproduceOptions
from drl_av.experiments.provenance import checksum
from drl_av.experiments.store import MadeWith, ResultStore, report_corrupt_table
from drl_av.experiments.training_jobs import TrainingJob, train_job
from drl_av.files import Row


@dataclass(frozen=True)
class TrainingPlan:
    """Trainings in rounds, and how their rows are read from their folders."""

    made_with: MadeWith
    """The settings of every variant, with seed 0, and of the trainings that they continue."""
    rounds: Sequence[Sequence[TrainingJob]]
    rows_of: Callable[[TrainingJob], list[Row]]

    def order(self, row: Row) -> tuple[int, int, int]:
        """By variant, seed and episode."""
        variants = list(self.made_with.settings)
        return variants.index(row["variant"]), int(row["seed"]), int(row["episode"])

    def make(
        self, store: ResultStore, options: ReproduceOptions
    ) -> Generator[Progress, None, None]:
        """Train in each round what the table lacks, after what those trainings continue.

        What the table holds is not trained again, whether or not the folders of those trainings
        are still there. It is saved whenever a training ends, and where the work is interrupted.

        Raises:
            DrlAvError: the episodes are fewer than a row sums up; a folder holds other settings;
                the disk refuses.
            SimulationError: a training cannot go on.
        """
        options.runs.mkdir(parents=True, exist_ok=True)
        goals = list({job.folder: job for jobs in self.rounds for job in jobs}.values())
        for job in goals:
            _require_a_row(job, store)
        missing = _left(store, goals)
        for job in missing:
            job.require_same_settings()
        _require_same_origins(store, missing)
        self._collect(store, options, missing)
        yield _progress(store, goals)
        for jobs in self.rounds:
            left = _left(store, jobs)
            origins = list({job.origin: 0 for job in left if job.origin and not job.begun})
            try:
                for batch in filter(None, (origins, left)):
                    with closing(ENGINES[options.engine](train_job, batch, options.jobs)) as engine:
                        for ended in engine:
                            if ended:
                                self._collect(store, options, missing)
                            yield _progress(store, [*origins, *goals])
                    _require_same_origins(store, left)
            finally:
                self._collect(store, options, missing)
        for job in _left(store, goals):
            raise DrlAvError(
                f"{job.folder} lacks rows of its training up to episode {job.last_row}: put back "
                "its files, or give --runs a folder that all processes share."
            )

    def _collect(
        self, store: ResultStore, options: ReproduceOptions, jobs: Iterable[TrainingJob]
    ) -> None:
        """Take over each training's rows where its folder has more of them than the table."""
        found = {job: self.rows_of(job) for job in jobs}
        with report_corrupt_table(store.path):
            changed = [store.put(job.key, rows) for job, rows in found.items()]
        if any(changed):
            for job in found:
                if (seconds := job.wall_time_s()) is not None:
                    store.seconds[job.name] = max(store.seconds.get(job.name, 0.0), seconds)
            store.save(options)


def _require_a_row(job: TrainingJob, store: ResultStore) -> None:
    if job.last_row < 1:
        raise DrlAvError(
            f"{job.stop} episodes make no row of {store.path.name}, which sums up {job.every}: "
            "ask for as many at the least."
        )


def _require_same_origins(store: ResultStore, jobs: Iterable[TrainingJob]) -> None:
    """Raise DrlAvError where the table has rows of another driver that continued to learn."""
    origins = {job.origin for job in jobs if job.origin and job.origin.policy.is_file()}
    store.require(MadeWith({}, {origin.name: checksum(origin.policy) for origin in origins}))


def _left(store: ResultStore, jobs: Iterable[TrainingJob]) -> list[TrainingJob]:
    """Those whose last row the table does not hold."""
    return [job for job in jobs if _last_row(store, job) < job.last_row]


def _last_row(store: ResultStore, job: TrainingJob) -> int:
    rows = store.of(job.key)
    return int(rows[-1]["episode"]) if rows else 0


def _progress(store: ResultStore, jobs: Sequence[TrainingJob]) -> Progress:
    """Episodes in the table, and those driven since then by the trainings that are under way."""
    done = 0
    for job in jobs:
        held = _last_row(store, job)
        driven = job.episodes_driven() if held < job.stop else 0
        done += min(max(held, driven), job.stop)
    return Progress(done, sum(job.stop for job in jobs))
