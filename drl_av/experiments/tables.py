"""Result tables as text: rows of CSV files, and files written whole."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from drl_av.errors import DrlAvError
from drl_av.files import Row, write_whole


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
    """The rows of a CSV file as text; none where there is no file.

    Raises:
        ValueError: a row is cut short.
    """
    if not table.exists():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        text = file.read()
    rows = list(csv.DictReader(io.StringIO(text, newline="")))
    if not text.endswith("\n") or any(None in row.values() for row in rows):
        raise ValueError("a row is cut short")
    return rows


def seeds_held(rows: Iterable[Row], drivers: int = 1) -> int:
    """How many seeds, from 0 on, the rows have of each of so many drivers.

    Raises:
        ValueError: one is missing among them, or there twice.
    """
    seeds = sorted(int(row["seed"]) for row in rows)
    count = len(seeds) // drivers
    if seeds != sorted([*range(count)] * drivers):
        raise ValueError("a seed is missing, or there twice")
    return count


def write_rows(table: Path, rows: Sequence[Row]) -> None:
    """Write the CSV file whole or not at all; raises DrlAvError where the disk refuses."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(table, text.getvalue().encode())
