"""Drivers trained for an experiment: ``fast`` and the final policies of the learning curves."""

import shutil
from pathlib import Path

import pytest

from drl_av.errors import DrlAvError
from studies import cells as module
from studies.curves import CURVES
from studies.experiment import Experiment, ResultsFolder, reproduce
from studies.fast import FAST
from studies.final_policies import FINAL_POLICIES
from studies.options import Progress, ReproduceOptions

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
def options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ReproduceOptions:
    """Two seeds stop after 2 of 3 episodes, and seed 0 goes on."""
    monkeypatch.setattr(module, "DENSITIES", (1, 2))
    (tmp_path / "short.toml").write_text(SHORT)
    runs, out, config = tmp_path / "runs", tmp_path / "out", str(tmp_path / "short.toml")
    usual = ReproduceOptions(seeds=3, episodes=2, drives=2, jobs=1, engine="here")
    return usual._replace(runs=runs, out=out, config=(config,))


def make(experiment: Experiment, options: ReproduceOptions) -> list[Progress]:
    return list(reproduce(experiment, options))


def trained_for(steps: list[Progress]) -> set[str]:
    """The trainings that were driven, and "training" where any was trained."""
    labels = {step.label.partition(",")[0].removeprefix("training ") for step in steps}
    return labels - {""}  # a figure


def places(options: ReproduceOptions, table: str) -> list[tuple[str, str, str]]:
    rows = ResultsFolder(options.out).rows(table)
    return [(row["training"], row["vehicles"], row["seed"]) for row in rows]


def cells(*trainings: str) -> list[tuple[str, str, str]]:
    return [(name, vehicles, seed) for name in trainings for vehicles in "12" for seed in "01"]


def test_fast_is_trained_on_every_seed_and_driven_beside_the_whole_schedule(
    options: ReproduceOptions,
) -> None:
    options = options._replace(seeds=2)
    *steps, figure = make(FAST, options)
    assert figure.line == str(options.out / "whole_schedule.png")
    assert (steps[-1].done, steps[-1].total) == (12, 12)  # three trainings, two densities and seeds
    trainings = ["paper-0", "fast-0", "fast-1"]
    assert places(options, "fast.csv") == cells(*trainings)
    facts = ResultsFolder(options.out).made_by("fast.csv")
    assert list(facts["policies_sha256"]) == trainings
    assert facts["episodes"] == dict.fromkeys(trainings, 3)
    assert list(facts["wall_time_s"]) == trainings


def test_more_drivers_of_the_whole_schedule_join_and_their_rows_stand_before_those_of_fast(
    options: ReproduceOptions,
) -> None:
    make(FAST, options._replace(seeds=1))
    before = ResultsFolder(options.out).rows("fast.csv")
    assert trained_for(make(FAST, options._replace(seeds=1, full_seeds=2))) == {
        "training",
        "paper-1",
    }
    assert places(options, "fast.csv") == cells("paper-0", "paper-1", "fast-0")
    rows = ResultsFolder(options.out).rows("fast.csv")
    assert [row for row in rows if row["training"] != "paper-1"] == before


def test_a_lost_table_is_driven_again_and_nothing_is_trained_again(
    options: ReproduceOptions,
) -> None:
    options = options._replace(seeds=2)
    make(FAST, options)
    table = options.out / "fast.csv"
    trained = {path: path.stat().st_mtime_ns for path in options.runs.glob("*/*.safetensors")}
    whole = table.read_text()
    table.write_text("".join(whole.splitlines(keepends=True)[:9]))
    assert trained_for(make(FAST, options)) == {"training", "fast-1"}
    assert table.read_text() == whole
    table.unlink()
    assert trained_for(make(FAST, options)) == {"training", "paper-0", "fast-0", "fast-1"}
    assert table.read_text() == whole
    assert trained == {path: path.stat().st_mtime_ns for path in trained}
    assert len(trained) == 6


def test_more_trainings_are_trained_alone_and_fewer_lose_nothing(
    options: ReproduceOptions,
) -> None:
    make(FAST, options._replace(seeds=2))
    shutil.rmtree(options.runs)
    assert trained_for(make(FAST, options._replace(seeds=1))) == set()
    assert trained_for(make(FAST, options)) == {"training", "fast-2"}
    assert not (options.runs / "paper-0").exists()
    assert places(options, "fast.csv") == cells("paper-0", "fast-0", "fast-1", "fast-2")


def test_final_policies_are_driven_each_with_the_check_of_its_training(
    options: ReproduceOptions,
) -> None:
    plan = FINAL_POLICIES.plan(options)
    checks = {cell.training.name: cell.config.safety.check for cell in plan.stages[0]}  # type: ignore[attr-defined]
    own = {"paper": "paper", "permit_all": "permit_all", "prioritized": "paper"}
    trainings = [f"{variant}-{seed}" for variant in own for seed in (1, 2)]
    assert checks == {name: own[name.partition("-")[0]] for name in trainings}
    make(FINAL_POLICIES, options)
    assert places(options, "final_policies.csv") == cells(*trainings)
    facts = ResultsFolder(options.out).made_by("final_policies.csv")
    assert facts["episodes"] == dict.fromkeys(plan.made_with.settings, 2)


def test_they_are_the_trainings_of_the_curves(options: ReproduceOptions) -> None:
    options = options._replace(variants=("paper",))
    make(FINAL_POLICIES, options)
    files = list(options.runs.glob("paper-[12]/*.safetensors"))
    trained = [path.stat().st_mtime_ns for path in files]
    make(CURVES, options)  # trains seed 0 alone
    rows = ResultsFolder(options.out).rows("curves.csv")
    found = [(row["seed"], row["episode"]) for row in rows]
    assert found == [*zip("000", "123", strict=True), *zip("1122", "1212", strict=True)]
    assert len(trained) == 4
    assert [path.stat().st_mtime_ns for path in files] == trained


def test_a_training_that_has_continued_is_not_taken_for_one_that_stopped(
    options: ReproduceOptions,
) -> None:
    make(CURVES, options._replace(variants=("prioritized",), full_seeds=2))
    with pytest.raises(
        DrlAvError, match=r"-1 has continued to episode 3, and its driver of episode"
    ):
        make(FINAL_POLICIES, options)
    assert not (options.out / "final_policies.csv").exists()
    assert not (options.runs / "paper-1").exists()  # refused before anything is trained


def test_drivers_of_other_episodes_are_not_mixed(options: ReproduceOptions) -> None:
    options = options._replace(variants=("paper",))
    make(FINAL_POLICIES, options._replace(episodes=1))
    before = (options.out / "final_policies.csv").read_bytes()
    with pytest.raises(DrlAvError, match=r"final_policies\.csv was made with other settings"):
        make(FINAL_POLICIES, options._replace(drives=3))
    assert (options.out / "final_policies.csv").read_bytes() == before


def test_where_all_trainings_continue_there_is_nothing_to_drive(options: ReproduceOptions) -> None:
    [step] = make(FINAL_POLICIES, options._replace(full_seeds=3))
    assert step.line == "No training stops at episode 2: final_policies needs more --seeds."
    assert not options.runs.exists()
