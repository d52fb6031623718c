"""Reading and writing CSV tables.

The columns of a table are the fields of a dataclass or NamedTuple, or are given with their types. A
table is UTF-8 text with a header, commas and line feeds. All digits of a float are written, so
reading returns exactly the float that was written. A text that a spreadsheet would take for a
formula, such as =1+1, is written after an apostrophe, which reading removes.
"""

import csv
import io
import math
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, is_dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from drl_av.errors import DrlAvError
from drl_av.files.atomic import append_lines, write_atomic

Row = dict[str, str]
"""A row of a CSV file; each value is text, the key is its column."""
PossiblyInfinite = Annotated[float, "possibly infinite"]
"""The type of a column of numbers that may be inf, such as a time to collision."""
PlainNumber = Annotated[float, "up to 1e9"]
"""The type of a column of finite numbers that figures show, each at most ``LARGEST``.

matplotlib fails at numbers near 1e308.
"""
LARGEST = 1e9
"""The largest absolute value of a PlainNumber."""
Columns = type | Iterable[str]
"""A dataclass or NamedTuple whose fields are the columns, or the columns' names."""
_REMEDY = "put the table back as it was written, or make it again"
SHOWN = 60
"""Largest number of characters of a cell that an error message shows."""
_KINDS: dict[Any, str] = {
    str: "text",
    int: "a whole number",
    bool: "True or False",
    float: "a finite number",
    PossiblyInfinite: "a number or inf",
    PlainNumber: "a finite number, at most 1e9",
}


def column_types(row_type: type) -> dict[str, Any]:
    """Return the type of each column of a dataclass or NamedTuple, in the order of its fields."""
    return get_type_hints(row_type, include_extras=True)


def table_bytes(columns: Columns, rows: Iterable[Any] = (), *, header: bool = True) -> bytes:
    """Return a CSV table as UTF-8 text; its first line has the column names if ``header`` is true.

    Each row is an object of a dataclass or NamedTuple, or a mapping from columns to values.

    Raises:
        ValueError: a row has a column that the table does not have.
    """
    names = list(column_types(columns) if isinstance(columns, type) else columns)
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, names, lineterminator="\n")
    if header:
        writer.writeheader()
    writer.writerows(map(_cells, rows))
    return text.getvalue().encode()


def write_table(path: Path, columns: Columns, rows: Iterable[Any]) -> None:
    """Write a CSV file atomically: it has the new rows, or stays unchanged if an error is raised.

    Raises:
        DrlAvError: the disk is full, or the folder is missing or not writable.
    """
    write_atomic(path, table_bytes(columns, rows))


def append_rows(path: Path, columns: Columns, rows: Iterable[Any]) -> None:
    """Append rows to a CSV file; write its header first if the file is missing or empty.

    An incomplete last line, left by a process that was killed, is removed first.

    Raises:
        DrlAvError: the disk is full, or the file or its folder is not writable.
    """
    append_lines(path, table_bytes(columns, rows, header=False), table_bytes(columns))


def read_table(
    path: Path, columns: Mapping[str, Any] | None = None, *, growing: bool = False
) -> list[dict[str, Any]]:
    """Read columns of a CSV file and return each row as a dictionary from columns to typed values.

    Args:
        path: The file.
        columns: The type of each column to read; None reads all columns as text. A type is str,
            int, bool, float (a finite number), PossiblyInfinite or PlainNumber.
        growing: Whether another program may still be adding rows. Such a table may be missing or
            empty (the result is []), and an incomplete last line is ignored.

    Raises:
        DrlAvError: the file is missing, unreadable or empty, or has no rows; a column is
            missing or occurs twice; the last line is incomplete; or a row has a wrong number of
            values, or a value of a wrong type.
    """
    if growing and not (path.exists() and path.stat().st_size):
        return []
    data = _data(path)
    if not data.endswith(b"\n"):
        if not growing:
            last = data.count(b"\n") + 1
            raise DrlAvError(f"{path}, line {last} is cut short, it has no line end: {_REMEDY}.")
        data = data[: data.rfind(b"\n") + 1]
    reader = csv.reader(io.TextIOWrapper(io.BytesIO(data), "utf-8-sig", newline=""), strict=True)
    found: list[dict[str, Any]] = []
    try:
        lines = filter(None, reader)
        header, first = next(lines, []), next(lines, None)
        if first is None and not growing:
            raise DrlAvError(f"The table {path} has no rows: {_REMEDY}.")
        types = dict.fromkeys(header, str) if columns is None else columns
        if header:
            _require_columns(path, header, types)
        for cells in () if first is None else chain([first], lines):
            found.append(_row(f"{path}, line {reader.line_num}", header, cells, types))
    except csv.Error as error:
        raise DrlAvError(
            f"{path}, line {reader.line_num} is damaged ({error}): {_REMEDY}."
        ) from error
    return found


