"""Makes the missing rows of a study's table: trains drivers, and evaluates them."""

import os
import time
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

from drl_av.config import Config
from drl_av.drivers.registry import DriverSpec, find_drivers
from drl_av.env.metrics import EpisodeMetrics
from drl_av.errors import DrlAvError
from drl_av.evaluation import RAY
from drl_av.evaluation.engines import ENGINES, cluster
from drl_av.evaluation.episodes import EpisodeJob, Setup, drive_episodes
from drl_av.evaluation.figure_style import save_figure
from drl_av.evaluation.provenance import checksum
from drl_av.evaluation.table import Inputs, ResultTable, report_corrupt_table
from drl_av.files.atomic import make_folder, require_writable
from drl_av.files.table import Row, write_table
from studies.options import Call, Options, Plan
from studies.trainings import TrainingJob, TrainingRows, train_job

if TYPE_CHECKING:
    from studies.registry import Study

SAVE_EVERY_S = 30.0


class Progress(NamedTuple):
    """The progress of a study: number of episodes done, of all, and what they are."""

    done: int
    total: int
    text: str


class EpisodeCell(NamedTuple):
    """Evaluation episodes of drivers with one config among one number of vehicles."""

    config: Config
    drivers: tuple[str, ...]
    """Names of drivers or folders of runs, which drive together."""
    vehicles: int
    seeds: range
    """The traffic seeds."""
    columns: tuple[str, ...]
    """The columns of a row: those of ``key``, "training", and fields of a result; "*" means all
    fields."""
    key: Row
    """The values that all rows of the cell have in common."""
    training: TrainingJob | None = None
    """The training that makes the only driver; None if the drivers exist already."""
    name: str = ""
    """The name of the only driver in the table; empty for the names in ``drivers``."""
    metrics: type[EpisodeMetrics] = EpisodeMetrics

    def row(self, driver: str, seed: int) -> Row:
        """Return the columns that say the place of the row of an episode."""
        name = self.name or driver
        key = {"driver": name, "training": name, "vehicles": str(self.vehicles), **self.key}
        return key | {"seed": str(seed)}


def make(study: "Study", options: Options) -> Generator[Progress, None, None]:
    """Make the missing rows of the study's table in ``options.out``, and its derived tables.

    The generator yields the progress at least once per episode. The table is saved now and then,
    and when the work is interrupted.

    Raises:
        DrlAvError: the table was made with other settings or is damaged, a training's folder
            belongs to another training, or a file cannot be written.
        SimulationError: a training or an evaluation failed.
    """
    plan = study.plan(options)
    path = options.out / f"{study.name}.csv"
    table = ResultTable(path, plan.inputs, plan.place)
    derived = [options.out / name for name in study.derived]
    require_writable(*derived, *(options.out / f"{name}.png" for name in study.figures))
    _save_derived(study, table)
    yield from _make(plan, table, options)
    _save_derived(study, table)


def draw(study: "Study", folder: Path) -> Iterator[Path]:
    """Draw the study's figures of the table in ``folder`` into it; yield the paths.

    Raises:
        DrlAvError: a table is damaged, or a file cannot be written.
    """
    for name, drawing in study.figures.items():
        with report_corrupt_table(folder / f"{study.name}.csv"):
            figure = drawing(folder)
        save_figure(figure, folder / f"{name}.png")
        yield folder / f"{name}.png"


def _save_derived(study: "Study", table: ResultTable) -> None:
    if not table.rows:
        return
    for name, derive in study.derived.items():
        with report_corrupt_table(table.path):
            try:
                rows = derive(table.rows)
            except DrlAvError as error:
                raise ValueError(str(error)) from error
        if rows:
            write_table(table.path.with_name(name), rows[0], rows)


def _make(plan: Plan, table: ResultTable, options: Options) -> Iterator[Progress]:
    facts = {"engine": options.engine, "processes": options.jobs}
    trainings = [rows for rows in plan.trainings if _missing_rows(rows, table)]
    episodes = _missing_episodes(plan.cells, table)
    calls = [call for call in plan.calls if any(key not in table for key in call.keys)]
    jobs = list(dict.fromkeys(cell.training for cell, *_ in episodes if cell.training))
    for job in jobs:
        job.require_same_settings()
        job.require_not_beyond()
    for rows in trainings:
        rows.job.require_same_settings()
    if jobs or trainings:
        make_folder(options.runs, "--runs")
        if options.engine == RAY:
            require_shared(options.runs)
    try:
        yield from _report(trainings, table, options)
        yield from _train(jobs, table, options)
        _require_drivers(jobs, table)
        yield from _call(calls, plan, table, options)
        yield from _drive(episodes, table, options)
    finally:
        if trainings or episodes or calls:
            table.save(**facts)


def require_shared(folder: Path) -> None:
    """Check that all machines of the Ray cluster at ``RAY_ADDRESS`` see the same ``folder``.

    Each machine must see a file that this one writes there. Without ``RAY_ADDRESS`` all jobs run on
    this machine.

    Raises DrlAvError if a machine does not see it.
    """
    if "RAY_ADDRESS" not in os.environ:
        return
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    mark = folder / f".shared-{uuid4().hex}"
    mark.touch()
    try:
        with cluster(1):
            exists: Any = ray.remote(num_cpus=0)(lambda path: os.path.exists(path))
            answers = dict[str, Any]()
            nodes: list[dict[str, Any]] = ray.nodes()  # type: ignore[no-untyped-call]
            for node in nodes:
                if node["Alive"]:
                    there = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
                    asked = exists.options(scheduling_strategy=there).remote(str(mark))
                    answers[node["NodeManagerHostname"]] = asked
            blind = [host for host, answer in answers.items() if not ray.get(answer)]
    finally:
        mark.unlink(missing_ok=True)
    if blind:
        raise DrlAvError(
            f"{', '.join(blind)} of the Ray cluster cannot see the files in {folder}: give --runs "
            "a folder that all its machines share."
        )


