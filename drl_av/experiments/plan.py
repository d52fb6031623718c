"""How an experiment makes the rows that its table lacks: it trains, and then it drives."""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from time import monotonic
from typing import Any, Protocol

from drl_av.experiments.engines import ENGINES
from drl_av.experiments.options import Progress, ReproduceOptions
from drl_av.experiments.provenance import checksum
from drl_av.experiments.store import MadeWith, ResultStore, report_corrupt_table
from drl_av.experiments.training_jobs import TrainingJob, train_job
from drl_av.files import Row


class Cell(Protocol):
    """A group of rows of a table that one training or one evaluation produces together."""

    @property
    def key(self) -> Row:
        """The columns and values that all rows of the cell have in common."""

    @property
    def training(self) -> TrainingJob | None:
        """The training that the rows need, or None."""

    def check(self) -> None:
        """Raise DrlAvError if the rows cannot be made; called before any training."""

    def missing(self, rows: Sequence[Row]) -> int:
        """Number of rows still to make; raises ValueError if the existing ``rows`` are damaged."""

    def reported(self) -> list[Row]:
        """The rows that the training's folder already holds, without an evaluation."""

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Make the missing rows with ``jobs`` processes."""


@dataclass(frozen=True)
class Plan:
    """The cells of a table, in stages that are made one after the other."""

    made_with: MadeWith
    stages: Sequence[Sequence[Cell]]
    order: Callable[[Row], Any]
    """The place of a row in the table; no two have the same."""
    next_cell: Callable[[list[Row], Cell], Cell | None] = lambda rows, cell: None
    """The cell after the last one, which depends on the rows so far; None for no more."""
    line: Callable[[list[Row], Cell], str] = lambda rows, cell: ""
    """Printed when a cell is complete; empty for nothing."""
    empty: str = ""
    """Printed where there are no cells."""

    def make(
        self, store: ResultStore, options: ReproduceOptions
    ) -> Generator[Progress, None, None]:
        """Train and drive what the store lacks.

        The store is saved when a training or a cell ends, and where the work is interrupted. Rows
        that it has are not made again, even where the folders of their trainings are lost.

        Raises:
            DrlAvError: rows are damaged; a training's folder has other settings or later
                episodes; the disk refuses.
            SimulationError: a training or an evaluation failed.
        """
        cells = [cell for stage in self.stages for cell in stage]
        if not cells:
            yield Progress(1, 1, line=self.empty)
        for cell in _incomplete(cells, store):
            cell.check()
        for stage in self.stages:
            yield from _train(stage, store, options)
            yield from self._drive(stage, store, options)

    def _drive(
        self, stage: Sequence[Cell], store: ResultStore, options: ReproduceOptions
    ) -> Generator[Progress, None, None]:
        done, total = 0, sum(_missing(cell, store) for cell in stage)
        for place, cell in enumerate(self._each(stage, store)):
            if place >= len(stage):
                total += _missing(cell, store)
            if _missing(cell, store):
                for _ in _made(cell, store, options):
                    done += 1
                    yield Progress(done, total, _label(cell))
            if line := self.line(store.rows, cell):
                yield Progress(done, total, line=line)

    def _each(self, stage: Sequence[Cell], store: ResultStore) -> Iterator[Cell]:
        cell: Cell | None = None
        for cell in stage:
            yield cell
        while cell is not None and (cell := self.next_cell(store.rows, cell)) is not None:
            yield cell


def _missing(cell: Cell, store: ResultStore) -> int:
    with report_corrupt_table(store.path):
        return cell.missing(store.of(cell.key))


def _incomplete(cells: Iterable[Cell], store: ResultStore) -> list[Cell]:
    return [cell for cell in cells if _missing(cell, store)]


def _label(cell: Cell) -> str:
    return ", ".join(f"{name} {value}" for name, value in cell.key.items() if value)


def _made(cell: Cell, store: ResultStore, options: ReproduceOptions) -> Generator[Row, None, None]:
    """The missing rows of a cell; saves them when they are complete."""
    rows, begun_s = store.of(cell.key), monotonic()
    if cell.training:
        _require_drivers(store, [cell.training])
    with closing(cell.make(rows, options.jobs)) as made:
        for row in made:
            store.require_columns(row)
            rows.append(row)
            yield row
    if cell.training is None:
        store.seconds[""] = store.seconds.get("", 0.0) + monotonic() - begun_s
    store.put(cell.key, rows)
    store.save(options)


def _train(
    stage: Sequence[Cell], store: ResultStore, options: ReproduceOptions
) -> Generator[Progress, None, None]:
    """Do the trainings of incomplete cells, after the trainings that these continue."""
    incomplete = _incomplete(stage, store)
    begun = [cell.training for cell in incomplete if cell.training and cell.training.begun]
    _require_drivers(store, [job.origin for job in begun if job.origin])
    _collect(incomplete, store, options)
    left = [cell.training for cell in _incomplete(incomplete, store) if cell.training]
    jobs = list(dict.fromkeys(left))
    origins = list(dict.fromkeys(job.origin for job in jobs if job.origin and not job.begun))
    total = sum(job.stop for job in (*origins, *jobs))
    try:
        for batch in filter(None, (origins, jobs)):
            batch[0].folder.parent.mkdir(parents=True, exist_ok=True)
            with closing(ENGINES[options.engine](train_job, batch, options.jobs)) as engine:
                for ended in engine:
                    if ended:
                        _collect(incomplete, store, options)
                    driven = (min(job.episodes_driven(), job.stop) for job in (*origins, *jobs))
                    yield Progress(sum(driven), total, "training")
            if batch is origins:
                _require_drivers(store, origins)
    finally:
        _collect(incomplete, store, options)


def _require_drivers(store: ResultStore, jobs: Iterable[TrainingJob]) -> None:
    """Raise DrlAvError where the table has rows of other drivers of the same names."""
    trained = [job for job in jobs if job.policy.is_file()]
    store.require(MadeWith({}, {job.name: checksum(job.policy) for job in trained}))


def _collect(cells: Sequence[Cell], store: ResultStore, options: ReproduceOptions) -> None:
    """Add the reports of trainings to the table, where these are more than it has."""
    with report_corrupt_table(store.path):
        changed = [store.put(cell.key, cell.reported()) for cell in cells]
    for job in {cell.training for cell in cells if cell.training}:
        if (seconds := job.wall_time_s()) is not None:
            store.seconds[job.name] = max(store.seconds.get(job.name, 0.0), seconds)
    if any(changed):
        store.save(options)
