"""The columns of comfort and criticality over decisions that are made by hand."""

import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from decisions import decided
from runs import Capsys
from worlds import CENTER, MERGE, ROAD, Car, ahead, behind, scene

import drl_av
from drl_av.cli import main
from drl_av.drawing.panels import Caption
from drl_av.driving.scene import LaneChange, Scene
from drl_av.env.metrics import EpisodeMetrics
from drl_av.evaluation.criticality import CriticalityMetrics, CriticalityResult, styles
from drl_av.evaluation.replay import critical_picture

CHANGE = LaneChange(0, 1)


def at(time_s: float, given: Scene) -> Scene:
    return replace(given, snapshot=given.snapshot._replace(time_s=time_s))


def watched(*scenes: Scene) -> CriticalityMetrics:
    """The metrics of an episode with a scene each second, the first after the reset."""
    metrics = CriticalityMetrics()
    timed = [at(float(second), each) for second, each in enumerate(scenes)]
    for before, after in pairwise(timed):
        metrics.add(decided(before, after))
    return metrics


def measured(*scenes: Scene) -> CriticalityResult:
    """Its row."""
    return watched(*scenes).result("mine", "paper", 1, 0)


def speeds(*values_m_s: float) -> list[Scene]:
    return [
        scene(s_m=s_m, speed_m_s=v)
        for s_m, v in zip(np.cumsum([0.0, *values_m_s[1:]]) % 500, values_m_s, strict=True)
    ]


def test_jerk_is_the_change_of_acceleration_and_the_first_decision_has_none() -> None:
    row = measured(*speeds(20.0, 22.0, 22.0, 18.0, 14.0))  # 2, 0, -4, -4 m/s^2
    assert row.max_abs_jerk_m_s3 == 4.0
    assert row.mean_abs_jerk_m_s3 == (2 + 4) / 4
    assert row.comfortable_decisions == 4
    assert row.driven_m == 22 + 22 + 18 + 14
    assert measured(*speeds(20.0, 22.0, 18.0)).comfortable_decisions == 1  # -6 m/s^3


def test_lateral_acceleration_and_yaw_are_those_of_the_lateral_speed() -> None:
    row = measured(scene(), scene(v_y=0.76, y_m=CENTER + 0.76), scene(y_m=CENTER + 1))
    assert row.max_abs_lateral_acceleration_m_s2 == pytest.approx(0.76)
    assert row.comfortable_decisions == 2
    # at walking pace the same lateral speed turns the direction by 65 degrees in a second
    slow = measured(scene(speed_m_s=0.35), scene(speed_m_s=0.35, v_y=0.76, y_m=CENTER + 0.76))
    assert slow.comfortable_decisions == 0


def test_a_decision_in_which_the_ego_leaves_the_lanes_at_once_has_no_motion() -> None:
    metrics, here = CriticalityMetrics(), scene(speed_m_s=20.0)
    metrics.add(decided(here, reward=-3.0, terminated=True))
    found = metrics.result("mine", "paper", 1, 0)
    assert (found.driven_m, found.mean_abs_jerk_m_s3, found.comfortable_decisions) == (0, 0, 0)
    assert found.decisions == 1


def test_maintaining_between_does_not_hide_a_reversal() -> None:
    row = measured(*speeds(20.0, 22.0, 22.1, 20.1, 18.1, 18.1, 20.1, 22.1))
    assert row.reversals == 2  # up, a trifle, down, down, none, up, up


def test_the_time_below_three_seconds_to_a_collision_is_exposed() -> None:
    looks = [  # TTC 4, 3, 2.5 and none, for it is faster
        scene(ahead(20.0, speed_m_s=15.0)),
        scene(ahead(15.0, speed_m_s=15.0)),
        scene(ahead(12.5, speed_m_s=15.0)),
        scene(ahead(7.5, speed_m_s=21.0)),
    ]
    row = measured(scene(ahead(1.0, speed_m_s=0.0)), *looks)  # the reset's scene does not count
    assert (row.tet_s, row.tit_s2) == (2.0, 0.5)
    assert row.max_drac_m_s2 == 25 / (2 * 12.5)
    assert row.min_ttc_s == 2.5