def _missing_rows(rows: TrainingRows, table: ResultTable) -> bool:
    with report_corrupt_table(table.path):
        return any(key not in table for key in rows.keys(table.of(rows.job.key)))


def _missing_episodes(
    cells: Iterable[EpisodeCell], table: ResultTable
) -> list[tuple[EpisodeCell, str, int]]:
    return [
        (cell, driver, seed)
        for cell in cells
        for seed in cell.seeds
        for driver in cell.drivers
        if cell.row(driver, seed) not in table
    ]


def _report(
    trainings: Sequence[TrainingRows], table: ResultTable, options: Options
) -> Iterator[Progress]:
    """Do trainings that report rows; add the rows to the table while they train."""

    unread = [*trainings]

    def collect() -> None:
        with report_corrupt_table(table.path):
            for rows in unread:
                table.add(*rows.reported())
        _note_wall_times([rows.job for rows in unread], table)
        unread[:] = [rows for rows in unread if not rows.job.begun or _missing_rows(rows, table)]

    begun = [rows.job.origin for rows in trainings if rows.job.begun and rows.job.origin]
    _require_drivers(begun, table)
    collect()
    left = [rows.job for rows in trainings if _missing_rows(rows, table)]
    origins = list(dict.fromkeys(job.origin for job in left if job.origin and not job.begun))
    yield from _train(origins, table, options)
    _require_drivers(origins, table)
    try:
        for progress in _train(left, table, options):
            collect()
            yield progress
    finally:
        collect()
    if lost := [rows.job for rows in trainings if _missing_rows(rows, table)]:
        raise DrlAvError(
            f"{lost[0].folder} lacks rows of its training up to episode {lost[0].last_row}: put "
            "back its files, or give --runs a folder that all processes share."
        )


def _train(jobs: Sequence[TrainingJob], table: ResultTable, options: Options) -> Iterator[Progress]:
    """Do trainings; add their wall times to the table's provenance."""
    if not jobs:
        return
    total = sum(job.stop for job in jobs)
    for job in jobs:
        make_folder(job.folder.parent, "--runs")
    with closing(ENGINES[options.engine](train_job, jobs, options.jobs)) as engine:
        for _ in engine:
            _note_wall_times(jobs, table)
            done = sum(min(job.episodes_driven(), job.stop) for job in jobs)
            yield Progress(done, total, "training")


def _note_wall_times(jobs: Iterable[TrainingJob], table: ResultTable) -> None:
    """Note the wall times of trainings so far in the table's provenance."""
    for job in jobs:
        if (seconds := job.wall_time_s()) is not None:
            table.seconds[job.name] = max(table.seconds.get(job.name, 0.0), seconds)


def _require_drivers(jobs: Iterable[TrainingJob], table: ResultTable) -> None:
    """Raise DrlAvError if the table's rows of these trainings were made with other policies."""
    trained = [job for job in jobs if job.policy.is_file()]
    table.require(Inputs({}, {job.name: checksum(job.policy) for job in trained}))


def _call(
    calls: Sequence[Call], plan: Plan, table: ResultTable, options: Options
) -> Iterator[Progress]:
    """Make the rows of functions; add those of a function when it has ended."""
    if not calls:
        return
    [function] = {call.function for call in calls}
    begun_s, before_s = time.monotonic(), table.seconds.get("", 0.0)
    arguments = [call.argument for call in calls]
    done, total = 0, sum(len(call.keys) for call in calls)
    with closing(ENGINES[options.engine](function, arguments, options.jobs)) as engine:
        for ended in engine:
            for place, rows in ended:
                table.add(*rows)
                done += len(calls[place].keys)
            table.seconds[""] = before_s + time.monotonic() - begun_s
            yield Progress(done, total, "training and evaluating")


def _drive(
    episodes: Sequence[tuple[EpisodeCell, str, int]], table: ResultTable, options: Options
) -> Iterator[Progress]:
    """Drive evaluation episodes, and add their rows to the table."""
    if not episodes:
        return
    jobs = _episode_jobs(episodes)
    saved_s = begun_s = time.monotonic()
    before_s = table.seconds.get("", 0.0)
    with closing(drive_episodes(jobs, options.jobs, options.engine)) as results:
        for done, ((cell, driver, seed), result) in enumerate(zip(episodes, results, strict=True)):
            key, values = cell.row(driver, seed), result.cells()
            found = {name: str(value) for name, value in values.items()} | key
            names = [own for name in cell.columns for own in (values if name == "*" else [name])]
            table.add({name: found[name] for name in names})
            now_s = time.monotonic()
            table.seconds[""] = before_s + now_s - begun_s
            if now_s - saved_s > SAVE_EVERY_S:
                table.save(engine=options.engine, processes=options.jobs)
                saved_s = now_s
            yield Progress(done + 1, len(episodes), f"{cell.name or driver}, {cell.vehicles}")


def _episode_jobs(episodes: Iterable[tuple[EpisodeCell, str, int]]) -> list[EpisodeJob]:
    specs: dict[tuple[str, ...], dict[str, DriverSpec]] = {}
    jobs = []
    for cell, driver, seed in episodes:
        if cell.drivers not in specs:
            found = find_drivers(cell.drivers)
            specs[cell.drivers] = dict(zip(cell.drivers, found, strict=True))
        own = specs[cell.drivers]
        setup = Setup(cell.config, tuple(own.values()), cell.metrics)
        jobs.append(EpisodeJob(setup, cell.vehicles, seed, own[driver].name))
    return jobs
