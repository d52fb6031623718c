"""Writes the tables of README.md and docs/ again, from docs/results and from the code.

python tools/refresh_tables.py            rewrite the pages
python tools/refresh_tables.py --check    exit with 1 if a page and its sources differ

A page has a table between the lines ``<!-- table: NAME -->`` and ``<!-- end -->``, and a number of
its text between ``<!--=NAME-->`` and ``<!--/-->``.
"""

import argparse
import re
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from statistics import fmean

from docs_pages import actions, observation

from studies.experiment import ResultsFolder
from studies.markdown import markdown_table
from studies.registry import EXPERIMENTS
from verification import crash_rate, ramps, shielding_report, stories, time_to_quality

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "results"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


def experiment_table(results: ResultsFolder) -> str:
    """Return the Markdown table of the experiments: command, meaning, row meaning, files."""
    lines = []
    for name, each in EXPERIMENTS.items():
        files = [each.table, *each.derived, *(f"{figure}.png" for figure in each.figures)]
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


TABLES: dict[str, Callable[[ResultsFolder], str]] = {
    "observation": lambda results: observation(),
    "actions": lambda results: actions(),
    "experiments": experiment_table,
    "crash_rate": lambda results: crash_rate.table(read("crash_rate.txt")),
    "own_hits": lambda results: printed("own_hits.txt"),
    "speed_bound": lambda results: printed("speed_bound.txt"),
    "clairvoyant": lambda results: printed("clairvoyant.txt"),
    "sharper": lambda results: printed("sharper.txt"),
    "shielding": shielding_report.section,
    "stories": stories.section,
    "time_to_quality": time_to_quality.section,
} | {name: table for each in EXPERIMENTS.values() for name, table in each.summaries.items()}


LEARNED = [f"{kind}_learned" for kind in ramps.SUCCESS]
PAPER = [f"{kind}_paper" for kind in ramps.SUCCESS]
for name in (*ramps.SUCCESS, *LEARNED, "merge_planner", *PAPER):
    TABLES[name] = partial(lambda file, results: ramps.table(read(file)), f"{name}.txt")


def mean_reward(table: str, results: ResultsFolder) -> str:
    """Return the shipped driver's mean reward in a table's rows, up to 30 vehicles."""
    rows = [
        float(row["mean_reward"])
        for row in results.rows(table)
        if row["driver"] == "pretrained" and int(row["vehicles"]) <= 30
    ]
    return f"{fmean(rows):.3f}"


def hits(table: str, where: Mapping[str, str], results: ResultsFolder) -> str:
    """Return in how many of a table's episodes the ego hit something, as "2 of 6,300".

    Only rows count whose columns ``where`` begin with the given texts.
    """
    rows = [
        row["ego_hit"] == "True"
        for row in results.rows(table)
        if all(row[column].startswith(text) for column, text in where.items())
    ]
    return f"{sum(rows)} of {len(rows):,}"


VALUES: dict[str, Callable[[ResultsFolder], str]] = {
    "reward": partial(mean_reward, "density_sweep.csv"),
    "exact_reward": partial(mean_reward, "exact_speed.csv"),
    "trained_hits": partial(hits, "final_policies.csv", {"training": "paper-"}),
    "unchecked_hits": partial(hits, "final_policies.csv", {"training": "permit_all-"}),
    "paper_hits": partial(hits, "opponents.csv", {"variant": "paper", "driver": "pretrained"}),
    "strict_hits": partial(hits, "opponents.csv", {"variant": "strict"}),
    "smooth_hits": partial(hits, "opponents.csv", {"variant": "smooth"}),
    "planner_hits": partial(hits, "opponents.csv", {"variant": "search", "safety_check": "strict"}),
}
"""The numbers in the text of the pages, by name."""


def refreshed(page: str, shown: set[str]) -> str:
    """Return a page's text with new tables and numbers; add the tables' names to ``shown``."""

    def fresh(match: re.Match[str]) -> str:
        name = match[2]
        shown.add(name)
        if name not in TABLES:
            raise SystemExit(f"There is no table {name!r}; the tables are: {', '.join(TABLES)}.")
        return f"{match[1]}{TABLES[name](ResultsFolder(RESULTS))}\n{match[3]}"

    def value(match: re.Match[str]) -> str:
        return f"{match[1]}{VALUES[match[2]](ResultsFolder(RESULTS))}{match[3]}"

    marks = r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)"
    page = re.sub(marks, fresh, page, flags=re.DOTALL)
    return re.sub(r"(<!--=(\w+)-->).*?(<!--/-->)", value, page)


def main() -> int:
    """Rewrite the pages, or with --check compare them; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare only")
    check, shown, differ = parser.parse_args().check, set[str](), False
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        fresh = refreshed(text, shown)
        differ |= fresh != text
        if not check and fresh != text:
            path.write_text(fresh, encoding="utf-8")
    if missing := TABLES.keys() - shown:
        raise SystemExit(f"No page has a place for the tables {', '.join(sorted(missing))}.")
    return int(check and differ)


if __name__ == "__main__":
    sys.exit(main())