def test_neither_the_end_of_a_lane_nor_who_drives_beside_the_ego_is_a_vehicle_ahead() -> None:
    ending = scene(road=MERGE, s_m=780.0, y_m=0.0)  # 17.5 m before it
    leans_over = scene(Car(2.0, CENTER + 1.9, 15.0))  # 0.9 m of its body in the ego's lane
    for look, ttc_s in ((ending, 17.5 / 20), (leans_over, math.inf)):
        row = measured(scene(), look)
        assert (row.tet_s, row.max_drac_m_s2, row.short_headways) == (0.0, 0.0, 0)
        assert (row.min_ttc_s, row.min_headway_s) == (ttc_s, ttc_s)
    assert measured(scene(), scene(Car(2.0, CENTER + 1.7, 15.0))).min_ttc_s == 0.0
    near, beside = (decided(scene(), look) for look in (scene(ahead(10, speed_m_s=15)), leans_over))
    drawn, alone = (critical_picture(made, Caption(), ROAD) for made in ([near, beside], [near]))
    assert np.array_equal(drawn, alone)


@pytest.mark.parametrize(
    ("gap_m", "speed_m_s", "short"),
    [
        (19.9, 20.0, 1),
        (20.0, 20.0, 0),  # a second exactly
        (20.1, 20.0, 0),
        (5.0, 5.1, 1),
        (5.2, 5.1, 0),
        (21.9, 22.0, 1),  # at the speed afterwards, not at 20 m/s
        (2.0, 4.0, 0),
        (4.0, 5.0, 0),  # it crawls
        (4.0, 4.9, 0),
        (0.0, 0.0, 0),
    ],
)
def test_a_headway_is_short_below_a_second_above_5_m_s(
    gap_m: float, speed_m_s: float, short: int
) -> None:
    look = scene(ahead(gap_m), speed_m_s=speed_m_s)
    assert measured(scene(), look).short_headways == short


def test_the_lateral_jerk_is_the_change_of_the_lateral_acceleration() -> None:
    velocities = (20.0, 0.0), (23.0, 0.5), (25.0, 0.7), (25.0, 0.1)
    motions = watched(*(scene(speed_m_s=v_x, v_y=v_y) for v_x, v_y in velocities)).motions
    # forwards 3, 2, 0 m/s^2; sideways 0.5, 0.2, -0.6 m/s^2
    found = [(motion.a_y_m_s2, motion.j_x_m_s3, motion.j_y_m_s3) for motion in motions]
    wanted = [(0.5, 0.0, 0.0), (0.2, -1.0, -0.3), (-0.6, -2.0, -0.8)]
    assert found == [pytest.approx(each) for each in wanted]
    # the yaw rate of the first decision is the change of the direction, atan(0.5 / 23)
    first, second, _ = motions
    assert first.yaw_rate_rad_s == pytest.approx(math.atan(0.5 / 23))
    assert first.yaw_acceleration_rad_s2 == 0.0
    change = math.atan(0.7 / 25) - 2 * math.atan(0.5 / 23)
    assert second.yaw_acceleration_rad_s2 == pytest.approx(change)


@pytest.mark.parametrize(
    ("after_m_s", "lane_change", "forced", "braking_m_s2"),
    [(17.5, None, 0, 0.0), (18.1, CHANGE, 0, 1.9), (17.5, CHANGE, 1, 2.5), (21.0, CHANGE, 0, 0.0)],
)
def test_only_a_lane_change_forces_the_vehicle_behind_to_brake(
    after_m_s: float, lane_change: LaneChange | None, forced: int, braking_m_s2: float
) -> None:
    before = scene(behind(9.0, speed_m_s=20.0), lane_change=lane_change)
    row = measured(before, scene(behind(9.0, speed_m_s=after_m_s)))
    assert row.forced_brakes == forced
    assert row.max_forced_braking_m_s2 == pytest.approx(braking_m_s2)


def renamed(given: Scene, names: Sequence[str]) -> Scene:
    return replace(given, snapshot=given.snapshot._replace(ids=("ego", *names)))


