"""Writes the tables of README.md and docs/ again, from docs/results and from the code.

python tools/refresh_tables.py            rewrite the pages
python tools/refresh_tables.py --check    exit with 1 if a page and its sources differ

A page has a table between the lines ``<!-- table: NAME -->`` and ``<!-- end -->``. In prose,
``<!-- value: TABLE | ROW | COLUMN -->`` and ``<!-- end -->`` enclose a cell of a table: that of the
row that begins with ROW (several cells are separated by |) in the column with the heading COLUMN.
``mean`` in place of ``value`` leaves out the interval, ``mean.1`` also rounds to one digit.

A table whose sources have not changed is not computed again: ``docs/results/tables.sha256`` has
the checksums of the sources and of the text of each table.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from docs_pages import actions, observation

from studies.options import FOLDER, RESULTS
from studies.registry import STUDIES
from studies.results import markdown_table
from studies.study import FileStudy
from verification import crash_table, imported_nets, ramps, shielding_report, stories

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
LOCK = RESULTS / "tables.sha256"
CODE = ("pivot", "results", "study", "learning_curves", "adaptation", "barricade")
STATISTICS = [
    ROOT / f"drl_av/evaluation/{name}.py" for name in ("statistics", "aggregates", "figures")
]


class Table(NamedTuple):
    """A table of the documentation."""

    make: Callable[[], str]
    """Function that returns its text."""
    sources: Iterable[Path] = ()
    """All files on which the text depends; empty for a text that is made anew each time."""

    def checksum(self) -> str:
        """Return the checksum of the sources; empty if the table has none."""
        texts = [path.read_bytes() for path in self.sources]
        return _checksum(b"".join(sha256(text).digest() for text in texts)) if texts else ""


def _checksum(data: bytes) -> str:
    return sha256(data).hexdigest()[:32]


def study_table() -> str:
    """Return the Markdown table of the studies: command, meaning, row meaning, files."""
    lines = []
    for name, each in STUDIES.items():
        files = [f"{name}.csv", *each.derived, *(f"{figure}.png" for figure in each.figures)]
        shown = ", ".join(f"`{file}`" for file in files)
        lines.append([f"`python -m studies {name}`", each.meaning, each.row, shown])
    return markdown_table(["command", "what it holds", "a row", "files"], lines)


def read(name: str) -> str:
    """Return the text of a file of docs/results."""
    return (RESULTS / name).read_text(encoding="utf-8")


def printed(name: str) -> str:
    """Return the text of a file of docs/results as a Markdown code block.

    If the file does not exist, return a note instead.
    """
    if not (RESULTS / name).exists():
        return "*This has not been made yet.*"
    return f"```text\n{read(name).rstrip()}\n```"


def study_tables() -> dict[str, Table]:
    """Return the tables of all studies."""
    code = [FOLDER / f"{name}.py" for name in CODE]
    found = {}
    for name, study in STUDIES.items():
        specs = study.file.get("tables", {}) if isinstance(study, FileStudy) else {}
        for table, make in study.tables.items():
            names = [each["study"] for each in specs.get(table, {}).get("from", [])] or [name]
            files = [f"{source}.{kind}" for source in names for kind in ("csv", "json")]
            data = [RESULTS / file for file in (*files, *study.derived)]
            files = [FOLDER / f"{each}.toml" for each in dict.fromkeys((name, *names))]
            sources = [*code, *STATISTICS, *data, *(file for file in files if file.exists())]
            found[table] = Table(partial(make, RESULTS), sources)
    return found


TABLES: dict[str, Table] = {
    "observation": Table(observation),
    "actions": Table(actions),
    "studies": Table(study_table),
    "crash_rate": Table(lambda: crash_table.table(read("crash_rate.txt"))),
    "imported_nets": Table(
        lambda: imported_nets.table(
            {
                "now": read("imported_nets.txt"),
                "before it carried lines, limits and curves": read("imported_nets_before.txt"),
            }
        )
    ),
    "own_hits": Table(lambda: printed("own_hits.txt")),
    "speed_bound": Table(lambda: printed("speed_bound.txt")),
    "clairvoyant": Table(lambda: printed("clairvoyant.txt")),
    "ablation": Table(lambda: printed("ablation.txt")),
    "scale": Table(lambda: printed("scale.txt")),
    "sharper": Table(lambda: printed("sharper.txt")),
    "shielding": Table(lambda: shielding_report.section(RESULTS)),
    "stories": Table(lambda: stories.section(RESULTS)),
    **study_tables(),
}
LEARNED = [f"{kind}_learned" for kind in ramps.SUCCESS]
PAPER = [f"{kind}_paper" for kind in ramps.SUCCESS]
for _name in (*ramps.SUCCESS, *LEARNED, *PAPER):
    TABLES[_name] = Table(partial(lambda file: ramps.table(read(file)), f"{_name}.txt"))


def refreshed(page: str, known: Mapping[str, str], lock: dict[str, str]) -> str:
    """Return a page's text with new tables, and add what they were made of to ``lock``.

    ``known`` has the checksums of the tables' sources and texts, as in the file ``LOCK``.
    """

    def fresh(match: re.Match[str]) -> str:
        name, text = match[2], match[3]
        if name not in TABLES:
            raise SystemExit(f"There is no table {name!r}; the tables are: {', '.join(TABLES)}.")
        sources = TABLES[name].checksum()
        if not sources or known.get(name) != f"{sources} {_checksum(text.encode())}":
            text = f"{TABLES[name].make()}\n"
        lock[name] = f"{sources} {_checksum(text.encode())}" if sources else ""
        return f"{match[1]}{text}{match[4]}"

    marks = r"(<!-- table: (\w+) -->\n)(.*?)(<!-- end -->)"
    return re.sub(marks, fresh, page, flags=re.DOTALL)


def with_values(page: str, tables: Mapping[str, list[list[str]]]) -> str:
    """Return a page's text with the cells of tables in its prose.

    Raises SystemExit if a table, a row or a column does not exist.
    """

    def fresh(match: re.Match[str]) -> str:
        name, *row, column = (part.strip() for part in match[3].split("|"))
        heading, *lines = tables.get(name, [[]])
        found = [line for line in lines if [cell.strip("*`") for cell in line[: len(row)]] == row]
        if len(found) != 1 or column not in heading:
            raise SystemExit(f"No cell is {match[3].strip()!r}: name a table, its row and column.")
        cell = found[0][heading.index(column)].strip("*`")
        kind, _, digits = match[2].partition(".")
        cell = cell.partition(" ±")[0] if kind == "mean" else cell
        return f"{match[1]}{f'{float(cell):.{digits}f}' if digits else cell}{match[5]}"

    marks = r"(?<!`)(<!-- (value|mean|mean\.\d): ([^>]*?) -->)(.*?)(<!-- end -->)"
    return re.sub(marks, fresh, page, flags=re.DOTALL)


def cells_of(pages: Iterable[str]) -> dict[str, list[list[str]]]:
    """Return the cells of each Markdown table in the pages, by the table's name."""
    found = {}
    for page in pages:
        marks = r"<!-- table: (\w+) -->\n(\|.*?)<!-- end -->"
        for name, text in re.findall(marks, page, re.DOTALL):
            lines = [line.strip()[1:-1].split("|") for line in text.splitlines()]
            found[name] = [[cell.strip() for cell in line] for line in lines]
    return found


def main() -> int:
    """Rewrite the pages, or with --check compare them; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare only")
    check = parser.parse_args().check
    locked = LOCK.read_text(encoding="utf-8").splitlines() if LOCK.exists() else []
    known = dict(line.split(" ", 1) for line in locked)
    texts = {path: path.read_text(encoding="utf-8") for path in PAGES}
    lock: dict[str, str] = {}
    fresh = {path: refreshed(text, known, lock) for path, text in texts.items()}
    if missing := TABLES.keys() - lock.keys():
        raise SystemExit(f"No page has a place for the tables {', '.join(sorted(missing))}.")
    cells = cells_of(fresh.values())
    fresh = {path: with_values(text, cells) for path, text in fresh.items()}
    differ = [path for path in PAGES if fresh[path] != texts[path]]
    if check:
        for path in differ:
            print(f"{path.relative_to(ROOT)} differs from its sources: run {Path(__file__).name}")
        return int(bool(differ))
    for path in differ:
        path.write_text(fresh[path], encoding="utf-8")
    lines = [f"{name} {sums}\n" for name, sums in sorted(lock.items()) if sums]
    LOCK.write_text("".join(lines), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
