"""The page of an episode plays in a real browser, from one file."""

import html
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from worlds import LEFT, ROAD, Car, ahead, snapshot

from drl_av.drawing.canvas import EGO_COLOR
from drl_av.drawing.page import PageEpisode, write_page

RED = (255, 92, 108)
NAMES = "proposed", "executed", "rule", "reward", "r_v", "r_y", "r_x"
KEEP = dict(zip(NAMES, (0, 0, "none", -0.1, -0.2, -0.1, 0.0), strict=True))
KEEP |= {"values": [float(n) for n in range(12)], "changes_lane": False, "collision": None}
HIT = {"values": None, "collision": "ego hit the vehicle </script>"}
BRAKE = KEEP | dict(zip(NAMES, (1, 3, "in_lane", -3.0, -0.5, 0.0, -1.0), strict=True)) | HIT


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """Two decisions: the ego follows a vehicle 20 m ahead, and one drives in the left lane."""
    shots = [
        snapshot(ahead(20.0), Car(-10.0, LEFT), s_m=s_m, time_s=30.0 + k)
        for k, s_m in enumerate((480.0, 500.0, 20.0))
    ]
    episode = PageEpisode("a <story>", snapshots=shots, decisions=[KEEP, BRAKE])
    write_page(tmp_path / "page.html", ROAD, [episode])
    return tmp_path / "page.html"


