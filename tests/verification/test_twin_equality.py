"""The table of the twin beside SUMO, with hand-worked numbers; and its program, in short."""

import numpy as np
import pytest
from runs import Capsys

from verification.twin_equality import Cell, Drive, Paired, equal_decisions, main, print_pairs


def test_the_table_sums_up_speeds_lane_changes_and_orders(capsys: Capsys) -> None:
    def cell(driver: str, sumo: list[float], twin: list[float], changes: tuple[int, int]) -> None:
        found[Cell("calm", driver, 20)] = Paired((sumo, twin), changes, (100.0, 50.0), 0.25)

    found: dict[Cell, Paired] = {}
    cell("fast", [28.0, 29.0, 30.0], [28.5, 29.5, 30.5], (10, 4))
    cell("faster", [30.1, 31.0, 32.1], [28.4, 29.3, 30.4], (20, 11))  # not so in the twin
    cell("slow", [20.0, 21.0, 22.1], [20.0, 21.2, 22.0], (0, 0))
    cell("as slow", [21.0, 20.0, 22.0], [23.0, 24.0, 25.0], (0, 0))  # no interval separates these
    print_pairs(found)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("the ego's mean speed in 3 paired episodes")
    assert " ".join(lines[4].split()) == "fast 20 29.00 0.500 ± 0.000 0.1000 0.0800 25%"
    # 15 changes in 200 km are 0.075 a km, 30 in 400 km as many
    assert "lane changes in all: +0.0% in the twin" in lines
    assert lines[9] == "pairs of drivers that SUMO's interval separates: 5; in the same order: 4"


@pytest.mark.parametrize(("differs_from", "equal"), [(1, 0), (3, 2), (4, 3)])
def test_the_decisions_before_the_worlds_differ_are_equal(differs_from: int, equal: int) -> None:
    shots = [np.full(2, float(number >= differs_from)) for number in range(4)]
    one, other = (Drive(0.0, 0, 0.0, each) for each in ([np.zeros(2)] * 4, shots))
    assert equal_decisions(one, other) == equal  # of the three decisions between four snapshots


def test_the_program_drives_both_worlds(capsys: Capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = ["--scenes", "3", "--episodes", "2", "--vehicles", "5", "--traffic", "paper"]
    monkeypatch.setattr("sys.argv", ["twin_equality", *sizes])
    main()
    out = capsys.readouterr().out
    assert "       5       3       1.0000      1.0000          0.00000" in out
    assert "made by python" in out
