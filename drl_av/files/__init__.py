"""Functions that write files atomically, and that read and write CSV tables."""

from drl_av.files.table import (
    LARGEST,
    PlainNumber,
    PossiblyInfinite,
    Row,
    append_rows,
    column_types,
    read_rows,
    read_table,
    table_bytes,
    write_table,
)
from drl_av.files.whole import append, replacing, require_suffix, require_writable, write_whole

__all__ = [
    "LARGEST",
    "PlainNumber",
    "PossiblyInfinite",
    "Row",
    "append",
    "append_rows",
    "column_types",
    "read_rows",
    "read_table",
    "replacing",
    "require_suffix",
    "require_writable",
    "table_bytes",
    "write_table",
    "write_whole",
]
