"""The trajectories of an episode: as a data frame, for SUMO's own tools, and as a figure."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sumo
from matplotlib.collections import LineCollection
from runs import SHORT, Capsys, error_message

import drl_av
from drl_av.cli import main
from drl_av.evaluation.recording import Recording, load_recording
from drl_av.evaluation.table import read_rows
from drl_av.evaluation.trajectories import time_space_figure, write_parquet

THERE = [[[10.0, 3.8, 20.0, 0.0], [490.0, 0.0, 30.0, 0.0]],
         [[29.0, 4.2, 18.0, 0.76], [20.0, 0.0, 29.0, 0.0]],
         [[38.0, 6.0, 18.0, 0.76], [math.nan] * 4]]  # fmt: skip
"""The ego and a vehicle that begins a lap of 500 m and leaves; the last decision takes 0.5 s."""
EPISODE = Recording(
    config=SHORT,
    driver="mine",
    seed=3,
    vehicles=1,
    proposed=np.array([9, 8]),
    executed=np.array([10, 8]),
    rules=np.array(["in lane", "none"]),
    ids=np.array(["ego", "truck"]),
    sizes_m=np.array([[5.0, 1.8], [12.0, 2.5]]),
    time_s=np.array([0.0, 1.0, 1.5]),
    states=np.array(THERE),
)


LONGER = "simulation.decisions_per_episode=40"


@pytest.fixture
def short(here: Path) -> list[str]:
    Path("short.toml").write_text(SHORT.with_traffic("calm").to_toml())
    return ["--config", "short.toml"]


def test_the_frame_has_a_row_for_each_vehicle_and_moment(tmp_path: Path) -> None:
    EPISODE.save(tmp_path / "episode.npz")
    frame = drl_av.episode_frame(tmp_path / "episode.npz")
    assert frame.columns.tolist() == [
        *("time_s", "id", "lane", "s_m", "y_m", "speed_m_s", "lateral_speed_m_s"),
        *("acceleration_m_s2", "decision", "rule", "length_m", "width_m"),
    ]
    nan = math.nan
    rows = [
        [0.0, "ego", 1, 10.0, 3.8, 20.0, 0.0, -2.0, "brake, change left", "in lane"],
        [0.0, "truck", 0, 490.0, 0.0, 30.0, 0.0, -1.0, "", ""],
        [1.0, "ego", 1, 29.0, 4.2, 18.0, 0.76, 0.0, "maintain, change left", "none"],
        [1.0, "truck", 0, 20.0, 0.0, 29.0, 0.0, nan, "", ""],
        [1.5, "ego", 2, 38.0, 6.0, 18.0, 0.76, nan, "", ""],  # 6.0 m is nearer to 7.6 than to 3.8
    ]
    sizes = {"ego": [5.0, 1.8], "truck": [12.0, 2.5]}
    assert str(frame.to_numpy().tolist()) == str([row + sizes[row[1]] for row in rows])
    still = replace(EPISODE, time_s=np.array([0.0, 1.0, 1.0]))  # a decision of no duration
    assert drl_av.episode_frame(still).time_s.tolist() == [0.0, 0.0, 1.0, 1.0]


def test_the_file_names_its_columns_and_its_vehicles(tmp_path: Path) -> None:
    EPISODE.save(tmp_path / "episode.npz")
    with np.load(tmp_path / "episode.npz") as file:
        assert file["columns"].tolist() == ["s_m", "y_m", "speed_m_s", "lateral_speed_m_s"]
        assert file["ids"].tolist() == ["ego", "truck"]
    replace(EPISODE, ids=np.array(["ego"])).save(tmp_path / "short.npz")
    with pytest.raises(drl_av.errors.RecordingError, match="rules, ids, sizes or times do not"):
        load_recording(tmp_path / "short.npz")


def test_sumos_own_tool_reads_the_floating_car_data_and_they_are_the_recorded_episode(
    short: list[str], capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["replay", "--driver", "random", "--vehicles", "4", *short, "--fcd", "fcd.xml"]
    assert main([*words, "--record", "e.npz"]) == 0
    assert "fcd.xml: recorded" in capsys.readouterr().out
    read = Path.read_bytes
    with monkeypatch.context() as patch:  # SUMO does not say that the disk is full
        cut = {"fcd.xml": -9}
        patch.setattr(Path, "read_bytes", lambda path: read(path)[: cut.get(path.name)])
        assert main(words) == 1
    assert "SUMO could not write fcd.xml to its end: free some space" in capsys.readouterr().err
    tool = Path(sumo.SUMO_HOME, "tools", "xml", "xml2csv.py")
    subprocess.run([sys.executable, tool, "fcd.xml", "-o", "fcd.csv", "-s", ","], check=True)
    rows = {(row["timestep_time"], row["vehicle_id"]): row for row in read_rows(Path("fcd.csv"))}
    frame = drl_av.episode_frame("e.npz")
    assert {*frame.length_m, *-frame.width_m} == {5.0, -1.8}
    assert len(rows) == 2 * (len(frame) - 5)  # two SUMO steps a decision; not the start
    for row in frame[frame.time_s > 0].itertuples():
        stamp = f"{row.time_s - 0.5:.3f}"  # SUMO names a step by its begin
        written = rows[stamp, row.id]
        assert float(written["vehicle_speed"]) == pytest.approx(row.speed_m_s, abs=1e-6)
        assert written["vehicle_lane"].endswith(f"_{row.lane}")
        radius_m = math.hypot(float(written["vehicle_x"]), float(written["vehicle_y"]))
        assert 500 / math.tau - radius_m == pytest.approx(row.y_m - 3.8, abs=1.0)  # a polygon


def test_the_parquet_file_is_the_frame(here: Path) -> None:
    pytest.importorskip("fastparquet")
    import pandas

    EPISODE.save(Path("e.npz"))
    write_parquet(EPISODE, Path("e.parquet"))
    frame = drl_av.episode_frame("e.npz")
    pandas.testing.assert_frame_equal(pandas.read_parquet("e.parquet"), frame)


def test_an_evaluation_keeps_its_episodes_or_its_failures_as_recordings(
    short: list[str], capsys: Capsys
) -> None:
    words = ["evaluate", "idm", "random", *short, "--safety-check", "permit_all"]
    words += ["--traffic", "calm", "--vehicles", "20", "--episodes", "5", "-o", LONGER]
    words += ["--out", "rows.csv"]
    assert main([*words, "--record-failures", "failed", "--jobs", "2"]) == 0
    rows = read_rows(Path("rows.csv"))
    failed = [row for row in rows if row["collided"] == "True" or float(row["min_ttc_s"]) <= 1.5]
    assert {row["collided"] for row in failed} == {"True", "False"}  # hits and near misses
    assert len(failed) < len(rows)
    files = {f"{row['driver']}-20-{row['seed']}.npz": row for row in failed}
    assert {path.name for path in Path("failed").iterdir()} == files.keys()
    for name, row in files.items():
        assert len(load_recording(Path("failed", name)).proposed) == int(row["decisions"])
    assert main([*words, "--record", "all"]) == 0
    assert "rows.csv has 10 episodes already, not driven again" in error_message(capsys)
    assert main([*words[:-1], "others.csv", "--record", "all"]) == 0
    assert len([*Path("all").iterdir()]) == 10


def test_the_time_space_diagram_draws_each_lane_and_joins_no_laps(here: Path) -> None:
    left, middle, right, colors = time_space_figure(EPISODE).axes
    assert colors.get_ylabel() == "speed, m/s (the ego: black border)"
    drawn = [
        [[line.tolist() for line in each.get_segments()] for each in panel.collections]
        for panel in (left, middle, right)
        if all(isinstance(each, LineCollection) for each in panel.collections)
    ]
    ego = [[[0.0, 10.0], [1.0, 29.0]], [[1.0, 29.0], [1.5, 38.0]]]
    assert drawn == [[[], []], [ego, ego], [[], []]]  # the truck goes from 490 m to 20 m
    EPISODE.save(Path("e.npz"))
    assert main(["figures", "--time-space", "e.npz", "--out", "figures"]) == 0
    assert [path.name for path in Path("figures").iterdir()] == ["time_space.png"]
