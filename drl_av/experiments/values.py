"""Checks the values in the cells of a results table before anything is driven or drawn."""

from collections.abc import Mapping, Sequence
from typing import Any

from drl_av.env.metrics import EpisodeResult
from drl_av.files import SHOWN, PlainNumber, Row, column_types, parse_cell

TYPES: Mapping[str, Any] = {
    name: PlainNumber if kind in (int, float) else kind
    for name, kind in column_types(EpisodeResult).items()
}
"""The types of the columns of an episode; a table of means has numbers in place of counts."""


def require_values(rows: Sequence[Row]) -> None:
    """Raise ValueError if a cell does not have the type of its column.

    In a column without a type a number is at most ``files.LARGEST``, and no cell is NaN or
    infinite.
    """
    for line, row in enumerate(rows, start=2):
        for column, cell in row.items():
            kind = TYPES.get(column) or (PlainNumber if _is_number(cell) else str)
            try:
                parse_cell(cell, kind)
            except ValueError as error:
                raise ValueError(f"line {line}: {column} is {cell[:SHOWN]}") from error


def require_numbers(row: Row, names: Sequence[str]) -> None:
    """Raise ValueError if a cell of these columns is no number, or not a finite one."""
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
