"""Checks the values in the cells of a results table before anything is driven or drawn."""

from collections.abc import Mapping, Sequence
from typing import Any

from drl_av.env.metrics import EpisodeResult
from drl_av.files import SHOWN, PlainNumber, Row, column_types, parse_cell

TYPES: Mapping[str, Any] = {
    name: PlainNumber if kind in (int, float) else kind
    for name, kind in column_types(EpisodeResult).items()
}
"""The type of each column of an episode; counts may be fractions, as in a table of means."""


def require_values(rows: Sequence[Row]) -> None:
    """Raise ValueError if a cell does not have the type of its column.

    ``TYPES`` holds the types. In all other columns a cell is a text, or a finite number of at most
    ``files.LARGEST``.
    """
    for line, row in enumerate(rows, start=2):
        for column, cell in row.items():
            kind = TYPES.get(column) or (PlainNumber if _is_number(cell) else str)
            try:
                parse_cell(cell, kind)
            except ValueError as error:
                raise ValueError(f"line {line}: {column} is {cell[:SHOWN]}") from error


def require_numbers(row: Row, names: Sequence[str]) -> None:
    """Raise ValueError if a cell of these columns is not a finite number."""
    for name in names:
        try:
            parse_cell(row[name], PlainNumber)
        except ValueError as error:
            raise ValueError(f"{name} is {row[name][:SHOWN]}") from error


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
