"""CSV tables: written with every digit, read by type, and each fault reported in one sentence."""

import math
import re
import resource
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drl_av.errors import DrlAvError
from drl_av.files.table import (
    PlainNumber,
    PossiblyInfinite,
    append_rows,
    column_types,
    read_table,
    table_bytes,
    write_table,
)


@dataclass(frozen=True)
class Drive:
    driver: str
    vehicles: int
    speed_m_s: float
    collided: bool
    min_ttc_s: PossiblyInfinite


FIRST = Drive("idm", 5, 0.1 + 0.2, True, math.inf)
SECOND = Drive('a "quoted", name\nof two lines', -1, 1e-300, False, 4.5)
HEADER = "driver,vehicles,speed_m_s,collided,min_ttc_s\n"
LINE = "idm,5,20.5,True,inf\n"


class Pair(NamedTuple):
    name: str
    value: float


def table(folder: Path, text: str | bytes) -> Path:
    path = folder / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read_rows(path: Path, row_type: type[Any], *, growing: bool = False) -> list[Any]:
    """The rows as objects of a class whose fields are the columns."""
    return [row_type(**row) for row in read_table(path, column_types(row_type), growing=growing)]


def test_rows_are_read_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    write_table(path, Drive, [FIRST, SECOND])
    assert path.read_text().startswith(HEADER + "idm,5,0.30000000000000004,True,inf\n")
    assert read_rows(path, Drive) == [FIRST, SECOND]


def test_rows_may_be_named_tuples_and_mappings_too(tmp_path: Path) -> None:
    write_table(tmp_path / "table.csv", Pair, [Pair("a", 1.5), {"name": "b", "value": 2.0}])
    assert read_rows(tmp_path / "table.csv", Pair) == [Pair("a", 1.5), Pair("b", 2.0)]
    assert table_bytes(["value", "name"], [Pair("a", 1.5)]) == b"value,name\n1.5,a\n"
    assert table_bytes(Pair) == b"name,value\n"
    assert table_bytes(Pair, [Pair("a", 1.5)], header=False) == b"a,1.5\n"
    with pytest.raises(ValueError, match="value"):
        table_bytes(["name"], [Pair("a", 1.5)])


@given(
    st.lists(
        st.builds(
            Drive,
            driver=st.text(st.characters(exclude_categories=["Cs", "Cc"])),
            vehicles=st.integers(),
            speed_m_s=st.floats(allow_nan=False, allow_infinity=False),
            min_ttc_s=st.floats(allow_nan=False),
        ),
        min_size=1,
    )
)
def test_whatever_is_written_is_read_again(
    tmp_path_factory: pytest.TempPathFactory, rows: list[Drive]
) -> None:
    path = tmp_path_factory.mktemp("table") / "table.csv"
    write_table(path, Drive, rows)
    assert read_rows(path, Drive) == rows


def test_a_reader_asks_for_the_columns_that_it_needs(tmp_path: Path) -> None:
    path = table(tmp_path, HEADER + LINE)
    assert read_table(path, {"vehicles": int, "driver": str}) == [{"vehicles": 5, "driver": "idm"}]
    names, cells = (line.strip().split(",") for line in (HEADER, LINE))
    assert read_table(path) == [dict(zip(names, cells, strict=True))]


def test_a_byte_order_mark_and_the_line_ends_of_a_spreadsheet_are_accepted(tmp_path: Path) -> None:
    text = (HEADER + LINE).replace("\n", "\r\n").encode()
    [row] = read_rows(table(tmp_path, b"\xef\xbb\xbf" + text), Drive)
    assert (row.driver, row.min_ttc_s) == ("idm", math.inf)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty"),
        (HEADER, "has no rows"),
        (HEADER.replace(",collided", ""), "has no rows"),
        ("driver,vehicles\nidm,5\n", "has no column 'speed_m_s'"),
        (HEADER.replace("collided", "vehicles") + LINE, "more than one column 'vehicles'"),
        (HEADER + LINE + LINE[:-6], "line 3 is cut short"),
        (HEADER + LINE.strip(), "line 2 is cut short"),
        (HEADER + LINE + "idm,5\n", "line 3: there are 2 values for 5 columns"),
        (HEADER + "idm,5,20.5,True,inf,x\n", "line 2: there are 6 values for 5 columns"),
        (HEADER + "idm,five,20.5,True,inf\n", "line 2: vehicles is 'five', but must be a whole"),
        (HEADER + "idm,5.0,20.5,True,inf\n", "line 2: vehicles is '5.0', but must be a whole"),
        (HEADER + "idm,5,fast,True,inf\n", "speed_m_s is 'fast', but must be a finite number"),
        (HEADER + "idm,5,nan,True,inf\n", "speed_m_s is 'nan', but must be a finite number"),
        (HEADER + "idm,5,inf,True,inf\n", "speed_m_s is 'inf', but must be a finite number"),
        (HEADER + "idm,5,1e999,True,inf\n", "speed_m_s is '1e999', but must be a finite number"),
        (HEADER + "idm,5,,True,inf\n", "speed_m_s is '', but must be a finite number"),
        (HEADER + "idm,5,20.5,yes,inf\n", "collided is 'yes', but must be True or False"),
        (HEADER + "idm,5,20.5,True,nan\n", "min_ttc_s is 'nan', but must be a number or inf"),
        (HEADER + '"idm,5,20.5,True,inf\n', "line 2 is damaged (unexpected end of data)"),
        (b"\xff\xfe\x00", "is not UTF-8 text"),
    ],
)
def test_each_fault_of_a_table_is_reported_in_one_sentence(
    tmp_path: Path, text: str | bytes, sentence: str
) -> None:
    path = table(tmp_path, text)
    with pytest.raises(DrlAvError, match=re.escape(sentence)) as message:
        read_rows(path, Drive)
    assert str(path) in str(message.value)
    assert re.search(r": (put|name) .*\.$", str(message.value))
    assert "\n" not in str(message.value)


