"""The barricaded lane: learning without a check costs collisions that the check prevents."""

from contextlib import closing
from pathlib import Path

import pytest

from drl_av.drivers.checked import PolicyDriver
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.errors import DrlAvError
from studies import barricade
from studies.barricade import (
    BARRICADE,
    BarricadeMetrics,
    BarricadeTraining,
    barricade_config,
    barricade_figure,
)
from studies.experiment import ResultsFolder, reproduce
from studies.options import ReproduceOptions

RIGHT, LEFT = 4, 8


def driven(check: str, direction: int) -> BarricadeMetrics:
    """An episode of 12 decisions at most, alone on the road, by a driver that insists."""
    config = barricade_config(check, 0, 1).updated("simulation", decisions_per_episode=12)
    with closing(HighwayEnv(config=config)) as env:
        metrics = BarricadeMetrics(env.road)
        for decision in rollout(env, PolicyDriver(lambda observation: direction), 0, 0):
            metrics.add(decision)
    return metrics


def test_a_collision_with_the_barricade_is_distinguished_from_one_with_the_road_edge() -> None:
    right, left = driven("permit_all", RIGHT), driven("permit_all", LEFT)
    assert (right.hit, left.hit) == ("barricade", "road edge")
    assert right.barricade_proposals >= 2  # the body crosses the line in the second of them
    assert left.barricade_proposals == 0


def test_proposals_that_the_check_replaces_are_counted() -> None:
    metrics = driven("paper", RIGHT)
    assert (metrics.hit, metrics.decisions) == ("", 12)
    assert metrics.barricade_proposals >= 6


def test_only_the_unchecked_training_runs_into_the_barricade() -> None:
    rows = {
        check: list(BarricadeTraining(barricade_config(check, 0, 3), 1).make([], 1))
        for check in ("permit_all", "paper")
    }
    for check, own in rows.items():
        assert {(row["safety_check"], row["seed"]) for row in own} == {(check, "0")}
        assert [row["phase"] for row in own] == ["training"] * 3 + ["trained"]
    assert "barricade" in {row["hit"] for row in rows["permit_all"]}
    assert not {"barricade", "road edge"} & {row["hit"] for row in rows["paper"]}
    assert sum(int(row["barricade_proposals"]) for row in rows["paper"]) > 0


def test_a_training_that_is_in_the_table_is_not_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(barricade, "SEEDS", (0,))
    monkeypatch.setattr(barricade, "EPISODES", 2)
    monkeypatch.setattr(barricade, "TRAINED_EPISODES", 1)
    options = ReproduceOptions(out=tmp_path)
    steps = reproduce(BARRICADE, options)
    # one seed, two checks, two episodes of training and one of the driver trained
    assert [next(steps).done for _ in range(4)] == [1, 2, 3, 4]
    steps.close()  # in the midst of the second training
    rows = ResultsFolder(tmp_path).rows("barricade.csv")
    assert [(row["phase"], row["episode"]) for row in rows] == [
        *(("training", "1"), ("training", "2"), ("trained", "1"))
    ]
    assert [step.done for step in reproduce(BARRICADE, options) if step.label] == [1, 2, 3]
    assert not [step for step in reproduce(BARRICADE, options) if step.label]
    written = (tmp_path / "barricade.csv").read_bytes()
    assert written.count(b"\n") == 1 + 6
    (tmp_path / "barricade.csv").write_bytes(written.rsplit(b"\n", 2)[0] + b"\n")
    with pytest.raises(DrlAvError, match=r"2 of 3 rows of a training"):
        list(reproduce(BARRICADE, options))


def test_the_figure_counts_what_the_table_says() -> None:
    names = ("safety_check", "phase", "episode", "decisions", "barricade_proposals", "hit")
    rows = [
        dict(zip(names, line.split(","), strict=True)) | {"seed": "0"}
        for line in (
            "permit_all,training,1,5,2,barricade",
            "permit_all,training,2,9,1,vehicle",
            "permit_all,training,3,9,1,barricade",
            "permit_all,trained,1,200,3,",
            "permit_all,trained,2,100,3,vehicle",
            "paper,training,1,200,20,",
            "paper,training,2,200,10,by vehicle",
            "paper,training,3,200,10,",
            "paper,trained,1,200,0,",
            "paper,trained,2,200,0,",
        )
    ]
    learning, trained = barricade_figure(rows).axes
    curves = {line.get_label(): list(line.get_ydata()) for line in learning.lines}
    assert curves["without a check"] == [1, 1, 2]
    assert curves["with the check"] == [0, 0, 0]
    assert [bar.get_height() for bar in trained.patches] == pytest.approx([2.0, 0.0])
    labels = [text.get_text().splitlines()[-1] for text in trained.get_xticklabels()]
    assert labels == ["1 of 2 episodes", "0 of 2 episodes"]
