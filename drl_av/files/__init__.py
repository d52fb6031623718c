"""Functions that write files atomically, and that read and write CSV tables."""

from drl_av.files.atomic import (
    make_folder,
    replacing,
    require_suffix,
    require_writable,
    write_atomic,
)
from drl_av.files.table import (
    LARGEST,
    SHOWN,
    PlainNumber,
    PossiblyInfinite,
    Row,
    append_rows,
    column_types,
    parse_cell,
    read_table,
    table_bytes,
    write_table,
)

__all__ = [
    "LARGEST",
    "SHOWN",
    "PlainNumber",
    "PossiblyInfinite",
    "Row",
    "append_rows",
    "column_types",
    "make_folder",
    "parse_cell",
    "read_table",
    "replacing",
    "require_suffix",
    "require_writable",
    "table_bytes",
    "write_atomic",
    "write_table",
]
