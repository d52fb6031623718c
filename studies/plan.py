"""Trains and evaluates drivers to make the missing rows of an experiment's results table."""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from time import monotonic
from typing import Any, Protocol

from drl_av.evaluation.engines import ENGINES
from drl_av.evaluation.provenance import checksum
from drl_av.files import Row, make_folder
from studies.options import Progress, ReproduceOptions
from studies.store import MadeWith, ResultStore, report_corrupt_table
from studies.training_jobs import TrainingJob, train_job


class Cell(Protocol):
    """A cell: the rows of a results table that one training or one evaluation makes."""

    training: TrainingJob | None
    """The training that must end before the rows can be made; None without a training."""

    @property
    def key(self) -> Row:
        """The columns and values that all rows of the cell have in common."""

    def check(self) -> None:
        """Raise DrlAvError if the rows cannot be made; the plan calls this before any training."""
        return

    def missing(self, rows: Sequence[Row]) -> int:
        """Return the number of episodes still to drive.

        ``rows`` are the existing rows of the cell. Raises ValueError if they are damaged.
        """

    def reported(self) -> list[Row]:
        """Return the rows that the training has already written to its folder.

        The list is empty if the rows come from ``make`` instead.
        """
        return []

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Make and yield the missing rows in ``jobs`` processes; ``rows`` are the existing ones."""


def by(**columns: Iterable[object] | Callable[[str], Any]) -> Callable[[Row], tuple[Any, ...]]:
    """Return a function that returns the sort key of a row, for ``Plan.order``.

    The rows are sorted by the first column, then by the second, and so on. The argument for a
    column is either all of its values in their order, or a function that converts the text of a
    cell, such as ``int``. The returned function raises ValueError for a row with another value.
    """
    places = {
        column: values if callable(values) else [*map(str, values)].index
        for column, values in columns.items()
    }
    return lambda row: tuple(place(row[column]) for column, place in places.items())


@dataclass(frozen=True)
class Plan:
    """The cells of an experiment's results table, in stages that are done one after the other."""

    made_with: MadeWith
    """The settings and drivers of the rows."""
    stages: Sequence[Sequence[Cell]]
    order: Callable[[Row], Any]
    """Function that returns the sort key of a row, which is unique in the table; see ``by``."""
    next_cell: Callable[[list[Row], Cell], Cell | None] = lambda rows, cell: None
    """Function that returns a further cell, given the rows so far and the last cell; None ends the
    plan."""
    line: Callable[[list[Row], Cell], str] = lambda rows, cell: ""
    """Function that returns the line to print when a cell is complete; "" prints none."""
    named: str = ""
    """The column with the name of a row's settings in ``made_with``; empty if there is none."""
    empty: str = ""
    """The line to print if there are no cells."""

    def make(
        self, store: ResultStore, options: ReproduceOptions
    ) -> Generator[Progress, None, None]:
        """Do the trainings and evaluations whose rows the store lacks; yield the progress.

        The store is saved when a training or a cell ends, and when the work is interrupted. Rows
        in the store are not made again, even if the folders of their trainings are lost.

        Raises:
            DrlAvError: rows are damaged, a training's folder has other settings or too many
                episodes, or a file cannot be written.
            SimulationError: a training or an evaluation failed.
        """
        cells = [cell for stage in self.stages for cell in stage]
        if not cells:
            yield Progress(1, 1, line=self.empty)
        for cell in (incomplete := _incomplete(cells, store)):
            cell.check()
        if any(cell.training for cell in incomplete):
            make_folder(options.runs, "--runs")
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
    """Make and yield the missing rows of a cell; save the results table when they are complete."""
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
    """Do the trainings that incomplete cells need; yield the progress.

    A training that another one continues (``TrainingJob.origin``) is done first.
    """
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
            make_folder(batch[0].folder.parent, "--runs")
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
    """Raise DrlAvError if the table's rows of these trainings were made with other policies."""
    trained = [job for job in jobs if job.policy.is_file()]
    store.require(MadeWith({}, {job.name: checksum(job.policy) for job in trained}))


def _collect(cells: Sequence[Cell], store: ResultStore, options: ReproduceOptions) -> None:
    """Read the rows that the trainings report; save the store if there are new rows."""
    with report_corrupt_table(store.path):
        changed = [store.put(cell.key, cell.reported()) for cell in cells]
    for job in {cell.training for cell in cells if cell.training}:
        if (seconds := job.wall_time_s()) is not None:
            store.seconds[job.name] = max(store.seconds.get(job.name, 0.0), seconds)
    if any(changed):
        store.save(options)