@pytest.mark.parametrize("number", ["1e308", "-1e308", "1000000001", "inf", "9" * 400])
def test_a_number_that_is_drawn_is_at_most_a_billion(tmp_path: Path, number: str) -> None:
    path = table(tmp_path, f"speed_m_s\n{number}\n")
    with pytest.raises(DrlAvError, match=r"line 2: speed_m_s is .*a finite number, at most 1e9"):
        read_table(path, {"speed_m_s": PlainNumber})
    table(tmp_path, "speed_m_s\n-1e9\n")
    assert read_table(path, {"speed_m_s": PlainNumber}) == [{"speed_m_s": -1e9}]


def test_a_huge_cell_is_refused_in_a_short_sentence(tmp_path: Path) -> None:
    for cell, sentence in (("x" * 100_000, "must be a whole number"), ("x" * 10**7, "field limit")):
        with pytest.raises(DrlAvError, match=sentence) as message:
            read_rows(table(tmp_path, HEADER + LINE.replace("5", cell)), Drive)
        assert len(str(message.value)) < 400 + len(str(tmp_path))


def test_a_table_that_is_missing_or_no_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DrlAvError, match=r"There is no table .*none\.csv: check the path\.$"):
        read_rows(tmp_path / "none.csv", Drive)
    with pytest.raises(DrlAvError, match=r"cannot be read \(Is a directory\): check the path\.$"):
        read_rows(tmp_path, Drive)


def test_a_growing_table_has_the_rows_that_are_complete(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    assert read_rows(path, Drive, growing=True) == []
    for text in ("", HEADER[:5], HEADER):
        assert read_rows(table(tmp_path, text), Drive, growing=True) == []
    whole = Drive("idm", 5, 20.5, True, math.inf)
    for text in (LINE, LINE + LINE[:9], LINE + LINE[:-1]):
        assert read_rows(table(tmp_path, HEADER + text), Drive, growing=True) == [whole]
    with pytest.raises(DrlAvError, match="line 2: there are 2 values"):
        read_rows(table(tmp_path, HEADER + "idm,5\n" + LINE), Drive, growing=True)


def test_appended_rows_follow_those_that_are_there(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    append_rows(path, Drive, [FIRST])
    append_rows(path, Drive, [SECOND])
    assert path.read_bytes() == table_bytes(Drive, [FIRST, SECOND])
    for cut in (2, len(table_bytes(Drive)) + 3, len(table_bytes(Drive, [FIRST])) - 1):
        path.write_bytes(table_bytes(Drive, [FIRST])[:cut])
        append_rows(path, Drive, [SECOND])  # after a process that was killed
        assert path.read_bytes() == table_bytes(Drive, [SECOND])
    with pytest.raises(DrlAvError, match="gone/x cannot be written"):
        append_rows(tmp_path / "gone" / "x", Drive, [FIRST])
    held, (soft, hard) = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(held) + len(LINE) + 9, hard))
    with pytest.raises(DrlAvError, match="what was there before is unchanged"):
        append_rows(path, Drive, 3 * [FIRST])  # for two of which there is no room
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == held


def test_a_formula_in_a_text_is_written_harmlessly_and_read_back(tmp_path: Path) -> None:
    formulas, escaped = ("=1+1", "+cmd", "-2+3", "@SUM(A1)", "\tx"), ("'=1", "''@", "'quoted'")
    names = [*formulas, *escaped, "idm", "-", "-0.5"]
    write_table(tmp_path / "t.csv", ["driver"], [{"driver": name} for name in names])
    cells = [line.split(",")[0].strip('"') for line in (tmp_path / "t.csv").read_text().split("\n")]
    assert not [cell for cell in cells if cell[:1] in {*"=+-@\t"} and cell != "-0.5"]
    assert [row["driver"] for row in read_table(tmp_path / "t.csv", {"driver": str})] == names
