"""Experiments whose rows are evaluation episodes, of which only the missing ones are driven."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from time import monotonic
from typing import Any, Protocol

from drl_av.config import Config
from drl_av.drivers.policy_file import find_policy
from drl_av.drivers.registry import find_drivers
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.comparison import Evaluation
from drl_av.experiments.engines import ENGINES
from drl_av.experiments.options import Progress, ReproduceOptions
from drl_av.experiments.provenance import checksum
from drl_av.experiments.store import (
    MadeWith,
    ResultStore,
    report_corrupt_table,
    seeds_held,
)
from drl_av.experiments.training_jobs import TrainingJob, train_job
from drl_av.files import Row


class Cell(Protocol):
    """Rows of a table that are made together."""

    @property
    def key(self) -> Row:
        """The columns that they have in common."""

    @property
    def training(self) -> TrainingJob | None:
        """The training that they need first."""

    def missing(self, rows: Sequence[Row]) -> int:
        """How many there are still to make; raises ValueError where those held are damaged."""

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Make the missing ones with so many processes."""


@dataclass(frozen=True)
class Drives:
    """Episodes of some drivers among so many vehicles, on the traffic seeds from 0 on."""

    config: Config
    drivers: tuple[str, ...]
    """Names of drivers or folders of runs."""
    vehicles: int
    seeds: int
    columns: tuple[str, ...] = ()
    """Those of ``EpisodeResult`` that a row has besides its key; empty for all."""
    named: tuple[tuple[str, str], ...] = ()
    """Columns and values of the key besides ``vehicles``."""
    training: TrainingJob | None = None
    """The training whose driver is driven."""

    @property
    def key(self) -> Row:
        """The columns that the rows have in common."""
        return {**dict(self.named), "vehicles": str(self.vehicles)}

    def missing(self, rows: Sequence[Row]) -> int:
        """Episodes still to drive; raises ValueError where the rows lack a seed among others."""
        drivers = len(self.drivers)
        return max(0, self.seeds - seeds_held(rows, drivers)) * drivers

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Drive the missing seeds; raises what ``Evaluation`` raises."""
        seeds = range(seeds_held(rows, len(self.drivers)), self.seeds)
        evaluation = Evaluation(self.config, find_drivers(self.drivers), [self.vehicles], seeds)
        with closing(evaluation.rows(jobs)) as results:
            for result in results:
                found = selected(result, *self.columns)
                yield {name: v for name, v in self.key.items() if name not in found} | found


def selected(result: EpisodeResult, *names: str) -> Row:
    """The named columns of an episode as text, or all of them."""
    values = asdict(result)
    return {name: str(values[name]) for name in names or values}


def driven_with(config: Config, drivers: Sequence[str]) -> MadeWith:
    """What episodes of these drivers depend on; raises RunError and CheckpointError."""
    learned = [choice.run for choice in find_drivers(drivers) if choice.run]
    policies = [checksum(find_policy(run)) for run in learned]
    return MadeWith({"": config}, {"": "+".join(policies) or None})


@dataclass(frozen=True)
class DrivingPlan:
    """Cells that are made one after the other, after the trainings that they need."""

    made_with: MadeWith
    cells: Sequence[Cell]
    order: Callable[[Row], Any]
    """The place of a row in the table; no two have the same."""
    next_cell: Callable[[list[Row], Cell], Cell | None] = lambda rows, cell: None
    """The cell after the last one, which depends on the rows so far; None for no more."""
    line: Callable[[list[Row], Cell], str] = lambda rows, cell: ""
    """What is printed when a cell is complete."""
    empty: str = ""
    """What is printed where there are no cells."""

    def make(
        self, store: ResultStore, options: ReproduceOptions
    ) -> Generator[Progress, None, None]:
        """Train and drive what the store lacks; it is saved after each cell.

        Raises:
            DrlAvError: rows are damaged, trainings' folders hold others or have gone on, or the
                disk refuses.
            SimulationError: a training or an evaluation cannot go on.
        """
        if not self.cells:
            yield Progress(1, 1, line=self.empty)
        missing = [(cell, _missing(cell, store)) for cell in self.cells]
        wanted = [cell.training for cell, count in missing if count and cell.training]
        yield from _train(list(dict.fromkeys(wanted)), store, options)
        done, total = 0, sum(count for _, count in missing)
        for place, cell in enumerate(self._each_cell(store)):
            if place >= len(self.cells):
                total += _missing(cell, store)
            if _missing(cell, store):
                for _ in _made(cell, store, options):
                    done += 1
                    yield Progress(done, total, _label(cell))
            if line := self.line(store.rows, cell):
                yield Progress(done, total, line=line)

    def _each_cell(self, store: ResultStore) -> Iterator[Cell]:
        cell: Cell | None = None
        for cell in self.cells:
            yield cell
        while cell is not None and (cell := self.next_cell(store.rows, cell)) is not None:
            yield cell


def _missing(cell: Cell, store: ResultStore) -> int:
    with report_corrupt_table(store.path):
        return cell.missing(store.of(cell.key))


def _label(cell: Cell) -> str:
    return ", ".join(f"{name} {value}" for name, value in cell.key.items() if value)


def _made(cell: Cell, store: ResultStore, options: ReproduceOptions) -> Generator[Row, None, None]:
    held, begun_s = store.of(cell.key), monotonic()
    rows = list(held)
    with closing(cell.make(held, options.jobs)) as made:
        for row in made:
            store.require_columns(row)
            rows.append(row)
            yield row
    if cell.training is None:
        store.seconds[""] = store.seconds.get("", 0.0) + monotonic() - begun_s
    store.put(cell.key, rows)
    store.save(options)


def _train(
    jobs: Sequence[TrainingJob], store: ResultStore, options: ReproduceOptions
) -> Generator[Progress, None, None]:
    """Train the drivers, and note which they are; raises RunError before any is trained."""
    for job in jobs:
        job.folder.parent.mkdir(parents=True, exist_ok=True)
        job.require_same_settings()
        job.require_not_beyond()
    total = sum(job.stop for job in jobs)
    with closing(ENGINES[options.engine](train_job, jobs, options.jobs)) as engine:
        for _ in engine:
            yield Progress(sum(job.episodes_driven() for job in jobs), total, "training")
    store.require(MadeWith({}, {job.name: checksum(job.policy) for job in jobs}))
    times = {job.name: job.wall_time_s() for job in jobs}
    store.seconds |= {name: seconds for name, seconds in times.items() if seconds is not None}


def trained_drives(
    jobs: Sequence[TrainingJob], options: ReproduceOptions, columns: tuple[str, ...]
) -> DrivingPlan:
    """Each training's driver at every density of the tables, in its own settings."""
    cells = [
        Drives(
            job.config,
            (str(job.folder),),
            vehicles,
            options.drives,
            columns,
            (("training", job.name),),
            job,
        )
        for job in jobs
        for vehicles in DENSITIES
    ]
    made_with = MadeWith(
        {job.name: job.config for job in jobs}, {}, {job.name: job.stop for job in jobs}
    )
    return DrivingPlan(made_with, cells, _place)


def _place(row: Row) -> tuple[bool, str, int, int, int]:
    """Trainings of the paper's algorithm first, then by variant and seed."""
    variant, _, number = row["training"].rpartition("-")
    return variant != "paper", variant, int(number), int(row["vehicles"]), int(row["seed"])
