"""The cells of a table: evaluation episodes, or the reports of a training."""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass

from drl_av.config import Config
from drl_av.drivers.policy_file import find_policy
from drl_av.drivers.registry import find_drivers
from drl_av.env.metrics import EpisodeResult
from drl_av.errors import DrlAvError
from drl_av.evaluation import DENSITIES
from drl_av.evaluation.comparison import Evaluation
from drl_av.experiments.options import ReproduceOptions
from drl_av.experiments.plan import Plan
from drl_av.experiments.provenance import checksum
from drl_av.experiments.store import MadeWith, seeds_held
from drl_av.experiments.training_jobs import TrainingJob
from drl_av.files import Row


@dataclass(frozen=True)
class Drives:
    """A cell of evaluation episodes: drivers, a number of vehicles, traffic seeds in a row."""

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
    first_seed: int = 0
    """Traffic seed of the first episode."""

    @property
    def key(self) -> Row:
        """The columns that the rows have in common."""
        return {**dict(self.named), "vehicles": str(self.vehicles)}

    def check(self) -> None:
        """Raise RunError if the training's folder has other settings, or too many episodes."""
        if self.training:
            self.training.require_same_settings()
            self.training.require_not_beyond()

    def missing(self, rows: Sequence[Row]) -> int:
        """Episodes still to drive; raises ValueError where the rows lack a seed among others."""
        drivers = len(self.drivers)
        return max(0, self.seeds - seeds_held(rows, drivers, self.first_seed)) * drivers

    def reported(self) -> list[Row]:
        """No rows: all of them are driven."""
        return []

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Drive the missing seeds; raises what ``Evaluation`` raises."""
        held = seeds_held(rows, len(self.drivers), self.first_seed)
        seeds = range(self.first_seed + held, self.first_seed + self.seeds)
        drivers = find_drivers(self.drivers)
        evaluation = Evaluation(self.config, drivers, [self.vehicles], seeds)
        with closing(evaluation.rows(jobs)) as results:
            for result in results:
                found = selected(result, *self.columns)
                yield {name: v for name, v in self.key.items() if name not in found} | found


def selected(result: EpisodeResult, *names: str) -> Row:
    """The named columns of an episode as text, or all of them."""
    values = asdict(result)
    return {name: str(values[name]) for name in names or values}


@dataclass(frozen=True)
class TrainingRows:
    """A cell whose rows are the reports of a training, up to its last episode."""

    training: TrainingJob
    rows_of: Callable[[TrainingJob], list[Row]]

    @property
    def key(self) -> Row:
        """The columns that the rows have in common."""
        return self.training.key

    def check(self) -> None:
        """Raise RunError for a folder of other settings, DrlAvError for too few episodes."""
        if self.training.last_row < 1:
            raise DrlAvError(
                f"{self.training.stop} episodes make no row of the table, which sums up "
                f"{self.training.every}: ask for as many at the least."
            )
        self.training.require_same_settings()

    def missing(self, rows: Sequence[Row]) -> int:
        """Episodes still to drive."""
        held = int(rows[-1]["episode"]) if rows else 0
        return max(0, self.training.last_row - held, int(self.training.last_row < 1))

    def reported(self) -> list[Row]:
        """The rows in the training's folder."""
        return self.rows_of(self.training)

    def make(self, rows: Sequence[Row], jobs: int) -> Generator[Row, None, None]:
        """Raise DrlAvError, because ``reported`` must have returned all rows of the training."""
        raise DrlAvError(
            f"{self.training.folder} lacks rows of its training up to episode "
            f"{self.training.last_row}: put back its files, or give --runs a folder that all "
            "processes share."
        )
        yield  # as every cell's, a generator


def training_plan(
    configs: dict[str, Config],
    rounds: Sequence[Sequence[TrainingJob]],
    rows_of: Callable[[TrainingJob], list[Row]],
) -> Plan:
    """A table of the reports of trainings; ``configs`` are those of every variant with seed 0."""
    variants = list(configs)

    def place(row: Row) -> tuple[int, int, int]:
        return variants.index(row["variant"]), int(row["seed"]), int(row["episode"])

    stages = [[TrainingRows(job, rows_of) for job in jobs] for jobs in rounds]
    return Plan(MadeWith(configs), stages, place)


def driven_with(config: Config, drivers: Sequence[str]) -> MadeWith:
    """The config and the policies of these drivers; raises RunError and CheckpointError."""
    learned = [driver.run for driver in find_drivers(drivers) if driver.run]
    policies = [checksum(find_policy(run)) for run in learned]
    return MadeWith({"": config}, {"": "+".join(policies) or None})


def trained_drives(
    jobs: Sequence[TrainingJob], options: ReproduceOptions, columns: tuple[str, ...]
) -> Plan:
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
    settings = {job.name: job.config for job in jobs}
    made_with = MadeWith(settings, {}, {job.name: job.stop for job in jobs})
    return Plan(made_with, [cells], _place)


def _place(row: Row) -> tuple[bool, str, int, int, int]:
    """Trainings of the paper's algorithm first, then by variant and seed."""
    variant, _, number = row["training"].rpartition("-")
    return variant != "paper", variant, int(number), int(row["vehicles"]), int(row["seed"])