def test_vehicles_are_the_same_by_name_and_not_by_row() -> None:
    # on an open road one enters, and the rows behind it move up
    before = renamed(scene(behind(9.0), ahead(90.0, speed_m_s=30.0), lane_change=CHANGE), "ab")
    rows = renamed(scene(ahead(50.0), behind(9.0, speed_m_s=17.0)), "ca")
    assert measured(before, rows).max_forced_braking_m_s2 == 3.0
    assert measured(before, renamed(scene(behind(9.0, speed_m_s=10.0)), "d")).forced_brakes == 0


def moving(*others: tuple[float, float]) -> list[Scene]:
    """Three scenes of the ego at 20 m/s; each other vehicle by its offset and its speed."""
    return [
        scene(
            *(Car(offset + (v - 20) * second, speed_m_s=v) for offset, v in others),
            s_m=(480.0 + 20 * second) % 500,
        )
        for second in range(4)
    ]


def test_the_pet_is_the_smallest_of_the_ego_s_and_of_the_others_behind_it() -> None:
    assert measured(*moving((25.0, 20.0), (-35.0, 20.0))).min_pet_s == pytest.approx(1.0)
    assert measured(*moving((45.0, 20.0), (-35.0, 20.0))).min_pet_s == pytest.approx(1.5)
    # 17.5 m behind at 2 s, at 25 m/s; where the ego is at the end, at 3 s, it never comes
    assert measured(*moving((-32.5, 25.0))).min_pet_s == pytest.approx(17.5 / 25)
    assert measured(*moving()).min_pet_s == math.inf


def test_a_driver_s_style_is_over_all_its_decisions() -> None:
    short = measured(*speeds(20.0, 22.0, 20.0))  # one reversal in 42 m, a jerk of 4 m/s^3
    long = measured(*speeds(20.0, 20.0, 20.0, 20.0, 18.0))
    other = replace(long, driver="other")
    mine, theirs = styles([short, other, long])
    assert (mine.driver, theirs.driver) == ("mine", "other")
    assert mine.reversals_per_km == pytest.approx(1 / (0.042 + 0.078))
    assert mine.mean_abs_jerk_m_s3 == pytest.approx((4.0 + 2.0) / 6)
    assert mine.comfortable_percent == 100
    plain = EpisodeMetrics()
    plain.add(decided())
    assert styles([plain.result("plain", "paper", 1, 0)]) == []


def test_the_command_and_the_function_add_the_columns_in_one_and_in_two_processes(
    tmp_path: Path, capsys: Capsys
) -> None:
    plain, added = tmp_path / "plain.csv", tmp_path / "added.csv"
    words = ["evaluate", "idm-mobil", "--vehicles", "20", "--episodes", "2", "--seed", "800000"]
    words += ["-o", "simulation.decisions_per_episode=6"]
    assert main([*words, "--out", str(plain)]) == 0
    assert "DRAC" not in capsys.readouterr().out
    assert main([*words, "--out", str(added), "--criticality", "--jobs", "2"]) == 0
    assert "DRAC" in capsys.readouterr().out
    first, second = (list(csv.reader(path.read_text().splitlines())) for path in (plain, added))
    width = len(first[0])
    assert [line[:width] for line in second] == first
    assert second[0][width] == "driven_m"
    settings = {"simulation": {"decisions_per_episode": 6}}
    given = {"vehicles": 20, "episodes": 2, "seed": 800_000, "config": settings}
    rows = drl_av.evaluate("idm-mobil", criticality=True, **given)  # type: ignore[arg-type]
    assert [list(map(str, row.cells().values())) for row in rows] == second[1:]


def test_a_table_with_an_ego_that_met_nobody_takes_more_drivers(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    words = ["evaluate", "--vehicles", "0", "--episodes", "1", "--criticality"]
    words += ["-o", "simulation.decisions_per_episode=3", "--out", str(table)]
    for driver in ("idm", "idm-mobil"):
        assert main([*words, "--driver", driver]) == 0
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert {row["driver"]: row["min_pet_s"] for row in rows} == {"idm": "inf", "idm-mobil": "inf"}
