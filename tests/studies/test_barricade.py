"""The barricaded lane: learning without a check costs collisions that the check prevents."""

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from drl_av.config import Config
from drl_av.config.presets import preset
from drl_av.drivers.checked import PolicyDriver
from drl_av.drivers.learned import LearnedDriver, learned_driver
from drl_av.drivers.network import QNetwork
from drl_av.env.highway import HighwayEnv
from drl_av.env.rollout import rollout
from drl_av.evaluation.table import read_rows
from drl_av.files.table import write_table
from studies import barricade
from studies.barricade import (
    BARRICADE,
    SETTINGS,
    BarricadeMetrics,
    avoided_from,
    barricade_figure,
    barricade_table,
)
from studies.engine import make
from studies.options import Options, changed

RIGHT, LEFT = 4, 8
COLUMNS = ("safety_check", "phase", "episode", "decisions", "chosen", "hit_barricade", "hit_other")


def config(check: str) -> Config:
    return changed(preset("paper"), SETTINGS).updated("safety", check=check)


def insists_on(action: int) -> LearnedDriver:
    """A learned driver whose network prefers one action in every scene."""
    network = QNetwork(np.random.default_rng(0), 27, hidden=(8,))
    network.flat[:] = 0.0
    network.layers[-1][-1][action] = 1.0
    return learned_driver(network, Config())


def driven(check: str, direction: int, greedy: int) -> BarricadeMetrics:
    """An episode of 12 decisions at most, alone on the road, by a driver that insists."""
    settings = config(check).updated("simulation", decisions_per_episode=12)
    with closing(HighwayEnv(config=settings)) as env:
        metrics = BarricadeMetrics(env.road, insists_on(greedy))
        for decision in rollout(env, PolicyDriver(lambda observation: direction), 0, 0):
            metrics.add(decision)
    return metrics


def test_a_collision_with_the_barricade_is_distinguished_from_one_with_the_road_edge() -> None:
    right, left = driven("permit_all", RIGHT, LEFT), driven("permit_all", LEFT, RIGHT)
    assert (right.hit, left.hit) == ("barricade", "road edge")
    assert right.proposed >= 2  # the body crosses the line in the second of them
    assert left.proposed == 0


def test_proposals_that_the_check_replaces_are_counted() -> None:
    metrics = driven("paper", RIGHT, RIGHT)
    assert (metrics.hit, metrics.decisions) == ("", 12)
    assert metrics.proposed == metrics.chosen >= 6
    # what the greedy driver would have chosen counts beside it
    assert driven("paper", RIGHT, LEFT).chosen == 0