def _cells(row: Any) -> Mapping[str, object]:
    """Return the values of a row (a dataclass, NamedTuple or mapping) by column, as written."""
    cells: Mapping[str, object]
    if is_dataclass(row) and not isinstance(row, type):
        cells = asdict(row)
    else:
        cells = row if isinstance(row, Mapping) else row._asdict()
    return {name: _quoted(cell) if isinstance(cell, str) else cell for name, cell in cells.items()}


_FORMULA = re.compile(r"'*[=+\-@\t\r]")
"""How a text begins that a spreadsheet would take for a formula, or that stands for such a text."""


def _quoted(text: str) -> str:
    """Return a text as it is written: with an apostrophe before what looks like a formula."""
    if not _FORMULA.match(text):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def _unquoted(text: str) -> str:
    return text[1:] if text.startswith("'") and _FORMULA.match(text) else text


def _data(path: Path) -> bytes:
    """Return the bytes of a table; raise DrlAvError if it is missing or unreadable."""
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise DrlAvError(f"There is no table {path}: check the path.") from error
    except OSError as error:
        raise DrlAvError(
            f"The table {path} cannot be read ({error.strerror or error}): check the path."
        ) from error
    if not data:
        raise DrlAvError(f"The table {path} is empty: {_REMEDY}.")
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DrlAvError(f"The table {path} is not UTF-8 text ({error}): {_REMEDY}.") from error
    return data


def _require_columns(path: Path, header: list[str], types: Mapping[str, Any]) -> None:
    """Raise DrlAvError unless the header contains each column of ``types`` exactly once."""
    for column in types:
        if header.count(column) != 1:
            found = "no column" if column not in header else "more than one column"
            raise DrlAvError(
                f"The table {path} has {found} {column!r}: "
                "name a table of another kind, or make this one again."
            )


def _row(
    place: str, header: list[str], cells: list[str], types: Mapping[str, Any]
) -> dict[str, Any]:
    """Convert the cells of the line ``place`` to typed values; raise DrlAvError if they misfit."""
    if len(cells) != len(header):
        raise DrlAvError(
            f"{place}: there are {len(cells)} values for {len(header)} columns: {_REMEDY}."
        )
    by_name, row = dict(zip(header, cells, strict=True)), dict[str, Any]()
    for name, kind in types.items():
        try:
            row[name] = parse_cell(by_name[name], kind)
        except ValueError as error:
            shown = by_name[name][:SHOWN]
            raise DrlAvError(
                f"{place}: {name} is {shown!r}, but must be {_KINDS[kind]}: {_REMEDY}."
            ) from error
    return row


def parse_cell(cell: str, kind: Any) -> Any:
    """Return the value of a cell, a str, int, bool or float; ``kind`` is the type of its column.

    ``kind`` is one of the types of ``read_table``. Raises ValueError if the cell is not of this
    type. NaN is never allowed, and inf is allowed only for PossiblyInfinite. A PlainNumber is at
    most ``LARGEST`` in absolute value.
    """
    value: Any
    if kind is bool:
        value = {"True": True, "False": False}.get(cell)
    elif kind is str:
        value = _unquoted(cell)
    elif kind is int:
        value = int(cell)
    else:
        number = float(cell)
        largest = {float: sys.float_info.max, PlainNumber: LARGEST}.get(kind, math.inf)
        value = number if abs(number) <= largest else None
    if value is None:
        raise ValueError(cell)
    return value
