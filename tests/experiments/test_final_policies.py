"""What the learning curves' trainings end in, as an experiment of ``drl-av reproduce``."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from drl_av.config import Config
from drl_av.drivers.registry import DriverSpec
from drl_av.errors import DrlAvError
from drl_av.evaluation.comparison import Evaluation
from drl_av.experiments import trained_drivers
from drl_av.experiments.curves import curves
from drl_av.experiments.final_policies import ends
from drl_av.experiments.options import Scale
from drl_av.experiments.tables import read_rows

SHORT = """
[simulation]
decisions_per_episode = 4
[traffic]
vehicles_max = 3
[learning]
episodes = 3
evaluate_every = 1
evaluation_episodes = 1
"""


@pytest.fixture
def scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scale:
    """Two seeds stop after 2 of 3 episodes, and seed 0 goes on."""
    monkeypatch.setattr(trained_drivers, "DENSITIES", (1, 2))
    (tmp_path / "short.toml").write_text(SHORT)
    runs, out, config = tmp_path / "runs", tmp_path / "out", str(tmp_path / "short.toml")
    return Scale(seeds=3, episodes=2, drives=2, jobs=1, runs=runs, out=out, config=config)


def test_those_that_stop_are_driven_each_with_the_check_that_it_learnt_with(
    scale: Scale, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = set()

    class Noted(Evaluation):
        def __init__(self, config: Config, choices: Sequence[DriverSpec], *rest: Any) -> None:
            super().__init__(config, choices, *rest)
            checks.update((choice.name, config.safety.check) for choice in choices)

    monkeypatch.setattr(trained_drivers, "Evaluation", Noted)
    list(ends(scale))
    rows = read_rows(scale.out / "ends.csv")
    facts = json.loads((scale.out / "ends.json").read_text())
    own = {"paper": "paper", "permit_all": "permit_all", "prioritized": "paper"}
    trainings = [f"{variant}-{seed}" for variant in own for seed in (1, 2)]
    assert checks == {(f"{variant}-{seed}", own[variant]) for variant in own for seed in (1, 2)}
    assert [(row["training"], row["vehicles"], row["seed"]) for row in rows] == [
        (training, vehicles, seed)
        for training in trainings
        for vehicles in ("1", "2")
        for seed in ("0", "1")
    ]
    assert facts["episodes"] == dict.fromkeys(trainings, 2)


def test_they_are_the_trainings_of_the_curves(scale: Scale) -> None:
    scale = scale._replace(variants=("paper",))
    list(ends(scale))
    files = list(scale.runs.glob("paper-[12]/*.safetensors"))
    trained = [path.stat().st_mtime_ns for path in files]
    list(curves(scale))  # trains seed 0 alone
    rows = read_rows(scale.out / "curves.csv")
    places = [(row["seed"], row["episode"]) for row in rows]
    assert places == [*zip("000", "123", strict=True), *zip("1122", "1212", strict=True)]
    assert len(trained) == 4
    assert [path.stat().st_mtime_ns for path in files] == trained


def test_a_training_that_has_gone_on_is_not_taken_for_one_that_stopped(scale: Scale) -> None:
    list(curves(scale._replace(variants=("prioritized",), full_seeds=2)))
    with pytest.raises(DrlAvError, match=r"-1 has gone on to episode 3, and its driver of episode"):
        list(ends(scale))
    assert not (scale.out / "ends.csv").exists()
    assert not (scale.runs / "paper-1").exists()  # told before anything is trained


def test_drivers_of_other_episodes_are_not_mixed(scale: Scale) -> None:
    scale = scale._replace(variants=("paper",))
    list(ends(scale._replace(episodes=1)))
    before = (scale.out / "ends.csv").read_bytes()
    with pytest.raises(DrlAvError, match=r"ends\.csv was made with other settings"):
        list(ends(scale._replace(drives=3)))
    assert (scale.out / "ends.csv").read_bytes() == before


def test_where_all_go_on_to_the_end_there_is_nothing_to_drive(scale: Scale) -> None:
    [progress] = ends(scale._replace(full_seeds=3))
    assert progress.line == "No training stops at episode 2: ends needs more --seeds."
    assert not list(scale.runs.iterdir())


@pytest.fixture
def made(scale: Scale) -> Scale:
    """One training's driver in the table, in two episodes each among 1 and 2 vehicles."""
    scale = scale._replace(variants=("paper",), seeds=2)
    list(ends(scale))
    return scale


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "".join(line for line in text.splitlines(True) if "paper-1,1,0," not in line),
        lambda text: text + text.splitlines(True)[-1],
        lambda text: text[:-3],
        lambda text: text[: text.rindex(",")] + "\n",
    ],
    ids=["a row is lost", "a row is there twice", "the last word is cut", "a column is cut"],
)
def test_rows_that_are_not_as_they_were_written_are_told_and_left_alone(
    damage: Callable[[str], str], made: Scale
) -> None:
    table = made.out / "ends.csv"
    table.write_text(damage(table.read_text()))
    before = table.read_bytes()
    for drives in (2, 3):
        with pytest.raises(DrlAvError, match=r"ends\.csv, or what stands beside it, is damaged"):
            list(ends(made._replace(drives=drives)))
    assert table.read_bytes() == before


@pytest.mark.parametrize("key", ["settings", "policies_sha256", "episodes", "wall_time_s"])
@pytest.mark.parametrize("value", [[1], 3, None])
def test_a_damaged_sidecar_is_told_before_anything_is_driven(
    key: str, value: object, made: Scale
) -> None:
    sidecar = made.out / "ends.json"
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | {key: value}))
    before = (made.out / "ends.csv").read_bytes()
    with pytest.raises(DrlAvError, match="is damaged or of another version"):
        next(ends(made._replace(drives=3)))
    assert (made.out / "ends.csv").read_bytes() == before