def browser(page: Path, moment_s: float | str, *options: str) -> str:
    """What headless Chromium prints of the page at a moment of the episode."""
    program = shutil.which("chromium")
    if program is None:
        pytest.fail("chromium is missing: install it with apt-get install chromium.", pytrace=False)
    quiet = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    quiet += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    profile = f"--user-data-dir={page.parent / 'profile'}"
    command = [program, *quiet, profile, *options, f"{page.as_uri()}#t={moment_s}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=1200)
    return done.stdout


def picture_of(page: Path, moment_s: float) -> Image.Image:
    """What the browser shows of the page, at a width of 1200."""
    picture = page.with_name("page.png")
    browser(page, moment_s, "--window-size=1200,760", f"--screenshot={picture}")
    return Image.open(picture).convert("RGB")


def test_the_page_shows_the_decision_of_the_moment(page: Path) -> None:
    shown = browser(page, 0.5, "--dump-dom")
    assert "<title>a &lt;story&gt;</title>" in shown
    assert "0.5 s of 2 s" in shown
    assert re.search(r"proposed</td><td>maintain, keep lane", shown)
    assert re.search(r"<tr class=\"chosen\"><td>maintain, keep lane</td>.*?0\.000", shown)
    assert "hard brake, change left" in shown


def test_a_rule_and_a_collision_are_shown_and_text_cannot_end_the_script(page: Path) -> None:
    shown = browser(page, 2.0, "--dump-dom")
    assert re.search(r"alarm\"><td>executed</td><td>hard brake, keep lane", shown)
    assert "ego hit the vehicle &lt;/script&gt;" in shown
    assert "not shown for this driver" in shown


def test_the_facts_and_the_events_are_on_the_page(page: Path) -> None:
    shots = [snapshot(ahead(20.0), s_m=100.0 + 20 * k, time_s=k) for k in range(21)]
    decisions = [BRAKE if k == 9 else KEEP for k in range(20)]
    facts = "safety check: strict"
    write_page(page, ROAD, [PageEpisode("drive", facts, "Q-values", shots, decisions)])
    assert 'class="facts">safety check: strict<' in browser(page, 0.0, "--dump-dom")
    image = picture_of(page, 0.0)
    ticks = ((x, y) for x in range(80, 880) for y in (288, 294, 300, 306, 312))
    red = [place[0] for place in ticks if image.getpixel(place) == RED]
    assert red, "the collision has no tick above the time bar"
    assert 440 < sum(red) / len(red) < 520  # half of the bar, at 10 of 20 s


def test_the_ego_is_drawn_in_its_colour_in_the_middle_of_the_road(page: Path) -> None:
    image = picture_of(page, 1.5)
    pink = [x for x in range(1200) if image.getpixel((x, 147)) == EGO_COLOR]
    assert 590 <= sum(pink) / len(pink) <= 610
    assert 25 <= len(pink) <= 35  # 5 m of the 200 m that are in view


def test_the_page_is_one_file_that_names_no_other(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"https?://|src=|href=|@import|url\(", text)
    [data] = re.findall(r'type="application/json">(.*?)</script>', text, flags=re.S)
    assert json.loads(data)["episodes"][0]["frames"][0]["s"] == [480.0, 5.0, 470.0]


def test_two_episodes_share_the_time_bar_and_the_one_that_ended_says_when(page: Path) -> None:
    whole = [snapshot(ahead(20.0), s_m=480.0 + 20 * k, time_s=k) for k in range(6)]
    slow = [snapshot(ahead(20.0), s_m=480.0 + 10 * k, speed_m_s=10.0, time_s=k) for k in range(4)]
    one = PageEpisode("whole", "under strict", "Probabilities", whole, [KEEP] * 5)
    other = PageEpisode("short", snapshots=slow, decisions=[KEEP, KEEP, BRAKE])
    write_page(page, ROAD, [one, other])
    shown = browser(page, 4.0, "--dump-dom")
    assert "<title>whole beside short</title>" in shown
    assert "4.0 s of 5 s" in shown
    assert "20.0 m/s; so far 80 m<" in shown  # over the end of the loop of 500 m
    assert "10.0 m/s; so far 30 m; ended at 3 s<" in shown
    assert re.search(r"of whole<.*Probabilities<.*of short<.*not shown for this dr", shown, re.S)
    assert shown.count('class="events"') == 2


def test_a_collision_after_half_a_decision_is_shown_when_it_happens(page: Path) -> None:
    shots = [snapshot(ahead(30.0 - 10 * t), s_m=100.0 + 20 * t, time_s=t) for t in (0.0, 1.0, 1.5)]
    write_page(page, ROAD, [PageEpisode("hit", snapshots=shots, decisions=[KEEP, BRAKE])])
    shown = browser(page, 1.5, "--dump-dom")
    assert "1.5 s of 1.5 s" in shown
    assert "so far 30 m<" in shown
    assert "ego hit the vehicle" in shown
    assert "so far 20 m<" in browser(page, 1.2, "--dump-dom")
    for nonsense in ("-5", "abc"):  # the beginning, not an empty page
        assert "0.0 s of 1.5 s" in browser(page, nonsense, "--dump-dom")
    shots[2] = shots[1]  # a decision of no duration
    write_page(page, ROAD, [PageEpisode("hit", snapshots=shots, decisions=[KEEP, BRAKE])])
    assert "<td>collision</td><td>ego hit the veh" in browser(page, 1.0, "--dump-dom")


def test_on_a_short_loop_the_road_goes_on_and_a_vehicle_is_seen_a_lap_away(page: Path) -> None:
    loop = replace(ROAD, lap_m=80.0)
    shots = [snapshot(ahead(40.0), s_m=20.0, time_s=t, road=loop) for t in (0.0, 1.0)]
    write_page(page, loop, [PageEpisode("tiny", snapshots=shots, decisions=[KEEP])])
    image = picture_of(page, 0.0)
    line = [image.getpixel((x, 147)) for x in range(25, 1175)]
    assert line.count(EGO_COLOR) > 2 * 25  # it sees itself 80 m ahead and behind
    assert line.count((0x1D, 0x23, 0x2A)) == 0  # asphalt all along, no empty ground


def test_ten_lanes_and_their_ring_are_on_the_page(page: Path) -> None:
    wide = replace(ROAD, open_lanes=(True,) * 10)
    shots = [
        snapshot(Car(40.0, 0.0), y_m=9 * wide.lane_width_m, time_s=t, road=wide) for t in (0.0, 1.0)
    ]
    write_page(page, wide, [PageEpisode("wide", snapshots=shots, decisions=[KEEP])])
    assert "1.0 s of 1 s" in browser(page, 1.0, "--dump-dom")
    image = picture_of(page, 1.0)
    assert [image.getpixel((600, y)) for y in range(60, 240)].count(EGO_COLOR) > 5


def test_on_a_phone_the_page_is_not_wider_than_the_screen(page: Path) -> None:
    frame, text = page.with_name("phone.html"), html.escape(page.read_text(encoding="utf-8"))
    script = "const d = f.contentDocument.documentElement; document.title = d.scrollWidth"
    frame.write_text(
        f"<iframe id=f width=360 height=700 srcdoc='{text}'></iframe>"
        f"<script>onload = () => {{ {script} - d.clientWidth }}</script>",
        encoding="utf-8",
    )
    assert "<title>0</title>" in browser(frame, 0.0, "--dump-dom")
