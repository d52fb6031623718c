"""Result tables as text: rows of CSV files, and files written whole."""

import csv
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from drl_av.errors import DrlAvError
from drl_av.studies.files import write_whole

Row = dict[str, str]


@contextmanager
def intact(table: Path) -> Iterator[None]:
    """Raises DrlAvError where the block stumbles over rows that are not as they were written."""
    try:
        yield
    except (ValueError, LookupError, TypeError, AttributeError, csv.Error) as error:
        raise DrlAvError(
            f"{table}, or what stands beside it, is damaged or of another version ({error!r}): "
            "put both back as they were, or move them away to make them anew."
        ) from error


def read_rows(table: Path) -> list[Row]:
    """The rows of a CSV file as text; none where there is no file."""
    if not table.exists():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_rows(table: Path, rows: Sequence[Row]) -> None:
    """Write the CSV file whole or not at all; raises DrlAvError where the disk refuses."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(table, text.getvalue().encode())
