"""Functions that write files atomically, and that read and write CSV tables."""

from drl_av.files.atomic import (
    files_digest,
    make_folder,
    replacing,
    require_suffix,
    require_writable,
    write_atomic,
)
from drl_av.files.locks import hold, locked
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
    "files_digest",
    "hold",
    "locked",
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
