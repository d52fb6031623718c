"""Reads results for the documentation, and makes Markdown tables."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from drl_av.evaluation.provenance import read_provenance
from drl_av.evaluation.table import read_rows, report_corrupt_table
from drl_av.files.table import Row


class ResultsFolder:
    """Reads a folder of results for the tables of the documentation."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def rows(self, table: str) -> list[Row]:
        """Read the rows of the table with this file name; [] if the file does not exist.

        Raises DrlAvError if the table is damaged.
        """
        with report_corrupt_table(self.folder / table):
            return read_rows(self.folder / table)

    def made_by(self, table: str) -> dict[str, Any]:
        """Read the provenance of a table: how it was made.

        Raises DrlAvError if the provenance is damaged.
        """
        with report_corrupt_table(self.folder / table):
            return read_provenance(self.folder / table)


def markdown_table(heading: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown with a heading row."""
    names = list(heading)
    lines = [names, ["---"] * len(names), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
