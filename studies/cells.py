"""The two kinds of cells of a results table: rows from an evaluation, and rows from a training."""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import NamedTuple

from drl_av.config import Config
from drl_av.drivers.policy_file import find_policy
from drl_av.drivers.registry import find_drivers
from drl_av.env.metrics import EpisodeMetrics, EpisodeResult
from drl_av.errors import DrlAvError, pluralize
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.comparison import Evaluation
from drl_av.evaluation.provenance import checksum
from drl_av.files import Row
from studies.options import ReproduceOptions
from studies.plan import Cell, Plan, by
from studies.store import MadeWith, seeds_held
from studies.training_jobs import TrainingJob
from studies.values import require_numbers


@dataclass(frozen=True)
class Drives(Cell):
    """A cell whose rows are evaluation episodes, one for each driver and traffic seed.

    All episodes have the same number of vehicles. The traffic seeds are consecutive.
    """

    config: Config
    drivers: tuple[str, ...]
    """Names of drivers or folders of runs."""
    vehicles: int
    seeds: int
    """Number of traffic seeds."""
    columns: tuple[str, ...] = ()
    """The fields of an EpisodeResult that a row contains besides the key; empty for all fields."""
    named: tuple[tuple[str, str], ...] = ()
    """The (column, value) pairs of the key, besides ``vehicles``."""
    training: TrainingJob | None = None
    """The training that makes the driver; None if the drivers exist already."""
    first_seed: int = 0
    """Traffic seed of the first episode."""
    metrics: type[EpisodeMetrics] = EpisodeMetrics
    """The class that measures an episode; ``columns`` are fields of its results."""

    @property
    def key(self) -> Row:
        """The columns and values that all rows of the cell have in common."""
        return {**dict(self.named), "vehicles": str(self.vehicles)}

    def check(self) -> None:
        """Raise RunError if the training's folder has other settings, or too many episodes."""
        if self.training:
            self.training.require_same_settings()
            self.training.require_not_beyond()

    def missing(self, rows: Sequence[Row]) -> int:
        """Return the number of episodes still to drive.

        ``rows`` are the existing rows. Raises ValueError if a seed among them is missing or occurs
        too often.
        """
        drivers = len(self.drivers)
        return max(0, self.seeds - seeds_held(rows, drivers, self.first_seed)) * drivers

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Drive the seeds that ``rows`` lacks, in ``jobs`` processes, and yield the new rows.

        Raises the errors of ``evaluation.comparison.Evaluation``.
        """
        held = seeds_held(rows, len(self.drivers), self.first_seed)
        seeds = range(self.first_seed + held, self.first_seed + self.seeds)
        drivers = find_drivers(self.drivers)
        evaluation = Evaluation(self.config, drivers, [self.vehicles], seeds, self.metrics)
        with closing(evaluation.rows(jobs)) as results:
            for result in results:
                found = selected(result, *self.columns)
                yield {name: v for name, v in self.key.items() if name not in found} | found


class TableDriver(NamedTuple):
    """A driver whose episodes are rows of a table; it exists, or a training makes it."""

    name: str
    """Name of the driver in the table, and of its settings in the provenance."""
    driver: str
    """Name of the driver, or folder of its run."""
    config: Config
    """The settings with which it drives."""
    job: TrainingJob | None = None
    """The training that makes it; None if the driver exists already."""
    named: tuple[tuple[str, str], ...] = ()
    """The (column, value) pairs that all of its rows have in common."""

    def drives(
        self, vehicles: int, seeds: int, columns: tuple[str, ...], first_seed: int = 0
    ) -> Drives:
        """Return the cell in which the driver drives; the arguments are those of ``Drives``."""
        fields = (self.config, (self.driver,), vehicles, seeds, columns, self.named)
        return Drives(*fields, self.job, first_seed)


def made_with(drivers: Sequence[TableDriver]) -> MadeWith:
    """Return the settings, policies and numbers of training episodes of drivers, for provenance.

    If a TrainingJob makes a driver, its settings are those of the training.

    Raises RunError or CheckpointError if a learned driver cannot be read.
    """
    return MadeWith(
        {each.name: each.job.config if each.job else each.config for each in drivers},
        policies_of([each.driver for each in drivers if each.job is None]),
        {each.name: each.job.stop for each in drivers if each.job},
    )


def selected(result: EpisodeResult, *names: str) -> Row:
    """Return the named fields of an episode as text; all fields if no name is given."""
    values = result.cells()
    return {name: str(values[name]) for name in names or values}


@dataclass(frozen=True)
class TrainingRows(Cell):
    """A cell whose rows are read from the folder of a training, up to its last episode."""

    training: TrainingJob
    rows_of: Callable[[TrainingJob], list[Row]]
    """Reads the rows from the training's folder."""

    @property
    def key(self) -> Row:
        """The columns and values that all rows of the cell have in common."""
        return self.training.key

    def check(self) -> None:
        """Check that the rows can be made.

        Raises:
            RunError: the training's folder has other settings.
            DrlAvError: the training has fewer episodes than one row summarizes.
        """
        if self.training.last_row < 1:
            raise DrlAvError(
                f"A training of {pluralize(self.training.stop, 'episode')} makes no row of the "
                f"table, which sums up {self.training.every}: ask for as many at the least."
            )
        self.training.require_same_settings()

    def missing(self, rows: Sequence[Row]) -> int:
        """Return the number of training episodes that the existing ``rows`` do not cover.

        Raises ValueError if a row in between is missing.
        """
        episodes, every = [int(row["episode"]) for row in rows], self.training.every
        held = episodes[-1] if episodes else 0
        last = [held] if held == self.training.config.learning.episodes else []
        if episodes != [*dict.fromkeys([*range(every, held + 1, every), *last])]:
            raise ValueError(f"{self.training.name} lacks a row before episode {held}")
        return max(0, self.training.last_row - held, int(self.training.last_row < 1))

    def reported(self) -> list[Row]:
        """Return the rows of the results table that the training has reported so far."""
        return self.rows_of(self.training)

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Raise DrlAvError: the training has ended, but its folder lacks some of its rows."""
        raise DrlAvError(
            f"{self.training.folder} lacks rows of its training up to episode "
            f"{self.training.last_row}: put back its files, or give --runs a folder that all "
            "processes share."
        )
        yield  # makes this a generator, as the interface demands


def training_plan(
    configs: dict[str, Config],
    rounds: Sequence[Sequence[TrainingJob]],
    rows_of: Callable[[TrainingJob], list[Row]],
) -> Plan:
    """Return a plan of a results table whose rows are read from the folders of trainings.

    Args:
        configs: The config of each variant with seed 0, for the table's provenance.
        rounds: The trainings in groups; the groups are done one after the other.
        rows_of: The function that reads the rows from a training's folder.
    """
    variants = list(configs)

    def place(row: Row) -> tuple[int, int, int]:
        require_numbers(row, [name for name in row if name != "variant"])
        return variants.index(row["variant"]), int(row["seed"]), int(row["episode"])

    stages = [[TrainingRows(job, rows_of) for job in jobs] for jobs in rounds]
    return Plan(MadeWith(configs), stages, place, named="variant")


def driven_with(config: Config, drivers: Sequence[str]) -> MadeWith:
    """Return the config and the checksums of these drivers' policies, for a table's provenance.

    Raises RunError or CheckpointError if a learned driver cannot be read.
    """
    return MadeWith({"": config}, {"": "+".join(policies_of(drivers).values()) or None})


def policies_of(drivers: Sequence[str]) -> dict[str, str]:
    """Return the checksum of the policy of each of these drivers that is learned, by name.

    Raises RunError or CheckpointError if a learned driver cannot be read.
    """
    return {
        each.name: checksum(find_policy(each.run)) for each in find_drivers(drivers) if each.run
    }


def trained_drives(
    jobs: Sequence[TrainingJob], options: ReproduceOptions, columns: tuple[str, ...]
) -> Plan:
    """Return a plan to evaluate the driver of each training with the settings of its training.

    Each driver drives ``options.drives`` episodes at each number of vehicles in DENSITIES. A row
    holds the fields ``columns``.
    """
    drivers = [
        TableDriver(job.name, str(job.folder), job.config, job, (("training", job.name),))
        for job in jobs
    ]
    cells = [
        each.drives(vehicles, options.drives, columns) for each in drivers for vehicles in DENSITIES
    ]
    order = by(training=_place, vehicles=DENSITIES, seed=int)
    return Plan(made_with(drivers), [cells], order, named="training")


def _place(training: str) -> tuple[bool, str, int]:
    """Return the sort key of a training: the variant "paper" first, then variant and seed."""
    variant, _, number = training.rpartition("-")
    return variant != "paper", variant, int(number)
