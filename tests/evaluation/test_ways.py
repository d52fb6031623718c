"""Exits missed and merges that fail, in the tables, the summary, and pass or fail."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from drives import RESULT, episode
from runs import Capsys

from drl_av.cli import main
from drl_av.env.metrics import EpisodeResult
from drl_av.evaluation.criterion import judge
from drl_av.evaluation.statistics import fewest_missed, gains_over_fastest, overall, summarize


def drives(driver: str, ways: str, *speeds_m_s: float) -> list[EpisodeResult]:
    """One episode for each letter of ``ways``, where x is a missed exit; the seeds count up."""
    outcomes = {"o": "exit taken", "x": "exit missed"}
    return [
        episode(driver, seed, speed, way=outcomes[way])
        for seed, (way, speed) in enumerate(zip(ways, speeds_m_s, strict=True))
    ]


RULES = [
    *drives("idm", "xxxx", 30.0, 30.0, 30.0, 30.0),  # never leaves its lane, and is fast
    *drives("gap-mobil", "ooxo", 20.0, 20.0, 20.0, 20.0),
    *drives("sumo", "xooo", 22.0, 22.0, 22.0, 22.0),  # the fastest of those that miss one
]
FASTER = (23.0, 23.5, 23.0, 23.5)


def test_a_driver_is_compared_with_the_fastest_of_those_that_miss_fewest_exits() -> None:
    [mine] = judge([*drives("mine", "oxoo", *FASTER), *RULES])
    assert mine.over == "sumo"
    assert mine.criterion("speed").difference.value == 1.25
    route = mine.criterion("exit or merge")
    assert (route.ours, route.theirs, route.over, route.result) == (1, 1, "sumo", "undecided")
    assert "\n  exit or merge: undecided, 1 against 1 episodes of sumo, +0.0 [" in str(mine)


def test_only_drivers_that_miss_fewest_exits_are_the_fastest_baseline_at_a_density() -> None:
    rows = [*drives("mine", "oxoo", *FASTER), *RULES]
    assert fewest_missed(rows, ["idm", "gap-mobil", "sumo"]) == ["gap-mobil", "sumo"]
    [gain] = gains_over_fastest(rows, ["idm", "gap-mobil", "sumo"])  # idm is 7 m/s faster
    assert (gain.baseline, gain.difference_m_s.value) == ("sumo", 1.25)


def test_the_summary_of_all_densities_compares_with_the_same_rule_based_driver() -> None:
    rows = [*drives("mine", "oxoo", *FASTER), *RULES]
    over = {each.driver: each.over for each in overall(rows, ["idm", "gap-mobil", "sumo"])}
    assert over == {"mine": "sumo", "idm": "sumo", "gap-mobil": "sumo", "sumo": None}


def test_a_driver_that_misses_more_exits_fails_however_fast_it_is() -> None:
    mine = drives("mine", "xo" * 50, *[31.0, 32.0] * 50)
    sumo = drives("sumo", "x" + "o" * 99, *[22.0] * 100)
    idm = drives("idm", "x" * 100, *[30.0] * 100)
    [mine] = judge([*mine, *sumo, *idm])
    assert mine.failures == ("exit or merge",)
    assert str(mine).startswith("mine: FAIL (exit or merge) against sumo\n")


def test_without_a_way_nothing_is_said_of_one() -> None:
    plain = [replace(row, way="") for row in [*drives("mine", "oooo", *FASTER), *RULES]]
    [mine] = judge(plain)
    assert mine.over == "idm"
    assert "exit" not in str(mine)
    assert [(each.exits_taken, each.merged) for each in summarize(plain)] == [(None, None)] * 4


def test_the_summary_counts_exits_and_merges() -> None:
    exits = summarize([*drives("mine", "oxoo", *FASTER), *drives("idm", "xx", 30.0, 30.0)])
    assert [(each.exits_taken, each.merged) for each in exits] == [(3, None), (0, None)]
    merges = [replace(RESULT, way="merged"), replace(RESULT, seed=1, way="not merged")]
    assert [(each.exits_taken, each.merged) for each in summarize(merges)] == [(None, 1)]


def test_the_command_shows_exits_and_fails_a_driver_that_misses_more(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "lazy_exit.py").write_text(
        "from drl_av.drivers.rule_based import IdmDriver\n"
        "def lazy(config):\n"
        "    return IdmDriver(config.safety)\n"
    )
    words = ["evaluate", "--driver", "lazy_exit:lazy", "sumo", "--scenario", "exit"]
    words += ["--vehicles", "0", "--episodes", "2", "--require-pass"]
    out, summary = tmp_path / "rows.csv", tmp_path / "summary.json"
    assert main([*words, "--out", str(out), "--json", str(summary)]) == 1
    printed = capsys.readouterr().out
    assert "taken" in printed
    assert "fastest baseline" in printed
    assert "exit or merge: fail, 2 against 0 episodes of sumo, +100.0 [7.0, 100" in printed
    header, *rows = out.read_text().splitlines()
    assert header.endswith("d_safe_violations,way")
    assert [row.rpartition(",")[2] for row in rows] == ["exit missed", "exit taken"] * 2
    found = json.loads(summary.read_text())
    assert [each["exits_taken"] for each in found["by_vehicles"]] == [0, 2]
    assert "merged" not in found["by_vehicles"][0]
    assert found["judgements"][0]["failures"] == ["exit or merge"]  # it is faster


def test_the_tables_of_a_loop_have_no_way(tmp_path: Path, capsys: Capsys) -> None:
    out, summary = tmp_path / "rows.csv", tmp_path / "summary.json"
    words = ["evaluate", "--driver", "idm", "gap-mobil", "--vehicles", "1", "--episodes", "1"]
    words += ["-o", "simulation.decisions_per_episode=2", "--criticality"]
    assert main([*words, "--out", str(out), "--json", str(summary)]) == 0
    assert "way" not in out.read_text().splitlines()[0].split(",")
    text = summary.read_text() + capsys.readouterr().out
    assert not any(word in text for word in ("exit", "merge", "missed"))
