"""The barricaded lane: learning without a check costs collisions that the check prevents."""

from pathlib import Path

import pytest

from drl_av.experiments.barricade_figure import barricade_figure
from drl_av.experiments.barricade_training import (
    BarricadeRow,
    Witness,
    barricade_rows,
    study_config,
    write_barricade_rows,
)

KEEP, RIGHT, LEFT = 0, 4, 8


def test_a_witness_tells_the_barricade_from_the_road_edge() -> None:
    env = Witness(config=study_config("permit_all", 0, 1))
    found = {}
    for side in (RIGHT, LEFT):
        env.reset(seed=0, options={"vehicles": 0})
        decisions, terminated = 0, False
        while not terminated:
            terminated, decisions = env.step(side)[2], decisions + 1
        found[side] = (env.hit, env.barricade_proposals, decisions)
    env.close()
    assert found[RIGHT][0] == "barricade"
    assert found[RIGHT][1] >= 2  # the body crosses the line in the second of them
    assert found[LEFT][:2] == ("road edge", 0)


def test_the_check_stops_proposals_that_are_counted_all_the_same() -> None:
    env = Witness(config=study_config("paper", 0, 1))
    env.reset(seed=0, options={"vehicles": 0})
    for _ in range(12):
        assert not env.step(RIGHT)[2]
    env.close()
    assert env.hit == ""
    assert env.barricade_proposals >= 6


def test_only_the_unchecked_training_runs_into_the_barricade(tmp_path: Path) -> None:
    rows = [
        row
        for check in ("permit_all", "paper")
        for row in barricade_rows(study_config(check, 0, 3), trained_episodes=1)
    ]
    assert [(row.safety_check, row.phase) for row in rows] == [
        (check, phase)
        for check in ("permit_all", "paper")
        for phase in ["training"] * 3 + ["trained"]
    ]
    hits = {
        check: [row.hit for row in rows if row.safety_check == check]
        for check in ("permit_all", "paper")
    }
    assert "barricade" in hits["permit_all"]
    assert not {"barricade", "road edge"} & set(hits["paper"])
    checked = [row for row in rows if row.safety_check == "paper"]
    assert sum(row.barricade_proposals for row in checked) > 0
    write_barricade_rows(tmp_path / "rows.csv", rows)
    lines = (tmp_path / "rows.csv").read_text().splitlines()
    assert len(lines) == 9


def test_the_figure_counts_what_the_table_says(tmp_path: Path) -> None:
    rows = [
        BarricadeRow("permit_all", 0, "training", 1, 5, 2, "barricade"),
        BarricadeRow("permit_all", 0, "training", 2, 9, 1, "vehicle"),
        BarricadeRow("permit_all", 0, "training", 3, 9, 1, "barricade"),
        BarricadeRow("permit_all", 0, "trained", 1, 200, 3, ""),
        BarricadeRow("permit_all", 0, "trained", 2, 100, 3, "vehicle"),
        BarricadeRow("paper", 0, "training", 1, 200, 20, ""),
        BarricadeRow("paper", 0, "training", 2, 200, 10, "by vehicle"),
        BarricadeRow("paper", 0, "training", 3, 200, 10, ""),
        BarricadeRow("paper", 0, "trained", 1, 200, 0, ""),
        BarricadeRow("paper", 0, "trained", 2, 200, 0, ""),
    ]
    write_barricade_rows(tmp_path / "rows.csv", rows)
    learning, trained = barricade_figure(tmp_path / "rows.csv").axes
    curves = {line.get_label(): list(line.get_ydata()) for line in learning.lines}
    assert curves["without a check"] == [1, 1, 2]
    assert curves["with the check"] == [0, 0, 0]
    assert [bar.get_height() for bar in trained.patches] == pytest.approx([2.0, 0.0])
    told = [text.get_text().splitlines()[-1] for text in trained.get_xticklabels()]
    assert told == ["1 of 2 episodes", "0 of 2 episodes"]
