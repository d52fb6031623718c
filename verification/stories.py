"""Drives several drivers through each story that ships with drl-av, under each check.

    python -m verification.stories --out docs/results/stories.csv

A story fixes the start of every vehicle, and no vehicle changes lanes at random. An episode
therefore does not depend on its seed, and each driver drives one episode of each story under each
check. The episode ends at the end of the road, with a collision of the ego, or after a minute.
SUMO's own drivers drive each story once, without a check.
"""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

from drl_av.config import Config
from drl_av.evaluation.evaluate import evaluate
from drl_av.evaluation.provenance import provenance, write_provenance
from drl_av.evaluation.table import read_rows
from drl_av.files.atomic import require_writable
from drl_av.files.table import Row, write_table
from studies.results import markdown_table
from verification.program import Program, run_program

STORIES = (
    *("stalled_vehicle", "barricade", "lane_drop"),
    *("cut_in", "fast_overtaker", "two_into_one_lane"),
)
DRIVERS = ("idm", "idm-mobil", "gap-mobil", "pretrained")
SUMO_DRIVERS = ("sumo", "sumo-tuned")
CHECKS = ("permit_all", "paper", "strict")
SETTINGS: dict[str, dict[str, Any]] = {
    "simulation": {"decisions_per_episode": 60},
    "traffic": {"kind": "calm", "random_lane_changes_per_s": 0.0},
}
COLUMNS = (
    *("story", "driver", "safety_check", "decisions", "mean_speed_m_s", "collision"),
    *("safety_triggers", "min_ttc_s"),
)


def drive(story: str, drivers: Sequence[str], check: str) -> list[dict[str, Any]]:
    """Drive one episode of a story with each driver, and return their rows of the table."""
    rows = []
    for result in evaluate(
        drivers, episodes=1, config=SETTINGS, scenario=story, safety_check=check
    ):
        found = {name: getattr(result, name) for name in COLUMNS[1:]}
        rounded = {name: round(found[name], 2) for name in ("mean_speed_m_s", "min_ttc_s")}
        rows.append({"story": story} | found | rounded)
    return rows


def table(rows: Sequence[Row]) -> str:
    """Return the Markdown table: a row for each driver and check, a column for each story.

    A cell holds the ego's mean speed, or the kind and the time, s, of its collision.
    """
    cells = {(each["driver"], each["safety_check"], each["story"]): cell(each) for each in rows}
    lines = [
        [f"`{driver}`", f"`{check}`", *(cells.get((driver, check, story), "") for story in STORIES)]
        for driver, check in product((*DRIVERS, *SUMO_DRIVERS), (*CHECKS, "none"))
        if any(key[:2] == (driver, check) for key in cells)
    ]
    return markdown_table(["driver", "check", *(f"`{story}`" for story in STORIES)], lines)


def cell(each: Row) -> str:
    """Return the text of an episode's cell."""
    if each["collision"]:
        return f"{each['collision']}, {each['decisions']} s"
    return f"{float(each['mean_speed_m_s']):.1f} m/s"


def section(folder: Path) -> str:
    """Return the table of ``stories.csv`` as Markdown."""
    return table(read_rows(folder / "stories.csv"))


def main() -> None:
    """Drive all stories, and write the table."""
    parser = Program(__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.csv")
    options = parser.parse_args()
    require_writable(options.out)
    rows = []
    for story in STORIES:
        for check in CHECKS:
            rows += drive(story, DRIVERS, check)
        rows += drive(story, SUMO_DRIVERS, CHECKS[0])
    write_provenance(options.out, provenance(Config(), settings=SETTINGS))
    write_table(options.out, COLUMNS, rows)


if __name__ == "__main__":
    run_program(main)