def test_only_the_unchecked_training_runs_into_the_barricade(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(barricade, "BLOCK", 2)
    monkeypatch.setattr(barricade, "EPISODES", {"permit_all": 8, "paper": 2})
    calls = barricade.barricade_plan(Options()).calls[:2]
    rows = {call.keys[0]["safety_check"]: call.function(call.argument) for call in calls}
    for check, own in rows.items():
        assert {(row["safety_check"], row["seed"]) for row in own} == {(check, "0")}
        assert own[-1]["phase"] == "trained"
    assert [row["episode"] for row in rows["permit_all"]] == ["2", "4", "6", "8", "2"]
    assert sum(int(row["hit_barricade"]) for row in rows["permit_all"][:-1]) > 0
    assert [row["hit_barricade"] for row in rows["paper"]] == ["0", "0"]
    assert int(rows["paper"][0]["proposed"]) > 0


def test_a_quick_form_is_as_short_as_its_settings_say() -> None:
    [first, *_] = barricade.barricade_plan(Options(config=("learning.episodes=3",))).calls
    keys = [(key["phase"], key["episode"]) for key in first.keys]
    assert keys == [("training", "3"), ("trained", "3")]
    [first, *_] = barricade.barricade_plan(Options(most_episodes=2)).calls
    assert (first.keys[-1]["phase"], first.keys[-1]["episode"]) == ("trained", "2")


def test_a_training_that_is_in_the_table_is_not_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(barricade, "SEEDS", (0,))
    monkeypatch.setattr(barricade, "EPISODES", {"permit_all": 2, "paper": 2})
    monkeypatch.setattr(barricade, "BLOCK", 1)
    options = Options(engine="here", out=tmp_path)
    steps = make(BARRICADE, options)
    # one seed, two checks, two episodes of training and one of the driver trained
    assert next(steps).done == 3
    steps.close()  # in the midst of the second training
    rows = read_rows(tmp_path / "barricade.csv")
    found = [(row["phase"], row["episode"]) for row in rows]
    assert found == [("training", "1"), ("training", "2"), ("trained", "1")]
    assert json.loads((tmp_path / "barricade.json").read_text())["engine"] == "here"
    assert [step.done for step in make(BARRICADE, options)] == [3]
    assert list(make(BARRICADE, options)) == []
    written = (tmp_path / "barricade.csv").read_bytes()
    assert written.count(b"\n") == 1 + 6
    (tmp_path / "barricade.csv").write_bytes(written.rsplit(b"\n", 2)[0] + b"\n")
    assert len(list(make(BARRICADE, options))) == 1  # trained again
    assert (tmp_path / "barricade.csv").read_bytes() == written


def test_a_barricade_is_avoided_only_if_it_is_to_the_end() -> None:
    def training(*chosen: int) -> list[dict[str, str]]:
        return [{"decisions": "1000", "chosen": str(count)} for count in chosen]

    assert avoided_from(training(9, 2, 1, 0)) == 2
    assert avoided_from(training(9, 0, 2, 1)) == 3
    assert avoided_from(training(0, 1, 1)) == 0
    assert avoided_from(training(9, 0, 2)) is None


def test_the_figure_and_the_table_say_what_the_rows_say(tmp_path: Path) -> None:
    rows = [
        dict(zip(COLUMNS, line.split(","), strict=True)) | {"seed": seed}
        for seed, lines in {
            "0": (
                "permit_all,training,100,500,30,30,60",
                "permit_all,training,200,500,20,20,70",
                "permit_all,trained,100,2000,10,1,4",
                "paper,training,100,9000,90,0,0",
                "paper,training,200,9000,0,0,0",
                "paper,trained,100,20000,0,0,0",
            ),
            "1": (
                "permit_all,training,100,500,30,40,60",
                "permit_all,training,200,500,0,20,70",
                "permit_all,trained,100,2000,0,2,4",
                "paper,training,100,9000,0,0,0",
                "paper,training,200,9000,9,0,0",
                "paper,trained,100,20000,0,0,0",
            ),
        }.items()
        for line in lines
    ]
    write_table(tmp_path / "barricade.csv", rows[0], rows)
    collisions, choices = barricade_figure(tmp_path).axes
    curves = {line.get_label(): list(line.get_ydata()) for line in collisions.lines}
    assert curves["without a check"] == [35, 55]
    assert curves["with the check"] == [0, 0]
    shares = {line.get_label(): list(line.get_ydata()) for line in choices.lines}
    assert shares["without a check"] == pytest.approx([6.0, 2.0])
    assert shares["with the check"] == pytest.approx([0.5, 0.05])
    _, _, without, checked = barricade_table(tmp_path).splitlines()
    # 50 and 60 collisions: 55, and half of the interval is 12.706 * 5
    assert "| `permit_all` | 2 | 200 | 55 ± 64 | 1 of 2 | 40 |" in without
    # 5 % and 3 % of the choices in the last rows
    assert without.endswith("| 4.00 ± 12.71 % | 3 of 200 |")
    assert "| `paper` | 2 | 200 | 0 ± 0 | 2 of 2 | 0 |" in checked
    assert checked.endswith("| 0 of 200 |")
