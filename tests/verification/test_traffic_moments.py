"""The moments of traffic, by hand on a few vehicles, and of traffic that SUMO drives."""

import re
from pathlib import Path

import pytest
from programs import python
from worlds import CENTER, LEFT, RIGHT, ROAD, Car, snapshot

from verification.traffic_moments import Moments, following, mark

ROOT = Path(__file__).parents[2]


def test_a_vehicle_follows_the_next_one_of_its_lane_and_the_ego_is_no_follower() -> None:
    shot = snapshot(
        Car(40.0, CENTER, 22.0),  # the ego's leader; 65 m behind the next one
        Car(105.0, CENTER, 25.0, length_m=15.0),  # the next of its lane is the ego, 390 m on
        Car(-50.0, RIGHT, 20.0),
        Car(-10.0, RIGHT, 30.0),
        Car(20.0, LEFT, 30.0),  # alone in its lane
    )
    found = following(shot, ROAD)
    # 65 m from centre to centre less (5 + 15) / 2; 40 m less 5
    assert found.range_m.tolist() == pytest.approx([55.0, 35.0])
    assert found.time_gap_s.tolist() == pytest.approx([2.5, 1.75])
    assert found.relative_speed_m_s.tolist() == pytest.approx([3.0, 10.0])


def test_a_moment_is_marked_within_a_tenth_of_what_is_measured() -> None:
    assert mark("speed_m_s", 27.1) == "*"  # 30.05 less 10 % is 27.045
    assert mark("speed_m_s", 27.0) == " "
    assert mark("lane_changes_per_km", 0.13) == "*"


def test_the_command_prints_a_row_a_moment() -> None:
    words = ["--episodes", "1", "--vehicles", "10", "--traffic", "calm", "overtaking"]
    lines = python("-m", "verification.traffic_moments", *words, cwd=ROOT).stdout.splitlines()
    assert lines[0].split() == ["calm", "overtaking", "US", "naturalistic", "highD"]
    assert [line.split()[0] for line in lines[1:-1]] == list(Moments._fields)
    assert re.fullmatch(r" +speed_m_s +\d+\.\d\d[* ] +\d+\.\d\d[* ] +30\.05 +- ", lines[1])
