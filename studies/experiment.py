"""Defines an experiment as a value, and makes its table of results and its figures."""

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drl_av.errors import DrlAvError
from drl_av.evaluation.provenance import read_sidecar
from drl_av.files import Row, require_writable
from studies.options import Progress, ReproduceOptions
from studies.plan import Plan
from studies.store import (
    Derived,
    ResultStore,
    read_rows,
    report_corrupt_table,
)
from studies.values import require_values

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class ResultsFolder:
    """Reads a folder of results for the tables of the documentation."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def rows(self, table: str) -> list[Row]:
        """Read the rows of the table with this file name; [] if the file does not exist.

        Raises DrlAvError if the table is damaged.
        """
        with report_corrupt_table(self._folder / table):
            return read_rows(self._folder / table)

    def made_by(self, table: str) -> dict[str, Any]:
        """Read the provenance of a table: how it was made.

        Raises DrlAvError if the provenance is damaged.
        """
        with report_corrupt_table(self._folder / table):
            return read_sidecar(self._folder / table)


@dataclass(frozen=True, eq=False)
class Experiment:
    """An experiment: a results table, the plan that makes it, its summaries and figures."""

    name: str
    """The table is the file ``<name>.csv``; the file ``<name>.json`` holds its provenance."""
    meaning: str
    """One sentence for ``python -m studies --help`` and the documentation."""
    row: str
    """The meaning of a row of the table."""
    plan: Callable[[ReproduceOptions], Plan]
    """Function that returns the trainings and evaluations which make the table."""
    derived: Derived = field(default_factory=dict)
    """Functions that compute further tables from the rows, by file name."""
    summaries: Mapping[str, Callable[[ResultsFolder], str]] = field(default_factory=dict)
    """Functions that return Markdown tables, by the name of their marker in the documentation."""
    figures: "Mapping[str, Callable[[list[Row]], Figure | None]]" = field(default_factory=dict)
    """Functions that draw the rows, by PNG file name; None means that there is nothing to draw."""
    beside: tuple[str, ...] = ()
    """File names of further tables, whose rows the figures show too (see ``drawn``)."""

    @property
    def table(self) -> str:
        """File name of the table."""
        return f"{self.name}.csv"

    def drawn(self, results: ResultsFolder) -> list[Row]:
        """Return the rows of the table, then those of the tables in ``beside``.

        Each row of the latter gets an additional column "table" with its file name. If the
        experiment's own table is empty, so is the result. Raises DrlAvError if a table is damaged.
        """
        rows, others = results.rows(self.table), self.beside
        return rows and rows + [row | {"table": n} for n in others for row in results.rows(n)]

    def draw(self, folder: Path) -> "Iterator[tuple[str, Figure]]":
        """Draw the table in ``folder``, and yield the name and the figure of each drawing.

        Raises DrlAvError if the table is damaged or a number in it is too large to draw.
        """
        with report_corrupt_table(folder / self.table):
            rows = self.drawn(ResultsFolder(folder))
            require_values(rows)
            for name, drawing in self.figures.items():
                if rows and (figure := drawing(rows)) is not None:
                    yield name, figure


def reproduce(experiment: Experiment, options: ReproduceOptions) -> Generator[Progress, None, None]:
    """Make the missing rows of the experiment's table in ``options.out``, and draw its figures.

    The generator yields the progress about once per episode.

    Raises:
        DrlAvError: the table was made with other settings or is damaged, a training's folder
            belongs to another training, or a file cannot be written.
        SimulationError: a training or an evaluation failed.
    """
    plan = experiment.plan(options)
    path = options.out / experiment.table
    store = ResultStore(path, plan.made_with, plan.order, experiment.derived, plan.named)
    require_writable(*(_figure_file(options.out, name) for name in experiment.figures))
    yield from plan.make(store, options)
    store.save_derived()
    if store.rows:
        yield from _draw(experiment, options.out)


def _draw(experiment: Experiment, folder: Path) -> Iterator[Progress]:
    from drl_av.evaluation.figure_style import save_figure

    for name, figure in experiment.draw(folder):
        save_figure(figure, _figure_file(folder, name))
        yield Progress(1, 1, line=str(_figure_file(folder, name)))


def _figure_file(folder: Path, name: str) -> Path:
    return folder / f"{name}.png"


def draw_results(
    experiments: Mapping[str, Experiment], folder: Path
) -> "Iterator[tuple[str, Figure]]":
    """Draw each experiment whose table is in ``folder``; yield the name and figure of each drawing.

    Raises:
        DrlAvError: a table is damaged, or the folder holds no table with figures.
    """
    found = [each for each in experiments.values() if (folder / each.table).is_file()]
    if not any(experiment.figures for experiment in found):
        what = "no results that have figures" if found else "neither a run nor results"
        raise DrlAvError(f"{folder} holds {what}: make them with python -m studies.")
    for experiment in found:
        yield from experiment.draw(folder)
