"""The table of every driver through the stories that ship."""

from pathlib import Path

import pytest

from drl_av.evaluation.table import read_rows
from drl_av.scenarios.folder import shipped_scenarios
from verification import stories

RESULT = Path(__file__).parents[2] / "docs" / "results" / "stories.csv"


def test_the_committed_table_has_every_story_driver_and_check_once() -> None:
    rows = read_rows(RESULT)
    found = [(row["story"], row["driver"], row["safety_check"]) for row in rows]
    asked = {(s, d, c) for s in stories.STORIES for d in stories.DRIVERS for c in stories.CHECKS}
    asked |= {
        (story, driver, "none") for story in stories.STORIES for driver in ("sumo", "sumo-tuned")
    }
    assert sorted(found) == sorted(asked)
    assert set(stories.STORIES) <= set(shipped_scenarios())


def test_idm_without_a_check_hits_the_stalled_vehicle_and_under_strict_stops_behind_it() -> None:
    [blind] = stories.drive("stalled_vehicle", ["idm"], "permit_all")
    assert blind["collision"] == "ego hit the vehicle ahead"
    [checked] = stories.drive("stalled_vehicle", ["idm"], "strict")
    assert (checked["collision"], checked["decisions"]) == ("", 60)
    kept_rows = read_rows(RESULT)
    rows = {(r["driver"], r["safety_check"], r["story"]): r for r in kept_rows}
    for made in (blind, checked):
        kept = rows["idm", made["safety_check"], "stalled_vehicle"]
        assert {name: str(value) for name, value in made.items()} == kept


def test_a_cell_tells_the_speed_or_the_collision_and_its_time() -> None:
    row = {"story": "cut_in", "driver": "idm", "safety_check": "strict", "mean_speed_m_s": "21.96"}
    fine = row | {"decisions": "40", "collision": ""}
    hit = row | {"decisions": "8", "collision": "ego was hit", "safety_check": "paper"}
    lines = stories.table([fine, hit]).splitlines()
    place = 1 + 2 + stories.STORIES.index("cut_in")
    cells = [line.split("|")[place].strip() for line in lines[2:]]
    assert cells == ["ego was hit, 8 s", "22.0 m/s"]


@pytest.mark.parametrize("name", stories.STORIES)
def test_the_page_shows_a_picture_of_each_story(name: str) -> None:
    docs = RESULT.parents[1]
    assert (docs / "assets" / "stories" / f"{name}.png").is_file()
    assert f"**`{name}`**" in (docs / "stories.md").read_text(encoding="utf-8")
