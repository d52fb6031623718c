"""The survey of users' networks: which routes it takes, and what it says of them."""

import sys
from pathlib import Path

import pytest
from nets import Part, chain
from runs import Capsys

from drl_av.errors import ConfigError
from drl_av.sumo_programs import sumo_module
from verification.imported_nets import (
    Drive,
    Result,
    Way,
    fast_edges,
    longest_way,
    main,
    reason,
    results_of,
    routes_of,
    summary,
    table,
)

#      a 5 -> b 3 -> d 4      the longest of the shortest ways is a, b, d with 12 m:
#      a   -> c 9 -> d        the way over c has 18 m; e leads nowhere and has 10 m
LENGTHS_M = {"a": 5.0, "b": 3.0, "c": 9.0, "d": 4.0, "e": 10.0}
LINKS = {"a": ["b", "c"], "b": ["d"], "c": ["d"], "d": [], "e": []}


def test_the_longest_of_the_shortest_ways() -> None:
    # to c it is 14 m, farther than to d; from c to d it is 13 m
    assert longest_way(LENGTHS_M, LINKS) == Way(14.0, ("a", "c"))
    without = {name: one for name, one in LENGTHS_M.items() if name != "c"}
    assert longest_way(without, LINKS) == Way(12.0, ("a", "b", "d"))


def test_further_routes_share_no_edge_and_have_a_kilometre() -> None:
    lengths_m = {name: 200 * one for name, one in LENGTHS_M.items()}
    found = [*routes_of(lengths_m, LINKS)]
    assert found == [Way(2800.0, ("a", "c")), Way(2000.0, ("e",)), Way(1400.0, ("b", "d"))]
    assert [*routes_of({"b": 600.0, "d": 399.0}, LINKS)] == []


def test_fast_edges_are_motorways_and_untyped_ones_of_two_fast_lanes(tmp_path: Path) -> None:
    net = chain(tmp_path, Part(2), Part(1), Part(2), Part(2, 20.0), Part(2))
    kinds = {"e1": "highway.motorway", "e2": "highway.primary", "e4": "town"}
    text = net.read_text()
    for edge, kind in kinds.items():
        text = text.replace(f'<edge id="{edge}" ', f'<edge id="{edge}" type="{kind}" ', 1)
    net.write_text(text)
    lengths_m, links = fast_edges(sumo_module("sumolib.net").readNet(str(net)))
    assert sorted(lengths_m) == ["e0", "e1", "e4"]
    assert links == {"e0": ["e1"], "e1": [], "e4": []}


def test_refusals_are_counted_without_names_and_numbers() -> None:
    text = "the route has lane_width_m 1.9, but must have 2 to 10: change it in netedit."
    assert reason(text) == "the route has lane_width_m N, but must have N to N"
    results = [
        Result("a.net.xml", Way(2000.0, ("x",)), True, "The road: ...", Drive(200, 1, 2, 3)),
        Result("b.net.xml", Way(3000.0, ("y",)), False, text, Drive()),
    ]
    assert [*summary(results)] == [
        "2 networks, of which 1 have a route that is read",
        "2 routes, 5 km: 1 are read (50%), 2 km",
        "1 refused: the route has lane_width_m N, but must have N to N",
        "driven: 200 decisions, ego hits 1, was hit 2, unreported overlaps 3",
    ]


def test_the_table_of_a_page_has_a_row_for_each_printed_text() -> None:
    text = "x: read.\n51 networks, of which 43 have a route that is read\n"
    text += "76 routes, 1752 km: 65 are read (86%), 497 km\n3 refused: the route\n"
    assert table({"now": text}).splitlines()[2] == "| now | 43 of 51 | 65 of 76 | 86% |"


def test_the_program_imports_and_drives_each_route(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, parts in (("one", [Part(2), Part(2)]), ("two", [Part(2), Part(2, width_m=3.2)])):
        (tmp_path / name).mkdir()
        chain(tmp_path / name, *parts)
    (tmp_path / "copy.net.xml").write_bytes((tmp_path / "two" / "own.net.xml").read_bytes())
    monkeypatch.setattr(sys, "argv", ["imported_nets", str(tmp_path), "--episodes", "1"])
    assert main() == 0
    said = capsys.readouterr().out
    assert "one/own.net.xml, 1.0 km from 'e0' to 'e1': read.\n    The road: 10" in said
    assert "copy.net.xml, 1.0 km from 'e0' to 'e1': refused.\n    lane 'e0_0' is 3.5 m wide" in said
    assert "two/own.net.xml" not in said  # it has the edges of the copy
    assert "2 routes, 2 km: 1 are read (50%), 1 km" in said
    assert "ego hits 0, was hit 0, unreported overlaps 0" in said


def test_a_file_that_is_no_network_ends_the_program_with_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "pointer.net.xml").write_text("version https://git-lfs.github.com/spec/v1")
    with pytest.raises(ConfigError, match=r"pointer.net.xml is no SUMO network \(syntax error\)"):
        [*results_of(tmp_path, 0)]


def test_a_folder_that_is_not_there_is_no_result(
    monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    monkeypatch.setattr(sys, "argv", ["imported_nets", "/no/such/folder"])
    with pytest.raises(SystemExit):
        main()
    assert "There is no folder /no/such/folder: name one that holds" in capsys.readouterr().err
