"""The figure of the ramps: what it reads from the printed lines."""

from pathlib import Path

import pytest

from drl_av.errors import DrlAvError
from verification import ramps_figure
from verification.ramps import Trip, line
from verification.ramps_figure import Point, points

TRIPS = [
    Trip(success=True, end_s=36.0, flow_per_h=900.0, braking_behind=True),
    *[Trip(success=True, end_s=38.0, flow_per_h=900.0)] * 8,
    Trip(flow_per_h=900.0),
]


def test_each_measure_has_its_value_and_the_ends_of_its_interval() -> None:
    text = "\n".join(
        [line("exit", "sumo", 1000.0, TRIPS, 30.0), line("exit", "gap-mobil", 0.0, TRIPS, None)]
    )
    # Wilson, 9 of 10 and 1 of 10; (36 + 8 * 38) / 9 - 30 s
    assert points(text, "success")["sumo"] == [Point(900.0, 90.0, 59.6, 98.2)]
    assert points(text, "behind")["sumo"] == [Point(900.0, 10.0, 1.8, 40.4)]
    assert points(text, "forced")["sumo"] == [Point(900.0, 0.0, 0.0, 27.8)]
    assert points(text, "lost") == {"sumo": [Point(900.0, 7.8, 7.8, 7.8)]}  # the other is unknown


def test_the_figure_is_written_beside_the_printed_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["ramps_figure", str(tmp_path)])
    with pytest.raises(DrlAvError, match=r"has no merge.txt: make it with verification.ramps"):
        ramps_figure.main()
    for kind in ("merge", "exit", "ramp_to_ramp"):
        (tmp_path / f"{kind}.txt").write_text(line(kind, "sumo", 1000.0, TRIPS, 30.0))
    (tmp_path / "exit_learned.txt").write_text(line("exit", "learned", 1000.0, TRIPS, 30.0))
    ramps_figure.main()
    assert (tmp_path / "ramps.png").stat().st_size > 10_000
